"""The unknowns of a fit to come: the model's parameters and the scanner's frames, with what is known of them already.

The same as a fit counts (`calib.fitting`): each parameter's prior, the measured points in units of the noise that the
fit shows, and no knowledge of where the scanner stands beyond what the points tell.
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
from calib.fitting.scanner_frame import frame_motion, whitener
from calib.kinematics.robot import Robot
from calib.noise_shape import NoiseShape

_UNHELD = 100.0  # tolerances, where a fit is to hold no parameter
_FLAT_MM, _FLAT_RAD = 1e4, 3.0  # of a scanner's frame: as good as nothing known
_TURN_MM = 500.0  # weighs a frame's turn against its shift, so that numbers are alike
DEFAULT_NOISE_MM = 0.05
_FINEST_MM = 1e-5  # no plan counts with less noise: beside it the prior would be lost in rounding


@dataclass(frozen=True)
class Unknowns:
    """K unknowns: P parameters in units of their prior's sigma, then six of each setup's scanner frame."""

    model: Model
    x: Array  # (P,) about which all is linear
    scanner_T_base: Mapping[str, Array]  # (4, 4) by setup
    centre_mm: Mapping[str, Array]  # (3,) about which each frame turns, scanner frame
    known: Array  # (K, K) information before any new pose
    point_covariance_mm2: Array  # (3, 3) of a new point, by the noise that the fit shows
    noise_shape: NoiseShape | None
    targets: tuple[str, ...]  # measured at each new pose
    degrees_of_freedom: float  # of the noise; inf where it is declared
    measured: int  # poses that are in `known`

    @property
    def scales(self) -> Array:
        """(P,) the unit of each parameter."""
        return self.model.scales

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the first P unknowns."""
        return tuple(p.name for p in self.model.parameters)

    @property
    def robot(self) -> Robot:
        """The robot as it is known."""
        return self.model.calibrated_robot(self.x)

    def of_parameters(self) -> Array:
        """(K, P) picks the parameters from the unknowns."""
        return np.eye(len(self.known))[:, : len(self.scales)]

    def columns_mm(self, poses: Poses) -> Array:
        """(N, 3 T, K) the derivative of the T targets' measured points, mm in the scanner's frame, by the unknowns."""
        observed = self.as_observed(poses)
        at = _joint_columns(self, observed)
        return at.reshape(len(poses), -1, at.shape[-1])

    def rows(self, poses: Poses) -> Array:
        """(N, 3 T, K) `columns_mm` in units of the points' noise."""
        observed = self.as_observed(poses)
        whitened = whitener(observed.covariance_mm2) @ _joint_columns(self, observed)
        return np.asarray(whitened.reshape(len(poses), -1, whitened.shape[-1]))

    def points(self, poses: Poses) -> Points:
        """Where the scanner should see the targets at these poses."""
        return self.as_observed(poses).points

    def noise_mm2(self, poses: Poses) -> float:
        """The mean square of a measured point's noise at these poses, in three dimensions."""
        covariance = self.as_observed(poses).covariance_mm2
        return float(np.trace(covariance, axis1=1, axis2=2).mean())

    def as_observed(self, poses: Poses) -> Observations:
        """Points where the model has them, a row for each target of each pose."""
        poses = poses.measured_later()
        placed = np.stack([self.scanner_T_base[str(name)] for name in poses.setup])
        seen = np.empty((len(poses), len(self.targets), 3))
        for k, target in enumerate(self.targets):
            base_mm = self.model.predict(self.x, poses, target)
            seen[:, k] = np.einsum("nij,nj->ni", placed[:, :3, :3], base_mm) + placed[:, :3, 3]
        count = len(self.targets)
        points = Points(np.repeat(np.arange(len(poses)), count), seen.reshape(-1, 3), np.tile(self.targets, len(poses)))
        covariance = np.broadcast_to(self.point_covariance_mm2, (len(points), 3, 3))
        if self.noise_shape is not None and self.noise_shape.reshapes_points:
            covariance = shaped_covariance(noise_factors(self.noise_shape, points.xyz_mm), covariance)
        return Observations(poses, points, covariance, self.scanner_T_base)


def unknowns_of_fit(
    calibration: Calibration,
    *,
    effects: Sequence[Effect] = (),
    scanner_T_base: Mapping[str, Array] | None = None,
) -> Unknowns:
    """What a fit knows, and further effects that it has not: these are zero within their usual size so far.

    `scanner_T_base` adds placements of the scanner that were not measured from yet, by the setup's name.
    """
    dataset = calibration.fitted_dataset
    model = calibration.model
    if effects:
        model = replace(model.with_loads_at(calibration.fit.x), effects=(*model.effects, *effects))
    x = _extended(calibration, model)
    noise = calibration.fit.reduced_chi if np.isfinite(calibration.fit.reduced_chi) else 1.0
    noise = max(noise, _FINEST_MM / declared_sigma_mm(dataset))
    require_scanner_in_world(dataset)
    observed = replace(Observations.of(dataset), scanner_T_base=calibration.after.scanner_T_base)
    places = {name: calibration.after.scanner_T_base[name] for name in sorted(set(map(str, observed.setup)))}
    points = dataset.points
    assert points is not None
    empty = _before_measuring(
        model,
        x,
        {**places, **(scanner_T_base or {})},
        covariance_mm2=noise**2 * _usual_covariance_mm2(dataset, points),
        targets=tuple(sorted(observed.targets)),
        noise_shape=dataset.noise,
        held=calibration.options.prior,
        like=observed,
    )
    whiten = whitener(noise**2 * observed.covariance_mm2)
    rows = (whiten @ _joint_columns(empty, observed)).reshape(-1, len(empty.known))
    return replace(
        empty,
        known=empty.known + rows.T @ rows,
        degrees_of_freedom=calibration.fit.degrees_of_freedom,
        measured=len(np.unique(observed.points.pose)),
    )


def unknowns_of_robot(
    robot: Robot,
    base_T_scanner: Array,
    *,
    noise_mm: float = DEFAULT_NOISE_MM,
    effects: Sequence[Effect] = (),
    tolerances: Mapping[str, float] | None = None,
    held: Sequence[str] = (),
    setup: str = "",
) -> Unknowns:
    """What is known of an arm that was never measured: its table within tolerances, nothing of the scanner's place."""
    if not 0.0 < noise_mm < np.inf:
        raise CalibError(f"noise of {noise_mm:g} mm: a standard deviation above 0 is needed")
    model = Model(robot, (LinkErrors(robot, tolerances or {}), *effects)).with_fixed(held)
    return _before_measuring(
        model,
        np.zeros(len(model.parameters)),
        {setup: frames.invert(base_T_scanner)},
        covariance_mm2=noise_mm**2 * np.eye(3),
        targets=("jig",),
        noise_shape=None,
        held=True,
    )


def _before_measuring(
    model: Model,
    x: Array,
    places: Mapping[str, Array],
    *,
    covariance_mm2: Array,
    targets: tuple[str, ...],
    noise_shape: NoiseShape | None,
    held: bool,
    like: Observations | None = None,
) -> Unknowns:
    """The unknowns with the prior alone."""
    prior = np.full(len(x), 1.0 if held else _UNHELD**-2)
    flat = np.tile(np.repeat([1.0 / _FLAT_MM**2, 1.0 / (_TURN_MM * _FLAT_RAD) ** 2], 3), len(places))
    centres = {name: np.zeros(3) for name in places}
    for name in places:
        if like is not None and np.any(like.setup == name):
            centres[name] = like.points.xyz_mm[like.setup == name].mean(axis=0)
    return Unknowns(
        model=model,
        x=x,
        scanner_T_base=places,
        centre_mm=centres,
        known=np.diag(np.concatenate([prior, flat])),
        point_covariance_mm2=covariance_mm2,
        noise_shape=noise_shape,
        targets=targets,
        degrees_of_freedom=float("inf"),
        measured=0,
    )


def _joint_columns(unknowns: Unknowns, observed: Observations) -> Array:
    """(M, 3, K) the derivative of observed points, mm in the scanner's frame."""
    at_mm, by_x = linearise_points(unknowns.model, unknowns.x, observed)
    p = by_x.shape[-1]
    out = np.zeros((len(at_mm), 3, len(unknowns.known)))
    for k, (name, scanner_T_base) in enumerate(unknowns.scanner_T_base.items()):
        rows = observed.setup == name
        out[rows, :, :p] = scanner_T_base[:3, :3] @ (by_x[rows] * unknowns.scales)
        motion = frame_motion(frames.apply(scanner_T_base, at_mm[rows]), unknowns.centre_mm[name])
        motion[..., 3:] /= _TURN_MM
        out[rows, :, p + 6 * k : p + 6 * k + 6] = motion
    return out


def _usual_covariance_mm2(dataset: Dataset, points: Points) -> Array:
    """(3, 3) the mean covariance of a training point, scanner frame; the declared one where points have none."""
    trained = ~dataset.poses.is_test[points.pose]
    if points.covariance_mm2 is None:
        return (dataset.scanner.point_sigma_mm or 1.0) ** 2 * np.eye(3)
    return np.asarray(points.covariance_mm2[trained].mean(axis=0))


def _extended(calibration: Calibration, model: Model) -> Array:
    """The fitted values of a model's parameters, zero for those that were not fitted."""
    fitted = dict(zip((p.name for p in calibration.fit.parameters), calibration.fit.x, strict=True))
    return np.array([fitted.get(p.name, 0.0) for p in model.parameters])


def require_scanner_in_world(dataset: Dataset) -> None:
    """Raise FitError where the arm carries the scanner."""
    if dataset.robot.carries_scanner:
        raise FitError(
            f"dataset {dataset.name}: the scanner is on the flange; poses are planned for a scanner in the room alone"
        )
