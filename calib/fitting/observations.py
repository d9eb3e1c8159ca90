"""Observations of a fit: some of a dataset's measured points, each with its covariance, and the model's predictions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib import frames
from calib.array_types import Array, BoolArray, IndexArray
from calib.brief import Brief
from calib.dataset.dataset import Dataset, Points, Poses
from calib.effects.state import RobotState, Seen
from calib.errors import FitError
from calib.fitting.model import Model, geometric_model, place_of_target
from calib.fitting.noise.point_covariance import noise_factors, shaped_covariance
from calib.fitting.pose_means import mean_by_pose, points_by_pose
from calib.fitting.scanner_frame import fit_scanner_frame
from calib.kinematics import chain as kinematics
from calib.kinematics.hand_eye import HandEye, solve_hand_eye, with_world_targets
from calib.kinematics.robot import Robot
from calib.noise_shape import NoiseShape

UNDECLARED_SIGMA_MM = 1.0
"""What stands for a point's sigma where none is declared; only ratios of it count then."""
BEST_SIGMA_MM = 0.01
"""The least noise of an instrument that measures arms (a laser tracker near by), where none is declared."""


@dataclass(frozen=True)
class Observations(Brief):
    """M measured points of some poses, each with its covariance."""

    poses: Poses
    points: Points
    covariance_mm2: Array  # (M, 3, 3)
    # (4, 4) by setup, scanner_T_flange where the arm carries the scanner; None: not known yet
    scanner_T_base: Mapping[str, Array] | None = None
    turn_covariance_rad2: Array | None = None  # (M, 3, 3) of the orientations, where there are any
    carried_by: Robot | None = None  # the nominal arm that carries the scanner; None: it stands in the room
    noise_floor: float = 1.0  # the least that the noise can be, over what the covariances say

    @classmethod
    def of(cls, dataset: Dataset, keep: ArrayLike | None = None) -> Observations:
        """The dataset's points whose pose is in `keep` (N,) bool; the training and reference poses by default.

        A point's covariance is its own where it has one, else the scanner's declared sigma, else 1 mm, reshaped where
        the dataset knows the noise's shape; over the number of measurements that it counts as.
        """
        if dataset.points is None:
            raise FitError(f"dataset {dataset.name}: no measured points yet; find the corners of its scans first")
        chosen = ~dataset.poses.is_test if keep is None else np.asarray(keep, dtype=bool)
        points = dataset.points.select(chosen[dataset.points.pose])
        bad = np.flatnonzero(~np.all(np.isfinite(points.xyz_mm), axis=1))
        if len(bad):
            pose = dataset.poses.ids[points.pose[bad[0]]]
            raise FitError(
                f"dataset {dataset.name}: the point of pose {pose!r} is not finite; leave it out or measure it again"
            )
        covariance = points.covariance_mm2
        floor = 1.0
        if covariance is None:
            sigma_mm = dataset.scanner.point_sigma_mm
            if sigma_mm is None:
                sigma_mm, floor = UNDECLARED_SIGMA_MM, BEST_SIGMA_MM / UNDECLARED_SIGMA_MM
            covariance = np.broadcast_to(sigma_mm**2 * np.eye(3), (len(points), 3, 3))
        turns = None if points.orientations is None else points.orientations.covariance_rad2
        if turns is None and dataset.scanner.orientation_sigma_rad is not None:
            sigma_rad = dataset.scanner.orientation_sigma_rad
            turns = np.broadcast_to(sigma_rad**2 * np.eye(3), (len(points), 3, 3))
        if dataset.noise is not None and dataset.noise.reshapes_points:
            points, covariance = _reshaped(dataset.noise, points, covariance)
        arm = dataset.robot if dataset.robot.carries_scanner else None
        observed = cls(dataset.poses, points, covariance, turn_covariance_rad2=turns, carried_by=arm, noise_floor=floor)
        return observed if points.counts_as is None else weighted(observed, points.counts_as)

    def select(self, keep: BoolArray) -> Observations:
        """The points where `keep` (M,); no scanner's frame is known then."""
        turns = self.turn_covariance_rad2
        return replace(
            self,
            points=self.points.select(keep),
            covariance_mm2=self.covariance_mm2[keep],
            turn_covariance_rad2=None if turns is None else turns[keep],
            scanner_T_base=None,
        )

    @property
    def setup(self) -> NDArray[np.str_]:
        """(M,)"""
        return self.poses.setup[self.points.pose]

    @cached_property
    def used_poses(self) -> tuple[Poses, IndexArray]:
        """The poses that have points, and for each point its row among them (M,)."""
        used, row = np.unique(self.points.pose, return_inverse=True)
        return self.poses.select(used), row

    @cached_property
    def targets(self) -> Mapping[str, BoolArray]:
        """Which targets were measured, and which points are of each (M,)."""
        return {str(name): self.points.target == name for name in np.unique(self.points.target)}

    @property
    def first_target(self) -> str:
        """The jig where it was measured, else another target."""
        return "jig" if "jig" in self.targets else next(iter(self.targets))

    def seen(self, target: str = "jig") -> Seen | None:
        """A target's mean measured position and the scanner's frame at each used pose; None where no frame is known.

        Effects of the scanner depend on both.
        """
        return self._seen.get(target) if self.scanner_T_base is not None else None

    def scanner_T_base_at(self, poses: Poses) -> Array:
        """(N, 4, 4) where the base is, seen from the scanner as it was placed, at any poses of the setups."""
        assert self.scanner_T_base is not None
        placed = np.stack([self.scanner_T_base[str(name)] for name in poses.setup])
        if self.carried_by is None:
            return placed
        arm = self.carried_by
        chain = kinematics.forward(arm.table, poses.q, arm.is_revolute, arm.base_T_first)
        return placed @ frames.invert(chain.base_T_flange)

    @cached_property
    def _seen(self) -> dict[str, Seen]:
        poses, row = self.used_poses
        placed = self.scanner_T_base_at(poses)
        out = {}
        for target, of_target in self.targets.items():
            mean_mm = mean_by_pose(self.points.xyz_mm[of_target], row[of_target], len(poses))
            out[target] = Seen(mean_mm, placed)
        return out


def _reshaped(noise: NoiseShape, points: Points, covariance_mm2: Array) -> tuple[Points, Array]:
    """The points, and their covariances (M, 3, 3), under a shape of the noise."""
    factors = noise_factors(noise, points.xyz_mm)
    if points.orientations is not None and points.orientations.cross_mm_rad is not None:
        cross = factors @ points.orientations.cross_mm_rad
        points = replace(points, orientations=replace(points.orientations, cross_mm_rad=cross))
    return points, shaped_covariance(factors, covariance_mm2)


def weighted(observed: Observations, weights: Array) -> Observations:
    """The same points with their covariances, those of the orientations too, divided by weights (M,) above 0."""
    share = 1.0 / weights[:, None, None]
    turns, points = observed.turn_covariance_rad2, observed.points
    if points.orientations is not None and points.orientations.cross_mm_rad is not None:
        cross = share * points.orientations.cross_mm_rad
        points = replace(points, orientations=replace(points.orientations, cross_mm_rad=cross))
    return replace(
        observed,
        points=points,
        covariance_mm2=share * observed.covariance_mm2,
        turn_covariance_rad2=None if turns is None else share * turns,
    )


def with_scanner_frames(
    observed: Observations, model: Model, x: Array, chosen: BoolArray | None = None
) -> Observations:
    """The observations with the scanner's frame of each setup, fitted to the model's predictions at x (P,).

    Frames are fitted to the points in `chosen` (M,), all where None; a setup without chosen points uses its own.
    """
    base_mm = predict_points(model, x, observed)
    placed = {}
    for name in map(str, np.unique(observed.setup)):
        rows = observed.setup == name
        fitted = rows if chosen is None or not np.any(rows & chosen) else rows & chosen
        placed[name] = fit_scanner_frame(
            base_mm[fitted], observed.points.xyz_mm[fitted], observed.covariance_mm2[fitted]
        )
    return replace(observed, scanner_T_base=placed)


def with_nominal_scanner_frames(observed: Observations, robot: Robot, chosen: BoolArray | None = None) -> Observations:
    """The observations with scanner frames (`with_scanner_frames`) fitted to the nominal robot without effects.

    Effects of the scanner depend on where it stands; every fit and every evaluation takes these frames for them.
    """
    nominal = geometric_model(in_room(robot, observed))
    return with_scanner_frames(observed, nominal, np.zeros(len(nominal.parameters)), chosen)


def in_room(robot: Robot, observed: Observations) -> Robot:
    """The robot with the observed targets placed in the room, where its arm carries the scanner; else as it is."""
    known = {target.name for target in robot.targets if target.in_room}
    if not robot.carries_scanner or known >= set(observed.targets):
        return robot
    return with_world_targets(robot, room_placement(robot, observed).position_mm)


def room_placement(robot: Robot, observed: Observations) -> HandEye:
    """Where the scanner sits on the flange and the targets stand in the room, by the robot's table alone."""
    poses, row = observed.used_poses
    chain = kinematics.forward(robot.table, poses.q, robot.is_revolute, robot.base_T_first)
    points = observed.points
    turns = None if points.orientations is None else points.orientations.scanner_R_jig
    return solve_hand_eye(chain.base_T_flange[row], points.xyz_mm, observed.setup, points.target, turns)


def nominal_state(dataset: Dataset) -> RobotState:
    """The nominal robot's state at the measured poses, with the nominal scanner frames; effects are tried on it.

    Raises FitError where nothing was measured.
    """
    observed = Observations.of(dataset)
    robot = in_room(dataset.robot, observed)
    observed = with_nominal_scanner_frames(observed, robot)
    return RobotState.nominal(robot, observed.used_poses[0], observed.seen(observed.first_target))


def predict_points(model: Model, x: Array, observed: Observations) -> Array:
    """The predicted position of each observed point (M, 3), mm in the base frame, at x (P,)."""
    poses, row = observed.used_poses
    out = np.empty((len(observed.points), 3))
    for target, of_target in observed.targets.items():
        out[of_target] = model.predict(x, poses, target, observed.seen(target))[row[of_target]]
    return out


def linearise_points(model: Model, x: Array, observed: Observations) -> tuple[Array, Array]:
    """The predicted points (`predict_points`) and their derivative by the model's free parameters (M, 3, P)."""
    poses, row = observed.used_poses
    points_mm = np.empty((len(observed.points), 3))
    jacobian = np.empty((len(observed.points), 3, len(model.parameters)))
    for target, of_target in observed.targets.items():
        at, by = model.linearise(x, poses, target, observed.seen(target))
        points_mm[of_target], jacobian[of_target] = at[row[of_target]], by[row[of_target]]
    return points_mm, jacobian


def linearise_poses(model: Model, x: Array, observed: Observations) -> tuple[Array, Array, Array]:
    """Predicted positions (M, 3) and base_R_tool (M, 3, 3) of the observed points, and their derivative (M, 6, P).

    Its last three rows are the small turn about the base's axes, rad. Targets other than the jig have a position only;
    their turn is the tool's.
    """
    poses, row = observed.used_poses
    is_jig = observed.points.target == "jig"
    points_mm, jacobian = linearise_points(model, x, observed) if not is_jig.all() else (None, None)
    at, attitude, by = model.linearise_pose(x, poses, observed.seen("jig"))
    if points_mm is None or jacobian is None:
        return at[row], attitude[row], by[row]
    both = np.concatenate([jacobian, by[row][:, 3:]], axis=1)
    return points_mm, attitude[row], both


def predict_poses(model: Model, x: Array, observed: Observations) -> tuple[Array, Array]:
    """Predicted positions (M, 3) of the observed points, mm in the base frame, and base_R_tool (M, 3, 3)."""
    poses, row = observed.used_poses
    state = model.state(x, poses, observed.seen("jig"))
    if np.all(observed.points.target == "jig"):
        return place_of_target(state)[row], state.attitude[row]
    return predict_points(model, x, observed), state.attitude[row]


def mean_jig_points(observed: Observations) -> tuple[BoolArray, Array, Array]:
    """Per used pose: whether it has a "jig" point, the repeats' mean (N, 3), and its covariance (N, 3, 3)."""
    poses, row = observed.used_poses
    is_jig = observed.points.target == "jig"
    row = row[is_jig]
    mean = mean_by_pose(observed.points.xyz_mm[is_jig], row, len(poses))
    covariance = mean_by_pose(observed.covariance_mm2[is_jig], row, len(poses))
    count = points_by_pose(row, len(poses))
    return count > 0, mean, covariance / np.maximum(count, 1)[:, None, None]


def setup_references(poses: Poses, usable: BoolArray) -> dict[str, int]:
    """By setup the pose (row) that its distances start from: the reference, else the first usable pose."""
    rows = np.flatnonzero(usable)
    names, first = np.unique(poses.setup[rows], return_index=True)
    out = {str(name): int(rows[i]) for name, i in zip(names, first, strict=True)}
    return out | {str(poses.setup[i]): int(i) for i in rows[poses.role[rows] == "reference"]}


def conditions_at(like: Poses, q: Array) -> Poses:
    """Poses at further joint vectors q (N, n), under the payload and all other conditions of the first pose."""
    poses = like.select(np.zeros(len(q), dtype=np.int64))
    return Poses(
        ids=tuple(f"q{i + 1}" for i in range(len(q))),
        role=np.full(len(q), "test"),
        q=q,
        setup=poses.setup,
        scan_names=poses.scan_names,
        payload_kg=poses.payload_kg,
        temperature_c=poses.temperature_c,
        time_s=poses.time_s,
        approach=poses.approach,
        extra=poses.extra.reset_index(drop=True),
    ).measured_later()
