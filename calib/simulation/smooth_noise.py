"""Smooth noise of a scanner: an error that neighbouring points share, as a Gaussian random field across the view.

The field is drawn on a lattice that is fine beside its waves, and interpolated: over one view it is the same surface
however many rays there are, and a million of them take no longer than the interpolation does.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from calib.array_types import Array

SHORT_WAVES = 0.15
"""Correlation length of the short waves over that of the long ones.

With `short_share` 0.3 and long waves of 25 mm the correlation has the shape by which views of one sheet differ that a
structured-light scanner took from several sides (RegHEC, `data/Plane`; what is the sheet's own shape all views share):
over that at 2 mm it is 0.88, 0.71, 0.57, 0.26, 0.01 at 4.5, 9, 18, 36, 72 mm, where the median pair of views has 0.8,
0.7, 0.54, 0.3, 0. Neither one Gaussian nor one exponential has that shape.
"""

_CELLS_A_LENGTH = 4.0
_REACH = 4.0  # standard deviations of the filter


def smooth_noise(across_mm: Array, length_mm: float, short_share: float, *, rng: np.random.Generator) -> Array:
    """A field of variance 1 at places across the view. across_mm  # (..., 2), returns (...)

    Its correlation is (1 - s) exp(-r^2 / 2 l^2) + s exp(-r^2 / 2 (0.15 l)^2) with l = length_mm, s = short_share.
    """
    field = np.zeros(across_mm.shape[:-1])
    for share, length in ((1.0 - short_share, length_mm), (short_share, SHORT_WAVES * length_mm)):
        if share > 0:
            field += np.sqrt(share) * _gaussian_field(across_mm, length, rng)
    return field


def _gaussian_field(across_mm: Array, length_mm: float, rng: np.random.Generator) -> Array:
    """A field of correlation exp(-r^2 / 2 l^2): white noise filtered by a Gaussian with sigma l / sqrt(2)."""
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
