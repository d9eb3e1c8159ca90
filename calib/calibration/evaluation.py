"""Errors of a model at the measured points, mm, for training and test poses separately.

Positions are compared in the scanner's frame, which is fitted to the training poses of each setup alone, never to test
poses. Distances run from the reference pose, as in Jang 2025 (section 3.2, figure 15).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import nan

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray, IndexArray
from calib.brief import Brief
from calib.dataset.dataset import Dataset, Poses
from calib.dataset.lengths import with_directions
from calib.dataset.repeats import in_repeat_groups_of
from calib.effects.catalogue.order_steps import in_gap_of_steps
from calib.fitting.model import Model
from calib.fitting.observations import (
    Observations,
    mean_jig_points,
    predict_points,
    setup_references,
    with_nominal_scanner_frames,
)
from calib.frames import frames_by_name
from calib.lazy_modules import pd
from calib.statistics import rms

_LINE_ROUNDS = 4  # in which the lines of measured lengths are made anew


@dataclass(frozen=True)
class Figures:
    """Error statistics of a set of poses: RMSE, maximum and mean of the 3D error, and of errors in distances."""

    points: int
    rmse_mm: float
    max_mm: float
    mean_mm: float
    distance_max_mm: float
    distance_mean_mm: float


@dataclass(frozen=True)
class Evaluation(Brief):
    """Errors of a model at all M measured points of a dataset with N poses, and at its K distances."""

    pose: IndexArray  # (M,)
    error_mm: Array  # (M, 3) predicted minus measured, scanner frame
    distance_pose: IndexArray  # (K,) the far pose of each distance
    distance_error_mm: Array  # (K,) predicted minus measured
    is_test: BoolArray  # (N,) by pose
    scanner_T_base: dict[str, Array]  # by setup; scanner_T_flange where the arm carries the scanner
    notes: tuple[str, ...]
    is_outlier: BoolArray | None = None  # (N,) training poses that a robust fit left out
    is_undecided: BoolArray | None = None  # (N,) test poses of which nobody knows on which side of a step they are

    @property
    def train(self) -> Figures | None:
        """Error statistics of the fitted poses; None where there are none."""
        return self._figures(~self.is_test if self.is_outlier is None else ~self.is_test & ~self.is_outlier)

    @property
    def test(self) -> Figures | None:
        """Error statistics of the test poses, without those beside a step in the model; None where there are none."""
        return self._figures(self.is_tested)

    @property
    def is_tested(self) -> BoolArray:
        """Mask (N,) of the test poses whose errors tell of the model: none between the two sides of a step in it."""
        return self.is_test if self.is_undecided is None else self.is_test & ~self.is_undecided

    @property
    def train_rmse_mm(self) -> float:
        """3D RMSE of the fitted poses; nan where there are none."""
        return nan if self.train is None else self.train.rmse_mm

    @property
    def test_rmse_mm(self) -> float:
        """3D RMSE of the test poses; nan where there are none."""
        return nan if self.test is None else self.test.rmse_mm

    def _figures(self, of_pose: BoolArray) -> Figures | None:
        error = np.linalg.norm(self.error_mm[of_pose[self.pose]], axis=1)
        distance = np.abs(self.distance_error_mm[of_pose[self.distance_pose]])
        if len(error) == 0:
            return None
        return Figures(
            points=len(error),
            rmse_mm=rms(error),
            max_mm=float(error.max()),
            mean_mm=float(error.mean()),
            distance_max_mm=float(distance.max(initial=0.0)),
            distance_mean_mm=float(distance.mean()) if len(distance) else 0.0,
        )

    def to_frame(self, dataset: Dataset) -> pd.DataFrame:
        """Table with one row per measured point: pose, role, setup, error and distance error, mm."""
        poses = dataset.poses
        distance = dict(zip(self.distance_pose.tolist(), self.distance_error_mm.tolist(), strict=True))
        return pd.DataFrame(
            {
                "pose": [poses.ids[i] for i in self.pose],
                "role": poses.role[self.pose],
                "setup": poses.setup[self.pose],
                **{f"error_{axis}_mm": self.error_mm[:, k] for k, axis in enumerate("xyz")},
                "error_mm": np.linalg.norm(self.error_mm, axis=1),
                "distance_error_mm": [distance.get(int(i), float("nan")) for i in self.pose],
            }
        )


def scanner_T_base_of_poses(evaluation: Evaluation, model: Model, x: Array, poses: Poses) -> Array:
    """Transforms scanner_T_base (N, 4, 4) at each pose; nan in setups that have no frame.

    Where the arm carries the scanner they differ from pose to pose.
    """
    unknown = np.full((4, 4), np.nan)
    found = evaluation.scanner_T_base
    if found and not set(map(str, poses.setup)) & set(found):  # of several anchors the first stands for the instrument
        unknown = next(iter(found.values()))
    placed = np.stack([found.get(str(name), unknown) for name in poses.setup])
    if not model.robot.carries_scanner:
        return placed
    return placed @ frames.invert(model.state(x, poses).base_T_flange)


def scanner_T_base_of_points(evaluation: Evaluation, model: Model, x: Array, dataset: Dataset) -> Array:
    """Transforms scanner_T_base (M, 4, 4) at each measured point; of a length that of its anchor."""
    assert dataset.points is not None
    if dataset.points.lengths is None:
        return scanner_T_base_of_poses(evaluation, model, x, dataset.poses)[dataset.points.pose]
    observed = Observations.of_all(dataset)
    return frames_by_name(evaluation.scanner_T_base, observed.setup)


def evaluate(model: Model, x: Array, dataset: Dataset) -> Evaluation:
    """Errors of the model at one parameter vector x (P,), at all points of the dataset."""
    return evaluate_all(model, [x], dataset)[0]


def evaluate_all(model: Model, xs: Sequence[Array], dataset: Dataset, outliers: Sequence[str] = ()) -> list[Evaluation]:
    """Errors of the model at each of several parameter vectors x (P,), at all points of the dataset.

    `outliers`: ids of training poses that a robust fit left out; no frame is fitted to them or their repeats.

    A setup without training poses gets its frame from its own test poses, with a note, as its errors are then the
    scatter about its own best frame and no prediction.
    """
    observed = Observations.of_all(dataset)
    is_outlier = in_repeat_groups_of(dataset, outliers) if outliers else None
    trained = ~dataset.poses.is_test[observed.points.pose]
    if is_outlier is not None:
        trained &= ~is_outlier[observed.points.pose]
    observed = with_nominal_scanner_frames(observed, model.placed_robot, trained)
    setups, notes = [], []
    for name in map(str, np.unique(observed.setup)):
        rows = observed.setup == name
        fitted = rows & trained
        if not fitted.any():
            fitted = rows
            notes.append(f"setup {name!r} has no training pose: its frame comes from its own test poses")
        setups.append((name, rows, fitted))
    distances = _Distances.of(observed, trained)
    undecided = in_gap_of_steps(model.added_effects, dataset.poses)

    def at(x: Array) -> Evaluation:
        base_mm, along = predict_points(model, x, observed), observed
        error_mm = np.empty_like(base_mm)
        frame_of_setup: dict[str, Array] = {}
        for _ in range(1 if observed.points.lengths is None else _LINE_ROUNDS):
            seen_mm = np.empty_like(base_mm)
            for name, rows, fitted in setups:
                frame = along.fit_frame(base_mm, fitted)
                error_mm[rows] = along.errors_mm(frame, base_mm, rows)
                seen_mm[rows] = frames.apply(frame, base_mm[rows])
                frame_of_setup[name] = frame
            if along.points.lengths is not None:
                along = replace(along, points=with_directions(along.points, seen_mm))
        return Evaluation(
            pose=observed.points.pose,
            error_mm=error_mm,
            distance_pose=distances.pose,
            distance_error_mm=distances.error_mm(base_mm),
            is_test=dataset.poses.is_test,
            scanner_T_base=frame_of_setup,
            notes=tuple(notes),
            is_outlier=is_outlier,
            is_undecided=undecided if undecided.any() else None,
        )

    return [at(x) for x in xs]


@dataclass(frozen=True)
class _Distances:
    """K measured distances from each setup's reference pose to its other poses, with the points at both ends."""

    pose: IndexArray  # (K,) the far pose
    far: IndexArray  # (K,) a point of that pose
    near: IndexArray  # (K,) a point of the reference
    measured_mm: Array  # (K,)

    @classmethod
    def of(cls, observed: Observations, trained: BoolArray) -> _Distances:
        """Distances from each setup's reference pose, where possible a fitted one, to all its other poses.

        `trained` (M,) marks the fitted points.
        """
        if observed.points.lengths is not None:  # no two of them make a distance
            none = np.zeros(0, dtype=np.int64)
            return cls(none, none, none, np.zeros(0))
        poses, row = observed.used_poses
        usable, measured_mm, _ = mean_jig_points(observed)
        # A training pose is the reference where there is one, so that a test pose is measured against the fit.
        fitted = np.zeros(len(poses), dtype=bool)
        fitted[row[trained]] = True
        references = setup_references(poses, usable) | setup_references(poses, usable & fitted)
        start = np.full(len(poses), -1)
        for setup, reference in references.items():
            start[usable & (poses.setup == setup)] = reference
        others = np.flatnonzero(usable & (start != np.arange(len(poses))))
        jig = np.flatnonzero(observed.points.target == "jig")
        point = np.zeros(len(poses), dtype=np.int64)  # one of each pose: repeats have the same prediction
        point[row[jig]] = jig
        length_mm = np.linalg.norm(measured_mm[others] - measured_mm[start[others]], axis=1)
        return cls(np.unique(observed.points.pose)[others], point[others], point[start[others]], length_mm)

    def error_mm(self, base_mm: Array) -> Array:
        """Errors (K,) of the distances, predicted minus measured, mm, for predicted points (M, 3)."""
        return np.linalg.norm(base_mm[self.far] - base_mm[self.near], axis=1) - self.measured_mm
