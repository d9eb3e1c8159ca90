"""Structural identifiability: which parameters a kind of measurement can determine, by the nominal robot's Jacobian.

Positions and full poses are analysed with the scanner's frame known, as in Park 2022, or unknown, as in a fit: then the
effect of a motion of the frame is projected out of the columns. Distances to a reference pose (Jang 2025 eq 14) need no
frame; d1, theta1 and beta1 do not change them. For an arm that moves in a plane they determine less than positions do:
a motion out of the plane changes no distance, to first order.

The jig's orientation on the tool is unknown in any case, so its effect is projected out of full poses too.

Where the arm carries the scanner, the frame that is known or unknown is that on the flange. The positions of the
targets in the world are unknown in any case: they are parameters, and the jig's orientation there is projected out of
full poses.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.blas_threads import one_blas_thread
from calib.dataset.dataset import Dataset
from calib.effects.link_errors import target_parameter_names
from calib.errors import FitError
from calib.fitting.observations import Observations, with_observed_targets
from calib.identifiability.columns import columns_of
from calib.identifiability.redundancy import Redundancy, analyse
from calib.kinematics.robot import Robot, Target
from calib.options import RESIDUAL_KINDS

_KNOWN = "in the base frame, as if the scanner's place were known (Park)"
MEASURED_BY = {
    "position": f"positions of the tool point {_KNOWN}",
    "pose": f"full poses, place and attitude of a jig in an unknown orientation on the tool, {_KNOWN}",
    "distance": "distances to the reference pose, which need no scanner's place (Jang)",
    "pairs": "the distances between all poses, which are positions from an unknown place",
}
"""Measurement of each kind of residual, as text."""
_KNOWN_ON_FLANGE = "as if the scanner's place on the flange were known"
MEASURED_FROM_FLANGE = {
    "position": f"positions of targets in the world, seen from the flange, {_KNOWN_ON_FLANGE}",
    "pose": f"full poses of a jig in an unknown orientation in the world, seen from the flange, {_KNOWN_ON_FLANGE}",
}
"""Measurement of each kind of residual (`MEASURED_BY`) for an arm that carries the scanner."""
_SOMEWHERE_MM = (431.0, -287.0, 123.0)
_OBSERVED = {"position": "the measured point", "pose": "the full pose, apart from the jig's unknown orientation"}


@one_blas_thread()
def redundancy_of(dataset: Dataset, *, residual: str = "position") -> Redundancy:
    """Redundancy of parameters at a dataset's training poses, as `calib.redundancy` describes it."""
    columns, norms, names, units = _at_training_poses(dataset, residual, frame_known=True)
    return analyse(
        columns,
        names,
        units,
        unprojected_norms=norms,
        measured_by=(MEASURED_FROM_FLANGE if dataset.robot.carries_scanner else MEASURED_BY)[residual],
        observed=_OBSERVED.get(residual, "the distances"),
    )


def absorbed_by_scanner_frame(dataset: Dataset) -> tuple[str, ...]:
    """Parameters that act like a motion of the scanner's frame at the training poses, so no fit finds them."""
    if not dataset.robot.carries_scanner:
        try:
            return redundancy_of(dataset, residual="distance").no_influence
        except FitError:  # all training poses have the target at one point: no distance, and the frame absorbs all
            pass
    columns, norms, names, units = _at_training_poses(dataset, "position", frame_known=False)
    return analyse(columns, names, units, unprojected_norms=norms).no_influence


@dataclass(frozen=True)
class FreeFrameRank:
    """Number of identifiable parameters with an unknown scanner frame: at the dataset's poses, and at best."""

    residual: str
    here: int  # at the dataset's training poses
    best: Mapping[str, int]  # by kind of residual, at generic poses of this arm
    on_flange: bool = False  # the arm carries the scanner


def free_frame_rank(dataset: Dataset, *, residual: str = "position") -> FreeFrameRank:
    """Numbers of parameters identifiable with an unknown scanner frame: at the dataset's poses and at best."""
    columns, norms, names, units = _at_training_poses(dataset, residual, frame_known=False)
    here = analyse(columns, names, units, unprojected_norms=norms).rank
    measured = _measured_targets(dataset)
    on_flange = dataset.robot.carries_scanner
    kinds = [kind for kind in RESIDUAL_KINDS if not on_flange or kind in _OBSERVED]
    best = {kind: structural_rank(dataset.robot, residual=kind, measured=measured) for kind in kinds}
    return FreeFrameRank(residual, here, best, on_flange)


def structural_rank(robot: Robot, *, residual: str = "position", measured: Collection[str] = ("jig",)) -> int:
    """Number of parameters of an arm that a kind of residual can identify at best, with the scanner's frame unknown.

    `measured`: targets that are measured at every pose; their positions are unknown, except the tool's end ("jig").
    """
    rng, poses = np.random.default_rng(0), 200  # any generic poses give the same rank
    span = np.where(robot.is_revolute, np.pi, 500.0)
    q = rng.uniform(-1.0, 1.0, (poses, robot.n_joints)) * span
    targets = _further_targets(robot, measured, residual)
    of_target = None
    if targets and not robot.carries_scanner:
        row_end = "jig" in measured and all(target.name != "jig" for target in targets)
        measured_rows = [*([-1] if row_end else []), *range(len(targets))]
        of_target = np.tile(measured_rows, poses)
        q = np.repeat(q, len(measured_rows), axis=0)
    if robot.carries_scanner:
        of_target, q = np.tile(np.arange(len(targets)), poses), np.repeat(q, len(targets), axis=0)
    columns, norms = columns_of(
        robot, q, np.full(len(q), ""), residual, frame_known=False, targets=targets, of_target=of_target
    )
    if len(columns) < 2:  # the target never moves: no two positions of it, and no distance
        return 0
    return analyse(columns, *_names_and_units(robot, targets), unprojected_norms=norms).rank


def fewest_poses(robot: Robot, *, residual: str = "position", setups: int = 1, rank: int = 0) -> int:
    """Fewest different poses that a fit needs to have one equation more than unknowns.

    Each setup's frame takes six equations of positions or poses, and one pose of distances; the jig's orientation on
    the tool takes three of poses. That leaves about one degree of freedom; a good measurement has three times as many.

    Args:
        setups: number of placements of the scanner.
        rank: of the fit, where effects make it larger than the arm's.
    """
    each, unknowns = {"distance": (1, setups), "pose": (6, 6 * setups + 3)}.get(residual, (3, 6 * setups))
    return (max(structural_rank(robot, residual=residual), rank) + unknowns) // each + 1


def _at_training_poses(
    dataset: Dataset, residual: str, *, frame_known: bool
) -> tuple[Array, Array, tuple[str, ...], tuple[str, ...]]:
    """Jacobian columns at the training poses, their norms, names and units.

    Further targets that were measured there have rows of their own, and columns for their positions; distances are of
    the tool point alone.
    """
    poses, robot = dataset.poses, dataset.robot
    if dataset.points is not None:
        robot = with_observed_targets(robot, Observations.of(dataset))
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
            if str(name) in order  # distances are of the tool point alone
        )
        rows = [pose for pose, _ in pairs]
        of_target = np.array([target for _, target in pairs])
    columns, norms = columns_of(
        robot, poses.q[rows], poses.setup[rows], residual, frame_known=frame_known, targets=targets, of_target=of_target
    )
    if len(columns) < 2:
        raise FitError(
            f"dataset {dataset.name}: its training poses give {len(columns)} distances between different places of one "
            "setup; two or more are needed"
        )
    return columns, norms, *_names_and_units(robot, targets)


def _measured_targets(dataset: Dataset) -> set[str]:
    """Names of the targets that were measured at training poses; the tool's end where there are no points yet."""
    points = dataset.points
    if points is None:
        return {"jig"}
    return set(points.target[~dataset.poses.is_test[points.pose]].tolist())


def _further_targets(robot: Robot, measured: Collection[str], residual: str) -> tuple[Target, ...]:
    """Targets whose positions are unknown in a fit; in a fit of distances, the tool point alone.

    Targets in the world that were not located yet get an arbitrary position off the axes of the arm.
    """
    if robot.carries_scanner:
        known = {target.name: target for target in robot.targets if target.in_world}
        return tuple(known.get(name, Target(name, _SOMEWHERE_MM, in_world=True)) for name in sorted(measured))
    return tuple(t for t in robot.targets if t.name in measured and (residual != "distance" or t.name == "jig"))


def _names_and_units(robot: Robot, targets: tuple[Target, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the Jacobian's columns: the table's entries, then the targets' coordinates."""
    positions = tuple(name for target in targets for name in target_parameter_names(target))
    return (*robot.parameter_names, *positions), (*robot.parameter_units, *("mm" for _ in positions))
