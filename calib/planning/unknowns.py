"""Unknowns of the planned fit (the model's parameters and the scanner's frames) with prior information on them.

The information is that of a fit (`calib.fitting`): each parameter's prior, the measured points in units of the noise
that the fit shows, and none on the scanner's frames but from these points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.result import Calibration, declared_sigma_mm
from calib.dataset.dataset import Dataset, Points, Poses
from calib.effects.effect import Effect
from calib.effects.link_errors import LinkErrors
from calib.errors import CalibError, FitError
from calib.fitting.model import Model
from calib.fitting.noise import noise_factors, shaped_covariance
from calib.fitting.observations import Observations, linearise_points
from calib.fitting.scanner_frame import whitener
from calib.frames import frames_by_name
from calib.kinematics.robot import Robot
from calib.noise_shape import NoiseShape

_WITHOUT_PRIOR = 100.0  # sigma of each parameter in tolerances, for a fit without a prior
_FLAT_MM, _FLAT_RAD = 1e4, 3.0  # sigmas of a scanner's frame: as good as unknown
_TURN_MM = 500.0  # length that scales a frame's rotation to its shift, so that numbers are alike
DEFAULT_NOISE_MM = 0.05
_FINEST_MM = 1e-5  # least noise of a plan: with less the prior would be lost in rounding


@dataclass(frozen=True)
class Unknowns:
    """Unknowns of a planned fit: P parameters in units of their prior sigma, and six numbers per scanner frame."""

    model: Model
    x: Array  # (P,) point of linearisation
    scanner_T_base: Mapping[str, Array]  # (4, 4) by station
    centre_mm: Mapping[str, Array]  # (3,) by station, centre of the frame's rotation, scanner frame
    prior_information: Array  # (K, K) before any new pose
    point_covariance_mm2: Array  # (3, 3) of a new point, by the noise that the fit shows
    noise_shape: NoiseShape | None
    targets: tuple[str, ...]  # measured at each new pose
    noise_dof: float  # degrees of freedom of the noise; inf where it is declared
    measured: int  # number of poses in `prior_information`

    @property
    def scales(self) -> Array:
        """Prior sigma (P,) of each parameter, the unit of its unknown."""
        return self.model.scales

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters among the unknowns."""
        return tuple(p.name for p in self.model.parameters)

    @property
    def robot(self) -> Robot:
        """Robot with the parameters' current values."""
        return self.model.calibrated_robot(self.x)

    def of_parameters(self) -> Array:
        """Combinations (K, P) of the unknowns that select the parameters."""
        return np.eye(len(self.prior_information))[:, : len(self.scales)]

    def columns_mm(self, poses: Poses) -> Array:
        """Derivatives (N, 3 T, K) of T targets' points by the unknowns, mm in the scanner's frame."""
        columns = _point_columns(self, self.as_observed(poses))
        return columns.reshape(len(poses), -1, columns.shape[-1])

    def rows(self, poses: Poses) -> Array:
        """Derivatives (N, 3 T, K) of the T targets' points by the unknowns, in units of the points' noise."""
        observed = self.as_observed(poses)
        whitened = whitener(observed.covariance_mm2) @ _point_columns(self, observed)
        return np.asarray(whitened.reshape(len(poses), -1, whitened.shape[-1]))

    def points(self, poses: Poses) -> Points:
        """Predicted points of the targets at given poses, scanner frame."""
        return self.as_observed(poses).points

    def noise_mm2(self, poses: Poses) -> float:
        """Mean square 3D noise of a measured point at given poses, mm^2."""
        covariance = self.as_observed(poses).covariance_mm2
        return float(np.trace(covariance, axis1=1, axis2=2).mean())

    def as_observed(self, poses: Poses) -> Observations:
        """Observations made of predicted points, one for each target at each pose."""
        poses = poses.measured_later()
        scanner_T_base = frames_by_name(self.scanner_T_base, poses.setup)
        scanner_mm = np.empty((len(poses), len(self.targets), 3))
        for k, target in enumerate(self.targets):
            base_mm = self.model.predict(self.x, poses, target)
            scanner_mm[:, k] = np.einsum("nij,nj->ni", scanner_T_base[:, :3, :3], base_mm) + scanner_T_base[:, :3, 3]
        count = len(self.targets)
        points = Points(
            np.repeat(np.arange(len(poses)), count), scanner_mm.reshape(-1, 3), np.tile(self.targets, len(poses))
        )
        covariance = np.broadcast_to(self.point_covariance_mm2, (len(points), 3, 3))
        if self.noise_shape is not None and self.noise_shape.reshapes_points:
            covariance = shaped_covariance(noise_factors(self.noise_shape, points.xyz_mm), covariance)
        arm = self.model.robot if self.model.robot.carries_scanner else None
        return Observations(poses, points, covariance, self.scanner_T_base, carried_by=arm)


def unknowns_of_fit(calibration: Calibration, *, effects: Sequence[Effect] = ()) -> Unknowns:
    """Unknowns of a fit, and coefficients of further effects with a prior of zero within their usual size.

    Args:
        calibration: the fit.
        effects: effects that the fit does not have.
    """
    dataset = calibration.fitted_dataset
    model = calibration.model
    if effects:
        model = replace(model.with_loads_at(calibration.fit.x), effects=(*model.effects, *effects))
    x = _fitted_values(calibration, model)
    noise = calibration.fit.reduced_chi if np.isfinite(calibration.fit.reduced_chi) else 1.0
    noise = max(noise, _FINEST_MM / declared_sigma_mm(dataset))
    require_points(dataset)
    observed = replace(Observations.of(dataset), scanner_T_base=calibration.after.scanner_T_base)
    points = dataset.points
    assert points is not None
    prior = _before_measuring(
        model,
        x,
        {name: calibration.after.scanner_T_base[name] for name in sorted(set(map(str, observed.setup)))},
        covariance_mm2=noise**2 * _usual_covariance_mm2(dataset, points),
        targets=tuple(sorted(observed.targets)),
        noise_shape=dataset.noise,
        with_prior=calibration.options.prior,
        measured=observed,
    )
    whiten = whitener(noise**2 * observed.covariance_mm2)
    rows = (whiten @ _point_columns(prior, observed)).reshape(-1, len(prior.prior_information))
    return replace(
        prior,
        prior_information=prior.prior_information + rows.T @ rows,
        noise_dof=calibration.fit.degrees_of_freedom,
        measured=len(np.unique(observed.points.pose)),
    )


def unknowns_of_robot(
    robot: Robot,
    base_T_scanner: Array,
    *,
    noise_mm: float = DEFAULT_NOISE_MM,
    effects: Sequence[Effect] = (),
    tolerances: Mapping[str, float] | None = None,
    fixed: Sequence[str] = (),
) -> Unknowns:
    """Unknowns of an arm that was never measured: its table within tolerances, the scanner's frame unknown."""
    if not 0.0 < noise_mm < np.inf:
        raise CalibError(f"noise of {noise_mm:g} mm: a standard deviation above 0 is needed")
    model = Model(robot, (LinkErrors(robot, tolerances or {}), *effects)).with_fixed(fixed)
    return _before_measuring(
        model,
        np.zeros(len(model.parameters)),
        {"": frames.invert(base_T_scanner)},
        covariance_mm2=noise_mm**2 * np.eye(3),
        targets=("jig",),
        noise_shape=None,
        with_prior=True,
    )


def _before_measuring(
    model: Model,
    x: Array,
    scanner_T_base: Mapping[str, Array],
    *,
    covariance_mm2: Array,
    targets: tuple[str, ...],
    noise_shape: NoiseShape | None,
    with_prior: bool,
    measured: Observations | None = None,
) -> Unknowns:
    """Unknowns with prior information alone; frames turn about the centre of the measured points, if any."""
    precision = np.full(len(x), 1.0 if with_prior else _WITHOUT_PRIOR**-2)
    flat = np.tile(np.repeat([1.0 / _FLAT_MM**2, 1.0 / (_TURN_MM * _FLAT_RAD) ** 2], 3), len(scanner_T_base))
    centres = {name: np.zeros(3) for name in scanner_T_base}
    for name in scanner_T_base:
        if measured is not None and np.any(measured.setup == name):
            centres[name] = measured.points.xyz_mm[measured.setup == name].mean(axis=0)
    return Unknowns(
        model=model,
        x=x,
        scanner_T_base=scanner_T_base,
        centre_mm=centres,
        prior_information=np.diag(np.concatenate([precision, flat])),
        point_covariance_mm2=covariance_mm2,
        noise_shape=noise_shape,
        targets=targets,
        noise_dof=float("inf"),
        measured=0,
    )


def _point_columns(unknowns: Unknowns, observed: Observations) -> Array:
    """Derivatives (M, 3, K) of observed points by the unknowns, mm in the scanner's frame."""
    at_mm, by_x = linearise_points(unknowns.model, unknowns.x, observed)
    p = by_x.shape[-1]
    columns = np.zeros((len(at_mm), 3, len(unknowns.prior_information)))
    for k, (name, scanner_T_base) in enumerate(unknowns.scanner_T_base.items()):
        rows = observed.setup == name
        columns[rows, :, :p] = scanner_T_base[:3, :3] @ (by_x[rows] * unknowns.scales)
        motion = frames.frame_motion(frames.apply(scanner_T_base, at_mm[rows]), unknowns.centre_mm[name])
        motion[..., 3:] /= _TURN_MM
        columns[rows, :, p + 6 * k : p + 6 * k + 6] = motion
    return columns


def _usual_covariance_mm2(dataset: Dataset, points: Points) -> Array:
    """Mean covariance (3, 3), mm^2, of a training point, scanner frame, or the declared one."""
    trained = ~dataset.poses.is_test[points.pose]
    if points.covariance_mm2 is None:
        return (dataset.scanner.point_sigma_mm or 1.0) ** 2 * np.eye(3)
    return np.asarray(points.covariance_mm2[trained].mean(axis=0))


def _fitted_values(calibration: Calibration, model: Model) -> Array:
    """Fitted values (P,) of a model's parameters, zero for those that were not fitted."""
    fitted = dict(zip((p.name for p in calibration.fit.parameters), calibration.fit.x, strict=True))
    return np.array([fitted.get(p.name, 0.0) for p in model.parameters])


def require_points(dataset: Dataset) -> None:
    """Raise FitError where lengths were measured in place of points."""
    if dataset.points is not None and dataset.points.lengths is not None:
        raise FitError(f"dataset {dataset.name}: its points are lengths; poses are planned for measured points alone")
