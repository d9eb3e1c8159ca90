"""Errors of an arm that is held as its table has it, counted as noise of the measured poses.

A camera's poses are known to hundredths of a millimetre, an arm as delivered to tenths or whole ones. Held at its
table, a fit with the camera's covariances alone would trust most what the camera sees best, and put the arm's errors
where it sees least. So each pose's covariance C_i gets the arm's errors added, equal along and about all axes,

    C_i + diag(s^2, s^2, s^2, t^2, t^2, t^2)

with s, mm, and t, rad, of the largest likelihood of the residual (variance components, as in Searle 1992).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, IndexArray
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.fitting.observations import Observations, with_nominal_scanner_frames
from calib.fitting.pose_residuals import PoseResiduals
from calib.options import FitOptions

ROUNDS = 8
SETTLED = 0.02  # relative change of both sizes
_NEEDED = 1.3  # residual over noise, from which the arm's errors are counted
_EM_ROUNDS = 100
_LEAST_MM, _LEAST_RAD = 1e-5, 1e-8


@dataclass(frozen=True)
class ArmNoise:
    """Standard deviations of the arm's errors at a pose, along and about each axis."""

    sigma_mm: float
    sigma_rad: float

    def is_near(self, other: ArmNoise) -> bool:
        """Whether both sizes are as those of another to two per cent."""
        return bool(
            abs(np.log(self.sigma_mm / other.sigma_mm)) < SETTLED
            and abs(np.log(self.sigma_rad / other.sigma_rad)) < SETTLED
        )


def counts_arm_as_noise(calibration: Calibration, options: FitOptions) -> bool:
    """Whether a fit of full poses held all links at the user's request, and leaves more than the noise."""
    held = set(calibration.model.robot.parameter_names) - set(options.fixed)
    points = calibration.dataset.points
    return (
        options.residual == "pose"
        and bool(options.fixed)
        and all(name.endswith("TCP") for name in held)
        and points is not None
        and points.orientations is not None
        and points.orientations.covariance_rad2 is not None
        and points.covariance_mm2 is not None
        and calibration.fit.reduced_chi > _NEEDED
    )


def arm_noise(calibration: Calibration, measured: Dataset) -> ArmNoise:
    """Size of the arm's errors with the largest likelihood of a fit's residual; `measured` has the plain noise."""
    errors, rows = _errors(calibration)
    covariance = _covariances(measured)[rows]

    variance = np.array([np.mean(errors[:, :3] ** 2), np.mean(errors[:, 3:] ** 2)])
    for _ in range(_EM_ROUNDS):  # expectation and maximisation (Dempster, Laird and Rubin 1977)
        added = np.diag(np.repeat(np.maximum(variance, [_LEAST_MM**2, _LEAST_RAD**2]), 3))
        gain = added @ np.linalg.inv(covariance + added)
        part = np.einsum("mij,mj->mi", gain, errors)
        spread = part**2 + np.diagonal(added - gain @ added, axis1=1, axis2=2)
        variance = np.array([np.mean(spread[:, :3]), np.mean(spread[:, 3:])])
    sigma_mm, sigma_rad = np.sqrt(np.maximum(variance, [_LEAST_MM**2, _LEAST_RAD**2]))
    return ArmNoise(float(sigma_mm), float(sigma_rad))


def with_arm_noise(measured: Dataset, noise: ArmNoise) -> Dataset:
    """Dataset with the arm's errors added to the covariances of its measured poses."""
    points = measured.points
    assert points is not None
    assert points.orientations is not None
    assert points.covariance_mm2 is not None
    assert points.orientations.covariance_rad2 is not None
    turns = points.orientations.covariance_rad2 + noise.sigma_rad**2 * np.eye(3)
    return replace(
        measured,
        points=replace(
            points,
            covariance_mm2=points.covariance_mm2 + noise.sigma_mm**2 * np.eye(3),
            orientations=replace(points.orientations, covariance_rad2=turns),
        ),
        notes=(
            *measured.notes,
            f"the arm is held as robot.toml has it; its own errors count as {noise.sigma_mm:.2g} mm and "
            f"{np.degrees(noise.sigma_rad):.2g}° per axis at each pose",
        ),
    )


def _errors(calibration: Calibration) -> tuple[Array, IndexArray]:
    """Errors (M, 6), predicted minus measured, mm and rad, of the fitted points, and their rows in the dataset."""
    dataset = calibration.dataset
    assert dataset.points is not None
    used = ~dataset.poses.is_test
    observed = Observations.of(dataset, used)
    residuals = PoseResiduals(calibration.model, with_nominal_scanner_frames(observed, calibration.model.placed_robot))
    nuisance = residuals.nuisance(calibration.fit.x)
    errors = residuals.errors(nuisance.placed, nuisance.base_mm, nuisance.attitude)
    return errors[residuals.has_orientation], np.flatnonzero(used[dataset.points.pose])[residuals.has_orientation]


def _covariances(dataset: Dataset) -> Array:
    """Covariances (M, 6, 6), mm and rad, of the measured poses."""
    points = dataset.points
    assert points is not None
    assert points.orientations is not None
    out = np.zeros((len(points), 6, 6))
    out[:, :3, :3], out[:, 3:, 3:] = points.covariance_mm2, points.orientations.covariance_rad2
    cross = points.orientations.cross_mm_rad
    if cross is not None:
        out[:, :3, 3:], out[:, 3:, :3] = cross, np.swapaxes(cross, 1, 2)
    return out
