"""Uncertainty of a fit: identifiable combinations of parameters, correlated pairs, and covariance of predictions.

All follow from the posterior covariance of the parameters, by the residual's noise and, where one was used, the prior.
It holds for a complete model only and does not include missing effects.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.errors import FitError
from calib.fitting.observations import Observations, linearise_points
from calib.fitting.scanner_frame import whitened_motion
from calib.identifiability.structural import absorbed_by_scanner_frame, redundancy_of

CORRELATED = 0.8


@dataclass(frozen=True)
class Combination:
    """Weighted sum of parameters with its value and sigma, and the largest sigma among its terms."""

    coefficients: Mapping[str, float]
    value: float  # of the fitted parameters, nominal and correction
    sigma: float
    worst_part_sigma: float  # the largest of |coefficient| x sigma among its parts
    tolerance: float  # the largest of |coefficient| x tolerance among its parts
    unit: str  # of value and sigma; "" where the parts have several

    @property
    def is_known(self) -> bool:
        """Whether the sum's sigma is below half its tolerance, the criterion for a single known parameter."""
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
    """Two parameters and Pearson's correlation r of their estimation errors."""

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
    """The identifiable sum of each group of redundant parameters (a6 + aTCP, theta4 - beta4).

    Left out are sums whose sigma is not below half their tolerance at these poses, and groups that a motion of the
    scanner's frame can replace (d1, theta1 - beta1).
    """
    analysis = redundancy_of(calibration.dataset)
    blind = set(absorbed_by_scanner_frame(calibration.dataset))
    names = {p.name for p in calibration.fit.parameters}
    row = {name: i for i, name in enumerate(analysis.parameters)}
    sums = []
    for group in analysis.groups:
        present = [name for name in group if name in names and name not in blind]
        if len(present) > 1:
            sign = {n: float(np.sign(analysis.pearson[row[group[0]], row[n]])) for n in present}
            sums.append(combination(calibration, sign))
    return tuple(each for each in sums if each.is_known)


def correlated_pairs(calibration: Calibration) -> tuple[CorrelatedPair, ...]:
    """Pairs of parameters whose estimation errors correlate beyond `CORRELATED`, the strongest first."""
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


@dataclass(frozen=True)
class JointKnowledge:
    """Covariance (P + 6, P + 6) of a fit's parameters together with a setup's scanner frame.

    The frame is fitted with the parameters x: a change dx moves it by -F^+ J dx (F the frame's columns at the training
    points, J the parameters'), and given x its covariance is that by these points.
    """

    covariance: Array
    centre_mm: Array  # (3,) about which the frame turns, scanner frame
    follows: Array  # (6, P) by which the frame moves with the parameters
    frame_root: Array  # (6, K) root of the frame's own covariance, the parameters known

    @classmethod
    def of(cls, calibration: Calibration, setup: str | None) -> JointKnowledge:
        """Covariance of a fit's parameters and a setup's scanner frame (zero for the frame without a setup).

        Raises FitError for a setup without training points.
        """
        fit = calibration.fit
        n = len(fit.x)
        if setup is None:
            covariance = np.zeros((n + 6, n + 6))
            covariance[:n, :n] = fit.covariance
            return cls(covariance, np.zeros(3), np.zeros((6, n)), np.zeros((6, 0)))
        observed = Observations.of(calibration.fitted_dataset)
        rows = observed.setup == setup
        if not rows.any():
            known = sorted(set(map(str, observed.setup)))
            raise FitError(f"setup {setup!r} has no training points; there are {known}")
        observed = replace(observed, scanner_T_base=calibration.after.scanner_T_base)
        at_mm, by_x = linearise_points(calibration.model, fit.x, observed)
        scanner_T_base = calibration.after.scanner_T_base[setup]
        seen_mm = frames.apply(scanner_T_base, at_mm[rows])
        noise = fit.reduced_chi if np.isfinite(fit.reduced_chi) else 1.0
        turned = scanner_T_base[:3, :3] @ by_x[rows]
        return cls.of_points(
            fit.covariance, noise, seen_mm, turned, observed.whiten[rows], known=observed.frame_is_known(rows)
        )

    @classmethod
    def of_points(
        cls, parameters: Array, noise_ratio: float, seen_mm: Array, by_x: Array, whiten: Array, *, known: bool = False
    ) -> JointKnowledge:
        """Covariance of parameters and of a frame that is fitted to M points.

        Args:
            parameters: (P, P) covariance of the parameters.
            noise_ratio: sigma of the points over what their covariances say.
            seen_mm: (M, 3) predicted points, scanner frame.
            by_x: (M, 3, P) their derivative by the parameters, the frame at rest.
            whiten: (M, C, 3) what whitens the errors of the measured points.
            known: whether the frame was not fitted.
        """
        n, count = len(parameters), len(seen_mm)
        covariance = np.zeros((n + 6, n + 6))
        covariance[:n, :n] = parameters
        centre_mm = seen_mm.mean(axis=0)
        columns = (whiten @ by_x).reshape(whiten.shape[1] * count, -1)
        motion = whitened_motion(seen_mm, centre_mm, whiten).reshape(len(columns), 6)
        pseudo = np.linalg.pinv(motion * (not known), rcond=1e-9)
        follows = -pseudo @ columns  # (6, P)
        covariance[n:, :n] = follows @ parameters
        covariance[:n, n:] = covariance[n:, :n].T
        frame_root = np.asarray(np.linalg.qr((noise_ratio * pseudo).T, mode="r")).T
        covariance[n:, n:] = follows @ parameters @ follows.T + frame_root @ frame_root.T
        return cls(covariance, centre_mm, follows, frame_root)
