"""Noise of a calibration's points by repeats, declaration or fit, and a chi-squared test of the residual sigma."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.calibration.result import Calibration, declared_sigma_mm
from calib.dataset.dataset import Dataset
from calib.dataset.repeats import find_repeats, pooled_sigma_mm
from calib.statistics import chi2_ppf

DECLARED, REPEATS, FIT = "dataset", "repeats", "fit"
_FEWEST_DOF = 12  # degrees of freedom from which repeats give the noise
_COPY_MM = 1e-9  # repeats that scatter less are rows written twice, not measurements
_ORIGINS = {REPEATS: "noise as repeats show it", FIT: "noise as the fit left it"}


@dataclass(frozen=True)
class NoiseLevel:
    """Noise per coordinate of a measured point, and its source."""

    sigma_mm: float  # RMS over the points; nan where no one declares it and nothing shows it
    source: str  # "dataset", "repeats" or "fit"
    ratio: float  # it over what the points' covariances say, in which 1 mm stands for what is not declared
    coordinates: int = 3  # that each point tells; 1 of a length

    @property
    def floor_mm(self) -> float | None:
        """3D RMSE that noise alone causes, sqrt(3) sigma, mm (of lengths sigma); None where the noise is not known."""
        return float(np.sqrt(self.coordinates)) * self.sigma_mm if np.isfinite(self.sigma_mm) else None

    @property
    def is_declared(self) -> bool:
        """Whether the noise is declared in the dataset."""
        return self.source == DECLARED

    @property
    def name(self) -> str:
        """Name of the noise by its source, such as "noise alone" or "noise as repeats show it"."""
        return _ORIGINS.get(self.source, "noise alone")


def noise_level(calibration: Calibration) -> NoiseLevel:
    """Noise that the dataset declares, else the noise estimated from repeats, else from the fit's residual.

    Estimated from the residual it includes what is missing from the model, so that no misfit can show above it.
    """
    dataset = calibration.dataset
    assert dataset.points is not None
    coordinates = dataset.points.coordinates
    if dataset.declares_noise:
        return NoiseLevel(declared_sigma_mm(dataset), DECLARED, 1.0, coordinates)
    repeats = noise_of_repeats(dataset)
    if repeats is not None:  # of one point, which counts as one of 1 mm
        return NoiseLevel(repeats[0] * declared_sigma_mm(dataset), REPEATS, repeats[0])
    return NoiseLevel(calibration.sigma_mm, FIT, calibration.fit.reduced_chi, coordinates)


def noise_of_repeats(dataset: Dataset) -> tuple[float, float] | None:
    """Sigma per coordinate, mm, from repeats, and its degrees of freedom; None where these are too few."""
    repeats = find_repeats(dataset)
    dof = sum(3 * (r.count - 1) for r in repeats)
    sigma_mm = pooled_sigma_mm(repeats) if dof >= _FEWEST_DOF else 0.0
    return (sigma_mm, dof) if sigma_mm > _COPY_MM else None


@dataclass(frozen=True)
class SigmaCheck:
    """Residual sigma per coordinate with its 95 % interval, and the declared sigma for comparison.

    With nu degrees of freedom nu s^2 / sigma^2 follows chi^2(nu), which gives the 95 % interval.
    """

    sigma_mm: float  # s, by degrees of freedom; nan where none are left
    low_mm: float
    high_mm: float
    declared_mm: float | None  # None: the dataset declares none
    degrees_of_freedom: float

    @property
    def verdict(self) -> str:
        """Comparison of residual with declared sigma: "excess", "as declared", "below", or "unknown" without basis."""
        if self.declared_mm is None or not np.isfinite(self.sigma_mm):
            return "unknown"
        if self.declared_mm < self.low_mm:
            return "excess"
        return "below" if self.declared_mm > self.high_mm else "as declared"


def check_sigma(calibration: Calibration) -> SigmaCheck:
    """Residual sigma of a calibration with its 95 % interval, for comparison with the declared sigma."""
    dataset, dof = calibration.dataset, calibration.fit.degrees_of_freedom
    assert dataset.points is not None
    sigma = calibration.sigma_mm
    low = high = float("nan")
    if np.isfinite(sigma):
        low, high = (sigma * float(np.sqrt(dof / chi2_ppf(share, dof))) for share in (0.975, 0.025))
    declared = declared_sigma_mm(calibration.fitted_dataset) if dataset.declares_noise else None
    return SigmaCheck(sigma, low, high, declared, dof)
