"""Structural identifiability: which parameters a kind of measurement can determine, by the nominal robot's Jacobian.

Positions and full poses are analysed with the scanner's frame known, as in Park 2022, or unknown, as in a fit: then the
effect of a motion of the frame is projected out of the columns. Distances to a reference pose (Jang 2025 eq 14) need no
frame; d1, theta1 and beta1 do not change them. Of an arm that moves in a plane they determine less than positions do:
a motion out of the plane changes no distance, to first order.

The jig's orientation on the tool is unknown in any case, so its effect is projected out of full poses too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib import frames
from calib.array_types import Array, IndexArray
from calib.blas_threads import one_blas_thread
from calib.dataset.dataset import Dataset
from calib.errors import FitError
from calib.fitting.scanner_frame import orthonormal
from calib.identifiability.redundancy import Redundancy, analyse
from calib.kinematics import chain as kinematics
from calib.kinematics.robot import Robot
from calib.options import RESIDUAL_KINDS

MM_PER_RADIAN = 500.0
"""The weight of turns against lengths where no covariance gives one: 0.05 mm against 0.1 mrad."""

_KNOWN = "in the base frame, as if the scanner's place were known (Park)"
MEASURED_BY = {
    "position": f"positions of the tool point {_KNOWN}",
    "pose": f"full poses, place and attitude of a jig that sits on the tool anyhow, {_KNOWN}",
    "distance": "distances to the reference pose, which need no scanner's place (Jang)",
    "pairs": "the distances between all poses, which are positions from an unknown place",
}
"""The measurement behind each kind of residual, as text."""
_OBSERVED = {"position": "the measured point", "pose": "the full pose, but for what the jig's seat takes up"}


@one_blas_thread()
def redundancy(dataset: Dataset, *, residual: str = "position") -> Redundancy:
    """Redundant parameters at the dataset's training poses, for the nominal robot (Park 2022, section 3).

    "position" and "pose" with the scanner's frame known; "distance" and "pairs" need none.
    """
    columns, moved = _at_training_poses(dataset, residual, frame_known=True)
    return analyse(
        columns,
        dataset.robot.parameter_names,
        dataset.robot.parameter_units,
        moved=moved,
        measured_by=MEASURED_BY[residual],
        observed=_OBSERVED.get(residual, "the distances"),
    )


@dataclass(frozen=True)
class FreeFrameRank:
    """The rank where the scanner's frame is unknown, as in a fit."""

    residual: str
    here: int  # at the dataset's training poses
    best: Mapping[str, int]  # by kind of residual, at generic poses of this arm

    def summary(self) -> str:
        best = self.best[self.residual]
        if self.residual in _OBSERVED:
            what, option = (
                ("full poses", " --residual pose") if self.residual == "pose" else ("positions", "")
            )
            return (
                f"With the scanner's place unknown, as `calibrate{option}` has it, {what} tell {self.here} at these "
                f"poses, and {best} at best (this arm at generic poses)."
            )
        return (
            f"At best, this arm at generic poses, such distances tell {best}; positions from an unknown scanner's "
            f"place {self.best['position']}, full poses {self.best['pose']}."
        )


def free_frame_rank(dataset: Dataset, *, residual: str = "position") -> FreeFrameRank:
    """How many parameters can be identified where the scanner's frame is unknown."""
    columns, moved = _at_training_poses(dataset, residual, frame_known=False)
    names, units = dataset.robot.parameter_names, dataset.robot.parameter_units
    here = analyse(columns, names, units, moved=moved).rank
    best = {kind: structural_rank(dataset.robot, residual=kind) for kind in RESIDUAL_KINDS}
    return FreeFrameRank(residual, here, best)


def structural_rank(robot: Robot, *, residual: str = "position") -> int:
    """How many parameters of this arm a kind of residual can identify at best, the scanner's frame unknown."""
    rng, poses = np.random.default_rng(0), 200  # any generic poses give the same rank
    span = np.where(robot.is_revolute, np.pi, 500.0)
    q = rng.uniform(-1.0, 1.0, (poses, robot.n_joints)) * span
    columns, moved = _columns(robot, q, np.full(poses, ""), residual, frame_known=False)
    return analyse(columns, robot.parameter_names, robot.parameter_units, moved=moved).rank


def fewest_poses(robot: Robot, *, residual: str = "position", setups: int = 1, rank: int = 0) -> int:
    """The fewest different poses that a fit needs: one equation more than unknowns.

    Each setup's frame takes six equations of positions or poses, and one pose of distances; the jig's seat on the tool
    takes three of poses. So few poses leave about one degree of freedom; three times as many are a good measurement.

    Args:
        setups: how many placements of the scanner.
        rank: of the fit, where effects make it more than the arm's.
    """
    each, unknowns = {"distance": (1, setups), "pose": (6, 6 * setups + 3)}.get(residual, (3, 6 * setups))
    return (max(structural_rank(robot, residual=residual), rank) + unknowns) // each + 1


def _at_training_poses(dataset: Dataset, residual: str, *, frame_known: bool) -> tuple[Array, Array]:
    poses = dataset.poses
    rows = [poses.reference, *(int(i) for i in np.flatnonzero(poses.role == "train"))]
    columns, moved = _columns(
        dataset.robot, poses.q[rows], poses.setup[rows], residual, frame_known=frame_known
    )
    if len(columns) < 2:
        raise FitError(
            f"dataset {dataset.name}: its training poses give {len(columns)} distances between different places of one "
            "setup; two or more are needed"
        )
    return columns, moved


def _columns(
    robot: Robot, q: Array, setup: NDArray[np.str_], residual: str, *, frame_known: bool
) -> tuple[Array, Array]:
    """The Jacobian (R, P) of what a residual compares, and its columns' norms (P,) before unknowns are projected out.

    q  # (N, n); setup  # (N,), whose first pose is the one that distances start from
    """
    if residual not in RESIDUAL_KINDS:
        raise FitError(f"no residual named {residual!r}; there are {', '.join(RESIDUAL_KINDS)}")
    chain = kinematics.forward(robot.table, q, robot.is_revolute)
    columns = kinematics.point_jacobian(chain, chain.target_mm).reshape(len(q), 3, -1)
    setups = [np.flatnonzero(setup == name) for name in np.unique(setup)]
    if residual == "distance":
        distances = [_distance_columns(chain.target_mm[rows], columns[rows]) for rows in setups]
        return np.concatenate(distances), np.linalg.norm(columns, axis=(0, 1))
    absorbed = []
    if not frame_known or residual == "pairs":
        absorbed = [_motion(chain.target_mm, rows) for rows in setups]
    if residual == "pose":
        turn = MM_PER_RADIAN * kinematics.turn_jacobian(chain).reshape(len(q), 3, -1)
        columns = np.concatenate([columns, turn], axis=1)
        seat = np.zeros((len(q), 6, 3))
        seat[:, 3:] = MM_PER_RADIAN * chain.base_T_frame[:, -1, :3, :3]
        absorbed.append(seat)
    moved = np.linalg.norm(columns, axis=(0, 1))
    columns = np.asarray(columns.reshape(-1, columns.shape[-1]), dtype=np.float64)
    if absorbed:
        height = len(columns) // len(q)  # 3 rows a position, 6 a full pose
        basis = orthonormal(
            np.concatenate([a[:, :height] for a in absorbed], axis=2).reshape(len(columns), -1)
        )
        columns = columns - basis @ (basis.T @ columns)
    return columns, moved


def _motion(points_mm: Array, rows: IndexArray) -> Array:
    """(N, 6, 6) derivative of position and orientation by a shift of a setup's frame and a turn about its points."""
    out = np.zeros((len(points_mm), 6, 6))
    out[rows, :3, :3] = np.eye(3)
    out[rows, :3, 3:] = -frames.skew(points_mm[rows] - points_mm[rows].mean(axis=0))
    out[rows, 3:, 3:] = MM_PER_RADIAN * np.eye(3)
    return out


def _distance_columns(points_mm: Array, by_parameter: Array) -> Array:
    """Phi of Jang eq (14): 2 (P_k - P_1)^T (J_k - J_1), (N - 1, P), divided by twice the length."""
    along = points_mm[1:] - points_mm[0]
    length = np.linalg.norm(along, axis=1)
    keep = length > 1e-6
    columns = np.einsum(
        "ki,kip->kp", along[keep] / length[keep, None], (by_parameter[1:] - by_parameter[0])[keep]
    )
    return np.asarray(columns)
