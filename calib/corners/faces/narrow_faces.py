"""Faces a few pixels wide, fitted again once what the jig's edges did to their points is taken back."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from calib.array_types import Array, IndexArray
from calib.corners.faces.face_outline import flat_margin_mm
from calib.corners.faces.mixed_pixels import find_mixed_pixels, moved_back, seen_on_face
from calib.jig import Jig, Outline
from calib.planes.robust_fit import PlaneFit

_ROUNDS = 3
_BAND_SIGMA = 12.0
_MARGIN_SIGMA = 3.0

FitFace = Callable[[Array, Array, IndexArray, int, float], PlaneFit]
"""The fit of one face to some points: points (K, 3), their heights (K, 3), their indices (K,), the face, its margin."""


def refit_narrow_faces(
    local: Array,
    near: IndexArray,
    planes: Sequence[PlaneFit],
    margins_mm: Array,
    origin: Array,
    jig: Jig,
    outline: Outline,
    fit: FitFace,
) -> tuple[list[PlaneFit], Array]:
    """The three fits, and the margins (3,) that were left out; as they were where no pixels mix or no face is narrow.

    local  # (N, 3) about origin (3,), near  # (N,) their indices. Raises CornerError as `fit` does.
    """
    refitted, margins = list(planes), np.array(margins_mm, dtype=float)
    for _ in range(_ROUNDS):
        mixed = find_mixed_pixels(local, refitted, origin, jig, outline)
        if mixed is None:
            return list(planes), np.asarray(margins_mm)
        heights = np.column_stack([local @ plane.normal - plane.offset_mm for plane in refitted])
        after = list(planes)
        for face in np.flatnonzero(mixed.faces).tolist():
            plane = refitted[face]
            moved = moved_back(local, refitted, face, origin, jig, mixed)
            over = heights.copy()
            over[:, face] = moved @ plane.normal - plane.offset_mm
            clear = seen_on_face(local, refitted, face, origin, mixed.grid, jig, outline)
            rows = np.flatnonzero(clear & (np.abs(over[:, face]) < _BAND_SIGMA * plane.sigma_mm))
            margins[face] = max(flat_margin_mm(over[rows], face, plane, jig, outline), _MARGIN_SIGMA * plane.sigma_mm)
            after[face] = fit(moved[rows], over[rows], near[rows], face, float(margins[face]))
        refitted = after
    return refitted, margins
