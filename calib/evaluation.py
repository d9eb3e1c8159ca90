"""How far a model is from the measurements, in millimetres: training and test poses apart.

Positions are compared in the scanner's frame, which is fitted to the training poses of each setup alone; test poses
have no say in it. Distances run from the reference pose, as Jang 2025 counts them (section 3.2, figure 15).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calib import frames
from calib.dataset import Dataset
from calib.model import Model, geometric_model
from calib.observations import (
    Observations,
    mean_jig_points,
    place_scanner,
    predict_points,
    setup_references,
)
from calib.placement import fit_scanner_frame

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Figures:
    """Errors of a set of poses. `rmse`, `max` and `mean` are of the 3D error; `distance_*` of distances' errors."""

    points: int
    rmse_mm: float
    max_mm: float
    mean_mm: float
    distance_max_mm: float
    distance_mean_mm: float


@dataclass(frozen=True)
class Evaluation:
    """A model against all M measured points of a dataset."""

    pose: NDArray[np.int64]  # (M,)
    error_mm: Array  # (M, 3) predicted minus measured, scanner frame
    distance_pose: NDArray[np.int64]  # (K,) the far pose of each distance
    distance_error_mm: Array  # (K,) predicted minus measured
    is_test: NDArray[np.bool_]  # (N,) by pose
    scanner_T_base: dict[str, Array]  # by setup
    notes: tuple[str, ...]

    @property
    def train(self) -> Figures | None:
        return self._figures(~self.is_test)

    @property
    def test(self) -> Figures | None:
        return self._figures(self.is_test)

    def _figures(self, of_pose: NDArray[np.bool_]) -> Figures | None:
        error = np.linalg.norm(self.error_mm[of_pose[self.pose]], axis=1)
        distance = np.abs(self.distance_error_mm[of_pose[self.distance_pose]])
        if len(error) == 0:
            return None
        return Figures(
            points=len(error),
            rmse_mm=float(np.sqrt(np.mean(error**2))),
            max_mm=float(error.max()),
            mean_mm=float(error.mean()),
            distance_max_mm=float(distance.max(initial=0.0)),
            distance_mean_mm=float(distance.mean()) if len(distance) else 0.0,
        )

    def to_frame(self, dataset: Dataset) -> pd.DataFrame:
        """One row a measured point: pose, role, error in mm, and the distance error of its pose."""
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


def evaluate(model: Model, x: Array, dataset: Dataset) -> Evaluation:
    """Hold the model at x against the dataset's points.

    A setup without training poses gets its frame from its own test poses, and a note says so: its errors are then the
    scatter about its own best frame, not a prediction.
    """
    observed = Observations.of(dataset, np.ones(len(dataset.poses), dtype=bool))
    nominal = geometric_model(dataset.robot)
    trained = ~dataset.poses.is_test[observed.points.pose]
    observed = place_scanner(observed, nominal, np.zeros(len(nominal.parameters)), trained)
    base_mm = predict_points(model, x, observed)
    points, setup = observed.points, observed.setup
    error_mm = np.empty_like(base_mm)
    placements: dict[str, Array] = {}
    notes = []
    for name in map(str, np.unique(setup)):
        rows = setup == name
        fitted = rows & trained
        if not fitted.any():
            fitted = rows
            notes.append(f"setup {name!r} has no training pose: its frame comes from its own test poses")
        frame = fit_scanner_frame(base_mm[fitted], points.xyz_mm[fitted], observed.covariance_mm2[fitted])
        error_mm[rows] = frames.apply(frame, base_mm[rows]) - points.xyz_mm[rows]
        placements[name] = frame
    distance_pose, distance_error_mm = _distance_errors(model, x, observed)
    return Evaluation(
        pose=points.pose,
        error_mm=error_mm,
        distance_pose=distance_pose,
        distance_error_mm=distance_error_mm,
        is_test=dataset.poses.is_test,
        scanner_T_base=placements,
        notes=tuple(notes),
    )


def _distance_errors(model: Model, x: Array, observed: Observations) -> tuple[NDArray[np.int64], Array]:
    """Error of the distance from each setup's reference to each other pose; which pose, and by how much."""
    poses, _ = observed.used_poses
    used = np.unique(observed.points.pose)
    usable, measured_mm, _ = mean_jig_points(observed)
    # A training pose is the reference where there is one, so that a test pose is measured against the fit.
    trained = usable & ~poses.is_test
    references = setup_references(poses, usable) | setup_references(poses, trained)
    base_mm = model.predict(x, poses, seen=observed.seen())
    far, error = [], []
    for setup, reference in references.items():
        others = np.flatnonzero(usable & (poses.setup == setup) & (np.arange(len(poses)) != reference))
        predicted = np.linalg.norm(base_mm[others] - base_mm[reference], axis=1)
        measured = np.linalg.norm(measured_mm[others] - measured_mm[reference], axis=1)
        far.append(used[others])
        error.append(predicted - measured)
    if not far:
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    return np.concatenate(far), np.concatenate(error)
