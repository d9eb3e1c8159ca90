"""Uncertainty of a fit: combinations of parameters that are well determined although each alone is not, correlated
pairs, and the covariance of a prediction.

All follow from the posterior covariance of the parameters, by the noise that the residual shows and, where one was
used, the prior. It holds for a complete model only: missing effects are no part of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib import frames
from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.errors import FitError
from calib.fitting.observations import Observations, conditions_at, linearise_points
from calib.identifiability.structural import redundancy

CORRELATED = 0.8


@dataclass(frozen=True)
class Combination:
    """A weighted sum of parameters: its value and sigma, beside the sigma of its least known part."""

    coefficients: Mapping[str, float]
    value: float  # of the fitted parameters, nominal and correction
    sigma: float
    worst_part_sigma: float  # the largest of |coefficient| x sigma among its parts
    tolerance: float  # the largest of |coefficient| x tolerance among its parts
    unit: str  # of value and sigma; "" where the parts have several

    @property
    def is_known(self) -> bool:
        """Whether its sigma is below half its tolerance: the same rule as for single parameters."""
        return self.sigma < 0.5 * self.tolerance

    @property
    def description(self) -> str:
        terms = []
        for name, coefficient in self.coefficients.items():
            size = "" if abs(abs(coefficient) - 1.0) < 1e-9 else f"{abs(coefficient):.6g} "
            terms.append(f"{'-' if coefficient < 0 else '+'} {size}{name}")
        return " ".join(terms).removeprefix("+ ")


@dataclass(frozen=True)
class CorrelatedPair:
    """Two parameters and Pearson's r of their estimates' errors."""

    first: str
    second: str
    r: float


def combination(calibration: Calibration, coefficients: Mapping[str, float]) -> Combination:
    """Value and sigma of any weighted sum of fitted parameters. Raises FitError on an unknown name."""
    parameters = calibration.fit.parameters
    names = [p.name for p in parameters]
    unknown = [name for name in coefficients if name not in names]
    if unknown:
        raise FitError(f"no fitted parameter named {unknown[0]!r}; there are {names[0]} ... {names[-1]}")
    weights = np.zeros(len(names))
    for name, coefficient in coefficients.items():
        weights[names.index(name)] = coefficient
    value = np.array([p.nominal for p in parameters]) + calibration.fit.x
    variance = float(weights @ calibration.fit.covariance @ weights)
    used = np.flatnonzero(weights)
    units = {parameters[i].unit for i in used}
    return Combination(
        coefficients=dict(coefficients),
        value=float(weights @ value),
        sigma=float(np.sqrt(max(variance, 0.0))),
        worst_part_sigma=float(np.max(np.abs(weights[used]) * calibration.fit.sigma[used])),
        tolerance=float(np.max(np.abs(weights[used]) * calibration.model.scales[used])),
        unit=units.pop() if len(units) == 1 else "",
    )


def identifiable_combinations(calibration: Calibration) -> tuple[Combination, ...]:
    """For each group of redundant parameters the one sum that can be identified (a6 + aTCP, theta4 - beta4).

    Left out are sums whose sigma is not below half their tolerance at these poses, and groups that a motion of the
    scanner's frame can replace (d1, theta1 - beta1).
    """
    found = redundancy(calibration.dataset)
    blind = set(redundancy(calibration.dataset, residual="distance").no_influence)
    names = {p.name for p in calibration.fit.parameters}
    row = {name: i for i, name in enumerate(found.parameters)}
    out = []
    for group in found.groups:
        present = [name for name in group if name in names and name not in blind]
        if len(present) > 1:
            sign = {n: float(np.sign(found.pearson[row[group[0]], row[n]])) for n in present}
            out.append(combination(calibration, sign))
    return tuple(found_sum for found_sum in out if found_sum.is_known)


def correlated_pairs(calibration: Calibration) -> tuple[CorrelatedPair, ...]:
    """Pairs whose estimates' errors correlate beyond `CORRELATED`, the strongest first."""
    fit = calibration.fit
    sigma = np.sqrt(np.diag(fit.covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        r = fit.covariance / np.outer(sigma, sigma)
    usable = ~fit.undetermined & (sigma > 0.0)
    pairs = [
        CorrelatedPair(fit.parameters[i].name, fit.parameters[j].name, float(r[i, j]))
        for i, j in zip(*np.triu_indices(len(sigma), 1), strict=True)
        if usable[i] and usable[j] and abs(r[i, j]) > CORRELATED
    ]
    return tuple(sorted(pairs, key=lambda pair: -abs(pair.r)))


def prediction_covariance(calibration: Calibration, q: ArrayLike, setup: str | None = None) -> Array:
    """The covariance of the predicted tool point at any joint vectors, in a setup's scanner frame.

    The parameters and the frame that was fitted with them are both uncertain, and correlated: a change dx of the
    parameters changes the fitted frame by -F^+ J dx (F the frame's columns at the training points), so that

        cov = A cov(x) A^T + G cov(frame) G^T,   A = J(q) - G F^+ J,   G the frame's columns at the predicted point.

    Args:
        calibration: a fit.
        q: (N, n) joint vectors, rad or mm.
        setup: whose scanner frame; the first where None.

    Returns:
        (N, 3, 3) mm^2.
    """
    q = np.atleast_2d(np.asarray(q, dtype=float))
    observed = Observations.of(calibration.fitted_dataset)
    name = str(observed.setup[0]) if setup is None else setup
    rows = np.flatnonzero(observed.setup == name)
    if len(rows) == 0:
        raise FitError(
            f"setup {name!r} has no training points; there are {sorted(set(map(str, observed.setup)))}"
        )
    scanner_T_base = calibration.after.scanner_T_base[name]
    rotation = scanner_T_base[:3, :3]
    model, x = calibration.model, calibration.fit.x
    at_mm, by_x = linearise_points(model, x, observed)
    seen_mm = frames.apply(scanner_T_base, at_mm[rows])
    centre = seen_mm.mean(axis=0)
    root = np.linalg.inv(np.linalg.cholesky(observed.covariance_mm2[rows]))
    frame_rows = (root @ _motion(seen_mm, centre)).reshape(-1, 6)
    parameter_rows = (root @ rotation @ by_x[rows]).reshape(-1, by_x.shape[-1])
    pseudo = np.linalg.pinv(frame_rows, rcond=1e-9)
    noise = calibration.fit.noise if np.isfinite(calibration.fit.noise) else 1.0
    points_mm, by_q = model.linearise(x, conditions_at(calibration.dataset.poses, q))
    motion = _motion(frames.apply(scanner_T_base, points_mm), centre)
    drag = rotation @ by_q - motion @ (pseudo @ parameter_rows)
    frame_covariance = noise**2 * pseudo @ pseudo.T
    return drag @ calibration.fit.covariance @ np.swapaxes(
        drag, 1, 2
    ) + motion @ frame_covariance @ np.swapaxes(motion, 1, 2)


def _motion(points_mm: Array, centre_mm: Array) -> Array:
    """(N, 3, 6) derivative of points (N, 3) by a small shift, then by a small turn about the centre (3,)."""
    eye = np.broadcast_to(np.eye(3), (len(points_mm), 3, 3))
    return np.concatenate([eye, -frames.skew(points_mm - centre_mm)], axis=-1)
