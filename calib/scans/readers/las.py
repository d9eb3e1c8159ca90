"""LAS files (.las), versions 1.0 to 1.4, of all point formats; the compressed form (.laz) is told how to be unpacked.

Source: ASPRS, LAS Specification 1.4 R15. Coordinates are integers, each with a scale and an offset of the header.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from calib.errors import ScanError
from calib.scans.readers.parsing import PointsAndNormals, doubles, require_bounded, truncated

_SIGNATURE = b"LASF"
_HEADER_BYTES = 227  # of version 1.0; 1.4 has 375
_COMPRESSED = 0x80  # this bit of the point format, as LASzip sets it
_COUNT_OF_1_4 = 247  # place of the number of points where it has 64 bits


def read_las(path: Path, content: bytes) -> PointsAndNormals:
    """Points of a .las file, without normals, in the file's unit. Raises ScanError."""
    if not content.startswith(_SIGNATURE) or len(content) < _HEADER_BYTES:
        raise ScanError(f"{path}: not a .las file (it starts with {content[:8]!r}); export the scan again")
    minor, first, point_format, size, rows = content[25], *struct.unpack_from("<I4xBHI", content, 96)
    if point_format & _COMPRESSED:
        raise ScanError(
            f"{path}: the points are compressed (.laz); unpack them with laszip, or with PDAL: "
            f"pdal translate {path.name} {path.stem}.las"
        )
    if minor >= 4 and not rows and len(content) >= _COUNT_OF_1_4 + 8:
        (rows,) = struct.unpack_from("<Q", content, _COUNT_OF_1_4)
    scale_and_offset = np.array(struct.unpack_from("<6d", content, 131))
    if size < 12 or first < _HEADER_BYTES or not np.isfinite(scale_and_offset).all():
        raise ScanError(
            f"{path}: the header is damaged ({size} bytes a point, from byte {first}); export the scan again"
        )
    there = max(len(content) - first, 0) // size
    if there < rows:
        raise truncated(path, rows, there)
    require_bounded(path, rows)
    kind = np.dtype({"names": ["xyz"], "formats": ["(3,)<i4"], "offsets": [0], "itemsize": size})
    with np.errstate(over="ignore"):
        points = doubles(np.frombuffer(content, kind, rows, first)["xyz"]) * scale_and_offset[:3] + scale_and_offset[3:]
    return points, None
