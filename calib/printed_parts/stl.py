"""Binary STL: the form in which slicing programs read a part.

80 bytes of text, the number of triangles, then of each its normal, three corners and two free bytes, little-endian
(3D Systems, *StereoLithography Interface Specification*). The unit is not part of the form; slicers take millimetres.
"""

from __future__ import annotations

import numpy as np

from calib.printed_parts.solid import Solid

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("free", "<u2")])
_HEADER = 80  # bytes


def binary_stl(solid: Solid, name: str) -> bytes:
    """A solid as binary STL, mm; the header is `name` in ASCII, cut to 80 bytes."""
    corners = solid.triangles_mm
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rows = np.zeros(len(corners), dtype=_TRIANGLE)
    rows["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    rows["corners"] = corners
    header = name.encode("ascii", errors="replace")[:_HEADER].ljust(_HEADER)
    return header + np.uint32(len(rows)).astype("<u4").tobytes() + rows.tobytes()
