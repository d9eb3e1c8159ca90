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


def check_sigma(calibration: Calibration) -> SigmaCheck:
    """The residual sigma of a calibration with its 95 % interval, beside the declared one."""
    dataset, freedom = calibration.dataset, calibration.fit.degrees_of_freedom
    assert dataset.points is not None
    sigma = calibration.sigma_mm
    low = high = float("nan")
    if np.isfinite(sigma):
        low, high = (sigma * float(np.sqrt(freedom / chi2_ppf(share, freedom))) for share in (0.975, 0.025))
    declared = declared_sigma_mm(calibration.fitted_dataset) if is_declared(dataset) else None
    return SigmaCheck(sigma, low, high, declared, freedom)
