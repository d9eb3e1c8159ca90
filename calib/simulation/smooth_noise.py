"""Smooth noise of a scanner: an error that neighbouring points share, as a Gaussian random field across the view.

The field is drawn on a lattice that is fine beside its waves, and interpolated: over one view it is the same surface
however many rays there are, and a million of them take no longer than the interpolation does.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from calib.array_types import Array

SHORT_WAVES = 0.27
"""Correlation length of the short waves over that of the long ones.

With `short_share` 0.2 and long waves of 30 mm the correlation is that of a sheet which a structured-light scanner
measured (RegHEC, `data/Plane`; residuals of a plane): 0.98, 0.83, 0.61, 0.25 at 1.5, 10, 22, 45 mm, where the sheet's
has 0.97, 0.80 to 0.87, 0.57 to 0.72, 0.17 to 0.31. Neither one Gaussian nor one exponential has that shape.
"""

_CELLS_A_LENGTH = 4.0
_REACH = 4.0  # standard deviations of the filter


def smooth_noise(
    across_mm: Array, length_mm: float, short_share: float, *, rng: np.random.Generator
) -> Array:
    """A field of variance 1 at places across the view. across_mm  # (..., 2), returns (...)

    Its correlation is (1 - s) exp(-r^2 / 2 l^2) + s exp(-r^2 / 2 (0.27 l)^2) with l = length_mm, s = short_share.
    """
    field = np.zeros(across_mm.shape[:-1])
    for share, length in ((1.0 - short_share, length_mm), (short_share, SHORT_WAVES * length_mm)):
        if share > 0:
            field += np.sqrt(share) * _gaussian_field(across_mm, length, rng)
    return field


def _gaussian_field(across_mm: Array, length_mm: float, rng: np.random.Generator) -> Array:
    """Of correlation exp(-r^2 / 2 l^2): white noise filtered by a Gaussian of standard deviation l / sqrt(2)."""
    cell_mm = length_mm / _CELLS_A_LENGTH
    width = _CELLS_A_LENGTH / np.sqrt(2.0)  # of the filter, in cells
    margin = int(np.ceil(_REACH * width)) + 2
    flat = across_mm.reshape(-1, 2)
    start = flat.min(axis=0)
    cells = np.ceil((flat.max(axis=0) - start) / cell_mm).astype(int) + 1
    white = rng.standard_normal(tuple(cells + 2 * margin))
    lattice = gaussian_filter(white, width, truncate=_REACH) * (2.0 * np.sqrt(np.pi) * width)
    place = (flat - start).T / cell_mm + margin
    return np.asarray(map_coordinates(lattice, place, order=3)).reshape(across_mm.shape[:-1])
