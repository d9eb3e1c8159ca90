"""LAS files (.las) and compressed ones (.laz), by laspy with lazrs: the extra `laz`."""

from __future__ import annotations

import logging
import struct
from io import BytesIO
from pathlib import Path

import numpy as np

from calib.errors import ScanError
from calib.scans.readers.parsing import PointsAndNormals, one_line, require_bounded, truncated

_HEADER_BYTES = 227  # of version 1.0; 1.4 has 375
_RECORD_BYTES = 54  # of a variable-length record's own header


def read_las(path: Path, content: bytes) -> PointsAndNormals:
    """Points of a .las or .laz file, without normals, in the file's unit. Raises ScanError."""
    try:
        import laspy
    except ImportError:
        raise ScanError(
            f"{path}: .las and .laz are read by laspy, which is not installed: "
            "pip install 'robot-calibration-inspector[laz]', or export the scan as .ply"
        ) from None
    _refuse_countless_records(path, content)
    logging.getLogger("laspy").setLevel(logging.CRITICAL)  # what it says stands in the error
    try:
        with laspy.open(BytesIO(content)) as reader:
            header = reader.header
            there = (len(content) - header.offset_to_point_data) // header.point_format.size
            if there < header.point_count and not header.are_points_compressed:
                raise truncated(path, header.point_count, max(there, 0))
            require_bounded(path, header.point_count)
            points = reader.read_points(header.point_count)
            with np.errstate(over="ignore"):
                return np.stack([points.x, points.y, points.z], axis=1), None
    except (ScanError, KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # a panic of Rust is no Exception
        raise ScanError(f"{path}: not a readable .las ({one_line(error)}); copy or export the scan again") from None


def _refuse_countless_records(path: Path, content: bytes) -> None:
    """Raise ScanError for a header that counts more records than there are bytes, which laspy would try to read."""
    if len(content) < _HEADER_BYTES:
        return  # no header at all, which laspy says
    header, first, records = struct.unpack_from("<HII", content, 94)
    further = struct.unpack_from("<I", content, 243)[0] if content[25] >= 4 and len(content) >= 247 else 0
    if _RECORD_BYTES * records > max(first - header, 0) or _RECORD_BYTES * further > len(content):
        raise ScanError(f"{path}: the header is damaged ({records + further} records); export the scan again")
