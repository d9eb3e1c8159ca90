"""Which noise is meant where nothing else is said, and where that number comes from: declared, repeats, or the fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.calibration.result import Calibration, declared_sigma_mm, is_declared
from calib.dataset.dataset import Dataset
from calib.dataset.repeats import find_repeats, pooled_sigma_mm

DECLARED, REPEATS, FIT = "dataset", "repeats", "fit"
_FEWEST_DOF = 12  # degrees of freedom from which on repeats tell the noise
_COPY_MM = 1e-9  # repeats that scatter less are rows written twice, which tell nothing of the noise
_ORIGINS = {REPEATS: "noise as repeats show it", FIT: "noise as the fit left it"}


@dataclass(frozen=True)
class NoiseLevel:
    """The noise of one coordinate of a measured point."""

    sigma_mm: float  # RMS over the points; nan where no one declares it and nothing shows it
    source: str  # "dataset", "repeats" or "fit"
    ratio: float  # it over what the points' covariances say, in which 1 mm stands for what is not declared

    @property
    def floor_mm(self) -> float | None:
        """3D RMSE that this noise alone would leave, sqrt(3) sigma; None where it is not known."""
        return float(np.sqrt(3.0)) * self.sigma_mm if np.isfinite(self.sigma_mm) else None

    @property
    def is_declared(self) -> bool:
        """Whether the dataset says it."""
        return self.source == DECLARED

    @property
    def name(self) -> str:
        """ "noise alone", or "noise as the fit left it" where no one declares it."""
        return _ORIGINS.get(self.source, "noise alone")

    def words(self, length: str, of: str = "") -> str:
        """What it is, with a length: "noise alone (0.05 mm a coordinate)" of "0.05 mm" and " a coordinate"."""
        return f"{self.name} ({length}{of}{'' if self.is_declared else ': not declared'})"


def noise_level(calibration: Calibration) -> NoiseLevel:
    """The noise as the dataset declares it, else as repeats show it, else as the fit left it.

    As the fit left it, it holds what is missing from the model, too: what is left is never more than that.
    """
    dataset = calibration.dataset
    if is_declared(dataset):
        return NoiseLevel(declared_sigma_mm(dataset), DECLARED, 1.0)
    repeats = noise_of_repeats(dataset)
    if repeats is not None:  # of one point, which counts as one of 1 mm
        return NoiseLevel(repeats[0] * declared_sigma_mm(dataset), REPEATS, repeats[0])
    return NoiseLevel(calibration.sigma_mm, FIT, calibration.fit.reduced_chi)


def noise_of_repeats(dataset: Dataset) -> tuple[float, float] | None:
    """Sigma of a coordinate, mm, and its degrees of freedom, by points measured again; None where too few tell it."""
    repeats = find_repeats(dataset)
    dof = sum(3 * (r.count - 1) for r in repeats)
    sigma_mm = pooled_sigma_mm(repeats) if dof >= _FEWEST_DOF else 0.0
    return (sigma_mm, dof) if sigma_mm > _COPY_MM else None
