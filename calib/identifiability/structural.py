"""Structural identifiability: which parameters a kind of measurement can determine, by the nominal robot's Jacobian.

Positions and full poses are analysed with the scanner's frame known, as in Park 2022, or unknown, as in a fit: then the
effect of a motion of the frame is projected out of the columns. Distances to a reference pose (Jang 2025 eq 14) need no
frame; d1, theta1 and beta1 do not change them. Of an arm that moves in a plane they determine less than positions do:
a motion out of the plane changes no distance, to first order.

The jig's orientation on the tool is unknown in any case, so its effect is projected out of full poses too.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib import frames
from calib.array_types import Array, IndexArray
from calib.blas_threads import one_blas_thread
from calib.dataset.dataset import Dataset
from calib.effects.link_errors import target_parameter_names
from calib.errors import FitError
from calib.fitting.scanner_frame import orthonormal
from calib.identifiability.redundancy import Redundancy, analyse
from calib.kinematics import chain as kinematics
from calib.kinematics.robot import Robot, Target
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
    columns, moved, names, units = _at_training_poses(dataset, residual, frame_known=True)
    return analyse(
        columns,
        names,
        units,
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
    columns, moved, names, units = _at_training_poses(dataset, residual, frame_known=False)
    here = analyse(columns, names, units, moved=moved).rank
    measured = _measured_targets(dataset)
    best = {kind: structural_rank(dataset.robot, residual=kind, measured=measured) for kind in RESIDUAL_KINDS}
    return FreeFrameRank(residual, here, best)


def structural_rank(robot: Robot, *, residual: str = "position", measured: Collection[str] = ("jig",)) -> int:
    """How many parameters of this arm a kind of residual can identify at best, the scanner's frame unknown.

    `measured`: the targets that are measured at every pose; their places are unknown, the tool's end ("jig") apart.
    """
    rng, poses = np.random.default_rng(0), 200  # any generic poses give the same rank
    span = np.where(robot.is_revolute, np.pi, 500.0)
    q = rng.uniform(-1.0, 1.0, (poses, robot.n_joints)) * span
    targets = _further_targets(robot, measured, residual)
    of_target = None
    if targets:
        seen = [*([-1] if "jig" in measured else []), *range(len(targets))]
        of_target = np.tile(seen, poses)
        q = np.repeat(q, len(seen), axis=0)
    columns, moved = _columns(
        robot, q, np.full(len(q), ""), residual, frame_known=False, targets=targets, of_target=of_target
    )
    return analyse(columns, *_names_and_units(robot, targets), moved=moved).rank


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


def _at_training_poses(
    dataset: Dataset, residual: str, *, frame_known: bool
) -> tuple[Array, Array, tuple[str, ...], tuple[str, ...]]:
    """As `_columns`, with the names and units of the columns.

    Further targets that were measured there have rows of their own, and columns for where they sit; distances are of
    the tool point alone.
    """
    poses, robot = dataset.poses, dataset.robot
    rows = [poses.reference, *(int(i) for i in np.flatnonzero(poses.role == "train"))]
    rows = [i for i in rows if poses.ids[i] not in dataset.left_out]
    points, of_target = dataset.points, None
    targets = _further_targets(robot, _measured_targets(dataset), residual)
    if targets and points is not None:
        trained = ~poses.is_test[points.pose]
        order = {"jig": -1} | {target.name: k for k, target in enumerate(targets)}
        pairs = dict.fromkeys(
            (int(pose), order[str(name)])
            for pose, name in zip(points.pose[trained], points.target[trained], strict=True)
        )
        rows = [pose for pose, _ in pairs]
        of_target = np.array([target for _, target in pairs])
    columns, moved = _columns(
        robot,
        poses.q[rows],
        poses.setup[rows],
        residual,
        frame_known=frame_known,
        targets=targets,
        of_target=of_target,
    )
    if len(columns) < 2:
        raise FitError(
            f"dataset {dataset.name}: its training poses give {len(columns)} distances between different places of one "
            "setup; two or more are needed"
        )
    return columns, moved, *_names_and_units(robot, targets)


def _measured_targets(dataset: Dataset) -> set[str]:
    """The targets that were measured at training poses; the tool's end where no point is known yet."""
    points = dataset.points
    if points is None:
        return {"jig"}
    return set(points.target[~dataset.poses.is_test[points.pose]].tolist())


def _further_targets(robot: Robot, measured: Collection[str], residual: str) -> tuple[Target, ...]:
    """Those whose places are unknown in a fit: distances are of the tool's end alone."""
    return () if residual == "distance" else tuple(t for t in robot.targets if t.name in measured)


def _names_and_units(robot: Robot, targets: tuple[Target, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Of the columns: the table's, then the places of targets."""
    places = tuple(name for target in targets for name in target_parameter_names(target))
    return (*robot.parameter_names, *places), (*robot.parameter_units, *("mm" for _ in places))


def _columns(
    robot: Robot,
    q: Array,
    setup: NDArray[np.str_],
    residual: str,
    *,
    frame_known: bool,
    targets: tuple[Target, ...] = (),
    of_target: IndexArray | None = None,
) -> tuple[Array, Array]:
    """The Jacobian (R, P) of what a residual compares, and its columns' norms (P,) before unknowns are projected out.

    q  # (N, n); setup  # (N,), whose first pose is the one that distances start from
    of_target  # (N,) which of `targets` is seen in each row, -1 for the tool point; None: nothing else
    """
    if residual not in RESIDUAL_KINDS:
        raise FitError(f"no residual named {residual!r}; there are {', '.join(RESIDUAL_KINDS)}")
    chain = kinematics.forward(robot.table, q, robot.is_revolute, robot.base_T_first)
    points_mm = chain.target_mm
    if of_target is None:
        columns = kinematics.point_jacobian(chain, points_mm).reshape(len(q), 3, -1)
    else:
        points_mm, columns = _columns_of_targets(chain, targets, of_target)
    setups = [np.flatnonzero(setup == name) for name in np.unique(setup)]
    if residual == "distance":
        distances = [_distance_columns(chain.target_mm[rows], columns[rows]) for rows in setups]
        return np.concatenate(distances), np.linalg.norm(columns, axis=(0, 1))
    absorbed = []
    if not frame_known or residual == "pairs":
        absorbed = [_motion(points_mm, rows) for rows in setups]
    if residual == "pose":
        turn = MM_PER_RADIAN * kinematics.turn_jacobian(chain).reshape(len(q), 3, -1)
        turn = np.concatenate([turn, np.zeros((len(q), 3, columns.shape[-1] - turn.shape[-1]))], axis=2)
        columns = np.concatenate([columns, turn], axis=1)
        seat = np.zeros((len(q), 6, 3))
        seat[:, 3:] = MM_PER_RADIAN * chain.base_T_frame[:, -1, :3, :3]
        absorbed.append(seat)
        if of_target is not None:  # further targets have no orientation
            for block in (columns, *absorbed):
                block[of_target >= 0, 3:] = 0.0
    moved = np.linalg.norm(columns, axis=(0, 1))
    columns = np.asarray(columns.reshape(-1, columns.shape[-1]), dtype=np.float64)
    if absorbed:
        height = len(columns) // len(q)  # 3 rows a position, 6 a full pose
        basis = orthonormal(
            np.concatenate([a[:, :height] for a in absorbed], axis=2).reshape(len(columns), -1)
        )
        columns = columns - basis @ (basis.T @ columns)
    return columns, moved


def _columns_of_targets(
    chain: kinematics.Chain, targets: tuple[Target, ...], of_target: IndexArray
) -> tuple[Array, Array]:
    """The points (N, 3), each of its target, and their derivative by table and targets' places (N, 3, P)."""
    points_mm = chain.target_mm.copy()
    by_table = kinematics.point_jacobian(chain, points_mm)
    by_place = np.zeros((len(of_target), 3, len(targets), 3))
    for k, target in enumerate(targets):
        rows = of_target == k
        link = chain.base_T_link(target.joint)
        points_mm[rows] = (link[:, :3, :3] @ np.array(target.xyz_mm) + link[:, :3, 3])[rows]
        by_table[rows] = kinematics.link_point_jacobian(chain, points_mm, target.joint)[rows]
        by_place[rows, :, k] = link[rows, :3, :3]
    return points_mm, np.concatenate(
        [part.reshape(len(of_target), 3, -1) for part in (by_table, by_place)], axis=2
    )


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
