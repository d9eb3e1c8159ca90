"""The residual sigma against the declared one: whether more is left than measurement noise (chi-squared interval)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.calibration.result import Calibration, declared_sigma_mm, is_declared
from calib.distributions import chi2_ppf


@dataclass(frozen=True)
class SigmaCheck:
    """One coordinate's noise as the residual shows it, against what was declared.

    With nu degrees of freedom nu s^2 / sigma^2 follows chi^2(nu), which gives the 95 % interval.
    """

    sigma_mm: float  # s, by degrees of freedom; nan where none are left
    low_mm: float
    high_mm: float
    declared_mm: float | None  # None: the dataset declares none
    degrees_of_freedom: float

    @property
    def verdict(self) -> str:
        """ "excess", "as declared", "below", or "unknown" without a declared sigma or degrees of freedom."""
        if self.declared_mm is None or not np.isfinite(self.sigma_mm):
            return "unknown"
        if self.declared_mm < self.low_mm:
            return "excess"
        return "below" if self.declared_mm > self.high_mm else "as declared"

    def summary(self) -> str:
        if not np.isfinite(self.sigma_mm):
            return "residual sigma: no degree of freedom is left to tell it"
        found = (
            f"residual sigma {self.sigma_mm:.4g} mm a coordinate "
            f"(95 %: {self.low_mm:.4g} to {self.high_mm:.4g}, {self.degrees_of_freedom:.0f} degrees of freedom)"
        )
        if self.declared_mm is None:
            return f"{found}; no sigma is declared, so this holds noise and missing physics together"
        meaning = {
            "excess": "more than noise is left: physics is missing from the model, or sigma was declared too small",
            "as declared": "nothing but noise is left",
            "below": "less than declared: sigma was declared too large",
        }[self.verdict]
        ratio = self.sigma_mm / self.declared_mm
        return f"{found}, {ratio:.3g} times the declared {self.declared_mm:.4g} mm: {meaning}"


def check_sigma(calibration: Calibration) -> SigmaCheck:
    """The residual sigma of a calibration with its 95 % interval, beside the declared one."""
    dataset, dof = calibration.dataset, calibration.fit.degrees_of_freedom
    assert dataset.points is not None
    sigma = calibration.sigma_mm
    low = high = float("nan")
    if np.isfinite(sigma):
        low, high = (sigma * float(np.sqrt(dof / chi2_ppf(share, dof))) for share in (0.975, 0.025))
    declared = declared_sigma_mm(calibration.fitted_dataset) if is_declared(dataset) else None
    return SigmaCheck(sigma, low, high, declared, dof)
