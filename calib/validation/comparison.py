"""Comparison of two calibrations: the same arm before and after a repair, or two arms of a type.

A posterior mean moves with the true parameters by its averaging kernel M = I - C L (C the posterior covariance, L the
prior's precision), and with the noise, whose part of the covariance is M C. Both means are drawn to the nominal robot
alike, so that the covariance of their difference where the arms are the same is

    D = M1 C1 + M2 C2 + (M1 - M2) L^-1 (M1 - M2)'

with C as the noise makes it, times the factor by which misfit that is alike at neighbouring poses moves parameters more
than noise does (`calib.calibration.promise.misfit_inflation`). Without misfit it is far less than C1 + C2 along
directions that only the prior knows. A change of one parameter of the second arm moves the difference by M2's column:
that is how one change is told from the many parameters that it moves.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.evaluation import Evaluation
from calib.calibration.mount import camera_places
from calib.calibration.promise import misfit_inflation
from calib.calibration.result import Calibration, times_declared_noise
from calib.errors import FitError
from calib.kinematics.chain import nominal_chain
from calib.presented import Presented
from calib.screening.evidence import holm
from calib.statistics import chi2_sf, rms

ALPHA = 0.01  # family-wise significance level of a change, over all parameters
MOST_CHANGES = 4
SAME = 0.95  # correlation of two changes' effects from which these data cannot discriminate them
_KNOWN = 1e-6  # share of the largest eigenvalue of D below which the difference is unknown in a direction


@dataclass(frozen=True)
class ParameterDifference:
    """Difference of one parameter between two calibrations, the second minus the first."""

    name: str = field(metadata={"key": "parameter"})
    unit: str
    values: tuple[float, float]
    sigmas: tuple[float, float]
    difference: float
    sigma: float  # of the difference where the arms are the same; 0 where nothing is known of it

    @property
    def z(self) -> float:
        """Difference divided by its sigma; 0 where the sigma is unknown."""
        return self.difference / self.sigma if self.sigma > 0.0 else 0.0


@dataclass(frozen=True)
class ParameterChange:
    """Change of one parameter that best explains the remaining difference of two calibrations."""

    name: str = field(metadata={"key": "parameter"})
    unit: str
    size: float
    sigma: float
    p_holm: float
    alike: tuple[str, ...]  # other parameters whose change these data cannot discriminate from this one


@dataclass(frozen=True)
class CameraShift:
    """By how far a camera's place differs between two calibrations, along and about the axes of its parent."""

    parent: str  # "flange" or "base"
    setup: str
    shift_mm: Array  # (3,)
    turn_deg: Array  # (3,) rotation vector
    sigma_mm: Array  # (3,) where nothing was moved
    sigma_deg: Array  # (3,)
    p_same: float  # p-value of the difference, where nothing was moved


@dataclass(frozen=True)
class Comparison(Presented):
    """Differences between two calibrations, the second minus the first."""

    names: tuple[str, str]
    errors: tuple[tuple[Evaluation, Evaluation], tuple[Evaluation, Evaluation]]  # before and after, of each
    parameters: tuple[ParameterDifference, ...]
    only_in: tuple[tuple[str, ...], tuple[str, ...]]  # effects in one model and not in the other
    p_same: float  # p-value of the difference, where the arms are the same
    changes: tuple[ParameterChange, ...]
    p_rest: float  # p-value of the rest of the difference, where the arms are otherwise the same
    rms_mm: float  # RMS distance of the tool points at all poses of both, after the best rigid motion
    largest_mm: float
    largest_pose: str
    times_noise: tuple[float | None, float | None] = (None, None)  # residual over the declared noise, of each
    cameras: tuple[CameraShift, ...] = ()  # of each placement that both have

    @property
    def differs(self) -> bool:
        """Whether any change exceeds the noise."""
        return bool(self.changes) or any(self.only_in) or any(camera.p_same < ALPHA for camera in self.cameras)

    def _brief(self) -> str:
        changed = ", ".join(change.name for change in self.changes) or "no parameter"
        return f"{self.names[0]} and {self.names[1]}: {changed} differs, tool point {self.rms_mm:.3g} mm RMS apart"


def comparison_of(one: Calibration, other: Calibration, names: tuple[str, str] | None = None) -> Comparison:
    """Differences between two calibrations of different measurements of the same kind of robot: see `calib.compare`."""
    robots = (one.dataset.robot, other.dataset.robot)
    if robots[0].is_revolute.tolist() != robots[1].is_revolute.tolist():
        kinds = [f"{r.name} ({r.n_joints} joints)" for r in robots]
        raise FitError(f"{kinds[0]} and {kinds[1]} cannot be compared: their joints are not of the same kinds")
    parameters, (changes, p_same, p_rest) = _parameters(one, other)
    rms_mm, largest_mm, pose = _shift(one, other)
    families = (one.model.family_names, other.model.family_names)
    return Comparison(
        names or (one.dataset.name, other.dataset.name),
        ((one.before, one.after), (other.before, other.after)),
        parameters,
        tuple(tuple(n for n in own if n not in others) for own, others in (families, families[::-1])),  # type: ignore[arg-type]
        p_same,
        changes,
        p_rest,
        rms_mm,
        largest_mm,
        pose,
        (times_declared_noise(one), times_declared_noise(other)),
        camera_shifts(one, other),
    )


def camera_shifts(one: Calibration, other: Calibration) -> tuple[CameraShift, ...]:
    """Differences of the places of cameras that both calibrations found."""
    if not (one.dataset.is_by_camera and other.dataset.is_by_camera):
        return ()
    found = []
    theirs = {place.setup: place for place in camera_places(other)}
    for mine in camera_places(one):
        then = theirs.get(mine.setup)
        if then is None or then.parent != mine.parent:
            continue
        turn = frames.rotvec_from_rotation(then.parent_T_camera[:3, :3] @ mine.parent_T_camera[:3, :3].T)
        off = np.concatenate([then.xyz_mm - mine.xyz_mm, turn])
        covariance = mine.covariance_with_table + then.covariance_with_table
        scale = np.sqrt(np.diag(covariance))
        square = off / scale @ np.linalg.solve(covariance / np.outer(scale, scale), off / scale)
        degrees = np.degrees(np.concatenate([off[3:], scale[3:]]))
        found.append(
            CameraShift(
                mine.parent, mine.setup, off[:3], degrees[:3], scale[:3], degrees[3:], chi2_sf(float(square), len(off))
            )
        )
    return tuple(found)


def _parameters(
    one: Calibration, other: Calibration
) -> tuple[tuple[ParameterDifference, ...], tuple[tuple[ParameterChange, ...], float, float]]:
    units = {p.name: p.unit for p in one.fit.parameters}
    theirs = {p.name for p in other.fit.parameters}
    names = [p.name for p in one.fit.parameters if p.name in theirs]
    if not names:
        return (), ((), 1.0, 1.0)
    sides = [_Side.of(calibration, names) for calibration in (one, other)]
    difference = sides[1].values - sides[0].values
    scales = sides[0].scales
    covariance = sides[0].noise + sides[1].noise
    if one.options.prior and other.options.prior:
        apart = sides[0].kernel - sides[1].kernel
        covariance = covariance + apart @ apart.T
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sigma = np.where(sigma > np.sqrt(_KNOWN) * sigma.max(initial=0.0), sigma, 0.0) * scales
    rows = tuple(
        ParameterDifference(
            name, units[name], (float(sides[0].values[k]), float(sides[1].values[k])),
            (float(sides[0].sigma[k]), float(sides[1].sigma[k])), float(difference[k]), float(sigma[k]),
        )
        for k, name in enumerate(names)
    )  # fmt: skip
    return rows, _changes(names, units, difference / scales, covariance, sides[1].kernel, scales)


@dataclass(frozen=True)
class _Side:
    """One of two calibrations, restricted to their common parameters (P,) in units of the tolerances.

    Kernel and noise are in these units, too.
    """

    values: Array  # (P,) nominal + correction
    sigma: Array  # (P,)
    scales: Array  # (P,)
    kernel: Array  # (P, P) derivative of the fitted values by the true ones
    noise: Array  # (P, P) the part of noise and misfit in their covariance

    @classmethod
    def of(cls, calibration: Calibration, names: list[str]) -> _Side:
        fit = calibration.fit
        at = {p.name: k for k, p in enumerate(fit.parameters)}
        rows = np.array([at[name] for name in names])
        scales = calibration.model.scales
        known = ~fit.undetermined
        whole = np.where(np.outer(known, known), fit.covariance / np.outer(scales, scales), 0.0)
        kernel = np.eye(len(scales)) - whole if calibration.options.prior else np.diag(known.astype(float))
        noise = misfit_inflation(calibration) * kernel @ whole
        block = np.ix_(rows, rows)
        nominal = np.array([p.nominal for p in fit.parameters])
        return cls(
            (nominal + fit.x)[rows], fit.sigma[rows], scales[rows], kernel[block], (0.5 * (noise + noise.T))[block]
        )  # fmt: skip


def _changes(
    names: list[str], units: dict[str, str], difference: Array, covariance: Array, kernel: Array, scales: Array
) -> tuple[tuple[ParameterChange, ...], float, float]:
    """Fewest single-parameter changes that explain a difference, with p-values before and after these changes.

    Generalised least squares along the directions that the data know, one more parameter at a time.
    """
    variance, axes = np.linalg.eigh(covariance)
    known = variance > _KNOWN * max(float(variance[-1]), 1e-30)
    if not known.any():
        return (), 1.0, 1.0
    whiten = axes[:, known].T / np.sqrt(variance[known])[:, None]
    y, columns = whiten @ difference, whiten @ kernel  # (K,), (K, P)
    p_same = chi2_sf(float(y @ y), float(known.sum()))
    chosen: list[int] = []
    evidence: list[tuple[float, tuple[str, ...]]] = []  # p-value and alike parameters of each chosen one
    while len(chosen) < MOST_CHANGES:
        basis = np.linalg.qr(columns[:, chosen])[0] if chosen else np.zeros((len(y), 0))
        rest, free = y - basis @ (basis.T @ y), columns - basis @ (basis.T @ columns)
        length = np.linalg.norm(free, axis=0)
        usable = length > 1e-6 * np.linalg.norm(columns, axis=0).max()
        gain = np.where(usable, (free.T @ rest) / np.where(usable, length, 1.0), 0.0) ** 2
        best = int(np.argmax(gain))
        p_values = holm([chi2_sf(float(g), 1.0) for g in gain])
        if p_values[best] > ALPHA:
            break
        is_alike = np.abs(free.T @ free[:, best]) > SAME * length * length[best]
        others = tuple(names[k] for k in np.flatnonzero(is_alike & usable) if k != best)
        chosen.append(best)
        evidence.append((p_values[best], others))
    if not chosen:
        return (), p_same, p_same
    sizes = np.linalg.lstsq(columns[:, chosen], y, rcond=None)[0]
    rest = y - columns[:, chosen] @ sizes
    p_rest = chi2_sf(float(rest @ rest), max(float(known.sum()) - len(chosen), 1.0))
    spread = np.sqrt(np.diag(np.linalg.inv(columns[:, chosen].T @ columns[:, chosen])))
    changes = tuple(
        ParameterChange(names[k], units[names[k]], float(size * scales[k]), float(s * scales[k]), p_value, alike)
        for k, size, s, (p_value, alike) in zip(chosen, sizes, spread, evidence, strict=True)
    )
    return changes, p_same, p_rest


def _shift(one: Calibration, other: Calibration) -> tuple[float, float, str]:
    """Distance between two arms' tool points over the poses of both, mm: RMS, largest, and the pose of the largest.

    The table's part alone; a rigid motion, which the unknown place of the scanner would take up, is taken out.
    """
    poses = [calibration.dataset.poses for calibration in (one, other)]
    q = np.concatenate([p.q for p in poses])
    ids = [i for p in poses for i in p.ids]
    points = [nominal_chain(c.robot, q).target_mm for c in (one, other)]
    moved = frames.apply(frames.best_fit_transform(points[1], points[0]), points[1])
    apart_mm = np.linalg.norm(moved - points[0], axis=1)
    worst = int(np.argmax(apart_mm))
    return rms(apart_mm), float(apart_mm[worst]), ids[worst]
