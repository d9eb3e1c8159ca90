"""Where a scanner stands, from a place and what it looks at."""

from __future__ import annotations

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.errors import CalibError


def scanner_at(place_mm: Array, toward_mm: Array) -> Array:
    """base_T_scanner (4, 4) at a place (3,), looking at a point (3,), its image upright: z forward, y down.

    Raises CalibError where both are the same point.
    """
    along = np.asarray(toward_mm, dtype=float) - place_mm
    length = float(np.linalg.norm(along))
    if length < 1.0:
        raise CalibError("the scanner looks at where it stands; name a point in front of it")
    z = along / length
    up = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    x = np.cross(z, up)
    x /= np.linalg.norm(x)
    return frames.make_transform(np.column_stack([x, np.cross(z, x), z]), place_mm)
