"""Observations of a fit: measured points with covariances and scanner frames, and the model's predictions of them."""

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
from calib.fitting.noise import noise_factors, shaped_covariance
from calib.fitting.scanner_frame import fit_scanner_frame, whitener
from calib.frames import frames_by_name
from calib.kinematics import chain as kinematics
from calib.kinematics.hand_eye import HandEye, solve_hand_eye, with_world_targets
from calib.kinematics.robot import Robot
from calib.noise_shape import NoiseShape
from calib.statistics import group_means

UNDECLARED_SIGMA_MM = 1.0
"""Sigma of a point where none is declared; then only ratios of sigmas matter."""
BEST_SIGMA_MM = 0.01
"""The least noise of an instrument that measures arms (a laser tracker near by), where none is declared."""


@dataclass(frozen=True)
class Observations(Brief):
    """M measured points of some poses with their covariances and, where known, the scanner's frames."""

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
        """Observations of the dataset's points at chosen poses, by default the training and reference poses.

        A point's covariance is its own where it has one, else the scanner's declared sigma, else 1 mm, reshaped where
        the dataset knows the noise's shape; divided by the number of measurements that it counts as.
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
        sigma_mm = dataset.scanner.point_sigma_mm or UNDECLARED_SIGMA_MM
        floor = 1.0 if dataset.declares_noise else min(BEST_SIGMA_MM / sigma_mm, 1.0)
        if covariance is None:
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

    @classmethod
    def of_all(cls, dataset: Dataset) -> Observations:
        """Observations of the dataset's points at all poses, test poses too."""
        return cls.of(dataset, np.ones(len(dataset.poses), dtype=bool))

    def rows_of_setups(self) -> Mapping[str, IndexArray]:
        """Rows of the points of each setup, by its name."""
        return {str(name): np.flatnonzero(self.setup == name) for name in np.unique(self.setup)}

    def select(self, keep: BoolArray) -> Observations:
        """Observations restricted to the points where `keep` (M,) is True, without scanner frames."""
        turns = self.turn_covariance_rad2
        return replace(
            self,
            points=self.points.select(keep),
            covariance_mm2=self.covariance_mm2[keep],
            turn_covariance_rad2=None if turns is None else turns[keep],
            scanner_T_base=None,
        )

    @cached_property
    def setup(self) -> NDArray[np.str_]:
        """Name (M,) of each point's setup; of a length with its anchor, which has a frame of its own."""
        setup, lengths = self.poses.setup[self.points.pose], self.points.lengths
        if lengths is None or not np.any(lengths.anchor != ""):
            return setup
        return np.array([f"{one} {anchor}".strip() for one, anchor in zip(setup, lengths.anchor, strict=True)])

    @cached_property
    def whiten(self) -> Array:
        """Matrices (M, C, 3) that whiten the errors of points; C, the coordinates a point tells, is 1 for a length."""
        whiten = whitener(self.covariance_mm2)
        if self.points.lengths is None:
            return whiten
        along = self.points.lengths.direction
        variance = np.einsum("mi,mij,mj->m", along, self.covariance_mm2, along)
        return (along / np.sqrt(variance)[:, None])[:, None, :]

    def fit_frame(self, base_mm: Array, rows: ArrayLike) -> Array:
        """Scanner frame (4, 4) of some points, a mask (M,) or row numbers, fitted to predicted points (M, 3)."""
        rows, lengths = np.asarray(rows), self.points.lengths
        if self.frame_is_known(rows) and lengths is not None:
            return frames.make_transform(np.eye(3), -lengths.place_mm[rows][0])
        whiten = None if lengths is None else self.whiten[rows]
        return fit_scanner_frame(base_mm[rows], self.points.xyz_mm[rows], self.covariance_mm2[rows], whiten)

    def frame_is_known(self, rows: ArrayLike) -> bool:
        """Whether the frame of some points is not fitted: that of lengths from an anchor of known place."""
        lengths = self.points.lengths
        return lengths is not None and bool(np.isfinite(lengths.place_mm[np.asarray(rows)]).all())

    def errors_mm(self, scanner_T_base: Array, base_mm: Array, rows: ArrayLike) -> Array:
        """Predicted minus measured points (K, 3), mm, scanner frame; of lengths along their lines alone."""
        rows, lengths = np.asarray(rows), self.points.lengths
        error_mm = frames.apply(scanner_T_base, base_mm[rows]) - self.points.xyz_mm[rows]
        if lengths is None:
            return error_mm
        along = lengths.direction[rows]
        return np.sum(error_mm * along, axis=1, keepdims=True) * along

    @cached_property
    def used_poses(self) -> tuple[Poses, IndexArray]:
        """Poses that have points, and for each point (M,) the row of its pose among them."""
        used, row = np.unique(self.points.pose, return_inverse=True)
        return self.poses.select(used), row

    @cached_property
    def targets(self) -> Mapping[str, BoolArray]:
        """Masks (M,) of the points of each measured target, by name."""
        return {str(name): self.points.target == name for name in np.unique(self.points.target)}

    @property
    def first_target(self) -> str:
        """Name of the jig where it was measured, else of the first other target."""
        return "jig" if "jig" in self.targets else next(iter(self.targets))

    def seen(self, target: str = "jig") -> Seen | None:
        """Mean measured position of a target and scanner frame at each used pose; None where no frame is known.

        Effects of the scanner depend on both.
        """
        known = self.scanner_T_base is not None and self.points.lengths is None
        return self._seen.get(target) if known else None

    def scanner_T_base_at(self, poses: Poses) -> Array:
        """Transforms scanner_T_base (N, 4, 4) at any poses of the observed setups."""
        assert self.scanner_T_base is not None
        placed = frames_by_name(self.scanner_T_base, poses.setup)
        if self.carried_by is None:
            return placed
        arm = self.carried_by
        chain = kinematics.nominal_chain(arm, poses.q)
        return placed @ frames.invert(chain.base_T_flange)

    @cached_property
    def _seen(self) -> dict[str, Seen]:
        poses, row = self.used_poses
        placed = self.scanner_T_base_at(poses)
        out = {}
        for target, of_target in self.targets.items():
            mean_mm = group_means(self.points.xyz_mm[of_target], row[of_target], len(poses))
            out[target] = Seen(mean_mm, placed)
        return out


def _reshaped(noise: NoiseShape, points: Points, covariance_mm2: Array) -> tuple[Points, Array]:
    """Points and their covariances (M, 3, 3), mm^2, changed from the declared noise to a noise shape."""
    factors = noise_factors(noise, points.xyz_mm)
    if points.orientations is not None and points.orientations.cross_mm_rad is not None:
        cross = factors @ points.orientations.cross_mm_rad
        points = replace(points, orientations=replace(points.orientations, cross_mm_rad=cross))
    return points, shaped_covariance(factors, covariance_mm2)


def weighted(observed: Observations, weights: Array) -> Observations:
    """Observations with the covariances of points and orientations divided by weights (M,) above 0."""
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
    """Observations with each setup's scanner frame fitted to the model's predictions at x (P,).

    Frames are fitted to the points in `chosen` (M,), all where None; a setup without chosen points uses its own.
    """
    base_mm = predict_points(model, x, observed)
    placed = {}
    for name in map(str, np.unique(observed.setup)):
        rows = observed.setup == name
        fitted = rows if chosen is None or not np.any(rows & chosen) else rows & chosen
        placed[name] = observed.fit_frame(base_mm, fitted)
    return replace(observed, scanner_T_base=placed)


def with_nominal_scanner_frames(observed: Observations, robot: Robot, chosen: BoolArray | None = None) -> Observations:
    """Observations with each setup's scanner frame fitted to the nominal robot without effects.

    Effects of the scanner depend on its place; every fit and every evaluation uses these frames for them.
    """
    nominal = geometric_model(with_observed_targets(robot, observed))
    return with_scanner_frames(observed, nominal, np.zeros(len(nominal.parameters)), chosen)


def with_observed_targets(robot: Robot, observed: Observations) -> Robot:
    """Robot with the measured targets placed in the world if its arm carries the scanner, else unchanged."""
    known = {target.name for target in robot.targets if target.in_world}
    if not robot.carries_scanner or known >= set(observed.targets):
        return robot
    return with_world_targets(robot, observed_hand_eye(robot, observed).position_mm)


def observed_hand_eye(robot: Robot, observed: Observations) -> HandEye:
    """Pose of the scanner on the flange and of the targets in the world, from the points and the nominal table."""
    poses, row = observed.used_poses
    chain = kinematics.nominal_chain(robot, poses.q)
    points = observed.points
    turns = None if points.orientations is None else points.orientations.scanner_R_jig
    return solve_hand_eye(chain.base_T_flange[row], points.xyz_mm, observed.setup, points.target, turns)


def nominal_state(dataset: Dataset) -> RobotState:
    """State of the nominal robot at the measured poses, with scanner frames fitted to the nominal robot.

    Raises FitError where nothing was measured.
    """
    observed = Observations.of(dataset)
    robot = with_observed_targets(dataset.robot, observed)
    observed = with_nominal_scanner_frames(observed, robot)
    return RobotState.nominal(robot, observed.used_poses[0], observed.seen(observed.first_target))


def predict_points(model: Model, x: Array, observed: Observations) -> Array:
    """Predicted positions (M, 3) of the observed points, mm in the base frame, at x (P,)."""
    poses, row = observed.used_poses
    out = np.empty((len(observed.points), 3))
    for target, of_target in observed.targets.items():
        out[of_target] = model.predict(x, poses, target, observed.seen(target))[row[of_target]]
    return out


def linearise_points(model: Model, x: Array, observed: Observations) -> tuple[Array, Array]:
    """Predicted positions (M, 3) of the observed points, mm in the base frame, and their derivative (M, 3, P)."""
    poses, row = observed.used_poses
    points_mm = np.empty((len(observed.points), 3))
    jacobian = np.empty((len(observed.points), 3, len(model.parameters)))
    for target, of_target in observed.targets.items():
        at, by = model.linearise(x, poses, target, observed.seen(target))
        points_mm[of_target], jacobian[of_target] = at[row[of_target]], by[row[of_target]]
    return points_mm, jacobian


def linearise_poses(model: Model, x: Array, observed: Observations) -> tuple[Array, Array, Array]:
    """Predicted positions (M, 3) and base_R_tool (M, 3, 3) of the observed points, and their derivative (M, 6, P).

    The last three rows of the derivative are the small turn about the base's axes, rad. For targets other than the jig,
    which have a position only, the orientation is the tool's.
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
    """Mask (N,) of poses with a jig point; their mean jig points (N, 3), mm, and covariances (N, 3, 3)."""
    poses, row = observed.used_poses
    is_jig = observed.points.target == "jig"
    row = row[is_jig]
    mean = group_means(observed.points.xyz_mm[is_jig], row, len(poses))
    covariance = group_means(observed.covariance_mm2[is_jig], row, len(poses))
    count = np.bincount(row, minlength=len(poses))
    return count > 0, mean, covariance / np.maximum(count, 1)[:, None, None]


def setup_references(poses: Poses, usable: BoolArray) -> dict[str, int]:
    """Row, by setup, of the pose that distances are measured from: the reference pose, else the first usable one."""
    rows = np.flatnonzero(usable)
    names, first = np.unique(poses.setup[rows], return_index=True)
    out = {str(name): int(rows[i]) for name, i in zip(names, first, strict=True)}
    return out | {str(poses.setup[i]): int(i) for i in rows[poses.role[rows] == "reference"]}


def conditions_at(like: Poses, q: Array) -> Poses:
    """Poses at joint vectors q (N, n), under the payload and other conditions of the first of given poses."""
    poses = like.select(np.zeros(len(q), dtype=np.int64))
    ids = tuple(f"q{i + 1}" for i in range(len(q)))
    return replace(poses, ids=ids, role=np.full(len(q), "test"), q=q).measured_later()
