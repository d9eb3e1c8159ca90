"""Standard Denavit-Hartenberg tables, elementary and in extended precision."""

from __future__ import annotations

import numpy as np


def exactly(rows: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Tip transform of a standard table in extended precision, as d of hundreds of metres costs three digits."""
    out = np.eye(4, dtype=np.longdouble)
    for (theta, a, d, alpha), value in zip(rows.astype(np.longdouble), q, strict=True):
        c, s, ca, sa = np.cos(theta + value), np.sin(theta + value), np.cos(alpha), np.sin(alpha)
        row = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        out = out @ np.array(row, dtype=np.longdouble)
    return out.astype(float)
