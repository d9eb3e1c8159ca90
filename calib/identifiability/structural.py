"""What measurements of a kind can tell of an arm at all, by the columns of its nominal robot's Jacobian.

Three kinds see different things. Positions and full poses are looked at with the scanner's place known, as Park 2022
does, or unknown, as a fit has it: then what a motion of the scanner would do is taken out of the columns. Distances to
a reference pose (Jang 2025 eq 14) need no place, and d1, theta1 and beta1 are invisible to them. Of an arm that moves
in a plane they see less than positions do: what leads out of the plane changes no length, to first order.

How the jig sits on the tool is unknown in any case, so what its seat can absorb is taken out of full poses too.
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
"""How turns count beside lengths where no measurement says so: 0.05 mm against 0.1 mrad."""

_KNOWN = "in the base frame, as if the scanner's place were known (Park)"
MEASURED_BY = {
    "position": f"positions of the tool point {_KNOWN}",
    "pose": f"full poses, place and attitude of a jig that sits on the tool anyhow, {_KNOWN}",
    "distance": "distances to the reference pose, which need no scanner's place (Jang)",
    "pairs": "the distances between all poses, which are positions from an unknown place",
}
"""By what each kind of residual sees the parameters, in words."""
_OBSERVED = {"position": "the measured point", "pose": "the full pose, but for what the jig's seat takes up"}


@one_blas_thread()
def redundancy(dataset: Dataset, *, residual: str = "position") -> Redundancy:
    """Which parameters say the same at the dataset's training poses, for the nominal robot (Park 2022 section 3).

    "position" and "pose" with the scanner's place known; "distance" and "pairs" need none.
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
    """What is left of the rank where nobody knows the scanner's place, as in a fit."""

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
    """How many parameters can be told where the scanner's place is unknown."""
    columns, moved = _at_training_poses(dataset, residual, frame_known=False)
    names, units = dataset.robot.parameter_names, dataset.robot.parameter_units
    here = analyse(columns, names, units, moved=moved).rank
    best = {kind: structural_rank(dataset.robot, residual=kind) for kind in RESIDUAL_KINDS}
    return FreeFrameRank(residual, here, best)


def structural_rank(robot: Robot, *, residual: str = "position") -> int:
    """How many parameters distances, or positions or poses from an unknown place, can tell of this arm at best."""
    rng, poses = np.random.default_rng(0), 200  # any generic poses give the same rank
    span = np.where(robot.is_revolute, np.pi, 500.0)
    q = rng.uniform(-1.0, 1.0, (poses, robot.n_joints)) * span
    columns, moved = _columns(robot, q, np.full(poses, ""), residual, frame_known=False)
    return analyse(columns, robot.parameter_names, robot.parameter_units, moved=moved).rank


def fewest_poses(robot: Robot, *, residual: str = "position", setups: int = 1, rank: int = 0) -> int:
    """How many different poses a fit takes at the least: one equation more than it has to settle.

    `rank`: of the fit, where effects make it more than the arm's.

    Each setup's frame takes six equations of positions or poses and its first pose of distances, the jig's seat on the
    tool three of poses. So few leave the residual hardly a degree of freedom; three times as many are a measurement.
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
    """(R, P) how the table's entries move what a residual sees, and (P,) how far before unknowns take up their part.

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
        height = len(columns) // len(q)  # what stands below the place is for full poses
        basis = orthonormal(
            np.concatenate([a[:, :height] for a in absorbed], axis=2).reshape(len(columns), -1)
        )
        columns = columns - basis @ (basis.T @ columns)
    return columns, moved


def _motion(points_mm: Array, rows: IndexArray) -> Array:
    """(N, 6, 6) what a shift of one setup's scanner, and a turn about its points' centre, do to place and attitude."""
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
