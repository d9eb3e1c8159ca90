"""LAS files (.las), versions 1.0 to 1.4, of all point formats, and compressed ones (.laz) by lazrs: the extra `laz`.

Source: ASPRS, LAS Specification 1.4 R15. Coordinates are integers, each with a scale and an offset of the header. The
record of LASzip among the header's variable-length records says how the points are compressed.
"""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.errors import ScanError
from calib.scans.readers.parsing import PointsAndNormals, doubles, one_line, require_bounded, truncated

_SIGNATURE = b"LASF"
_HEADER_BYTES = 227  # of version 1.0; 1.4 has 375
_COMPRESSED = 0x80  # this bit of the point format, as LASzip sets it
_COUNT_OF_1_4 = 247  # place of the number of points where it has 64 bits
_LASZIP = b"laszip encoded", 22204  # user and number of the record that LASzip writes
_RECORD_BYTES = 54  # of a variable-length record's own header
_ROWS_AT_A_TIME = 500_000


def read_las(path: Path, content: bytes) -> PointsAndNormals:
    """Points of a .las or .laz file, without normals, in the file's unit. Raises ScanError."""
    if not content.startswith(_SIGNATURE) or len(content) < _HEADER_BYTES:
        raise ScanError(f"{path}: not a .las file (it starts with {content[:8]!r}); export the scan again")
    minor, first, point_format, size, rows = content[25], *struct.unpack_from("<I4xBHI", content, 96)
    if minor >= 4 and not rows and len(content) >= _COUNT_OF_1_4 + 8:
        (rows,) = struct.unpack_from("<Q", content, _COUNT_OF_1_4)
    scale_and_offset = np.array(struct.unpack_from("<6d", content, 131))
    if size < 12 or first < _HEADER_BYTES or not np.isfinite(scale_and_offset).all():
        raise ScanError(
            f"{path}: the header is damaged ({size} bytes a point, from byte {first}); export the scan again"
        )
    kind = np.dtype({"names": ["xyz"], "formats": ["(3,)<i4"], "offsets": [0], "itemsize": size})
    if point_format & _COMPRESSED:
        require_bounded(path, rows)
        xyz = _unpacked(path, content, first, kind, rows)
    else:
        there = max(len(content) - first, 0) // size
        if there < rows:
            raise truncated(path, rows, there)
        require_bounded(path, rows)
        xyz = np.frombuffer(content, kind, rows, first)["xyz"]
    with np.errstate(over="ignore"):
        return doubles(xyz) * scale_and_offset[:3] + scale_and_offset[3:], None


def _unpacked(path: Path, content: bytes, first: int, kind: np.dtype[np.void], rows: int) -> NDArray[np.int32]:
    """Integer coordinates (rows, 3) of compressed points that begin at byte `first`. Raises ScanError."""
    try:
        import lazrs
    except ImportError:
        raise ScanError(
            f"{path}: compressed points (.laz) are read by lazrs, which is not installed: "
            "pip install 'robot-calibration-inspector[laz]', or unpack the file with laszip or PDAL: "
            f"pdal translate {path.name} {path.stem}.las"
        ) from None
    xyz = np.empty((rows, 3), dtype=np.int32)
    source = BytesIO(content)
    source.seek(first)
    try:
        unpacker = lazrs.LasZipDecompressor(source, _laszip_record(content))
        for start in range(0, rows, _ROWS_AT_A_TIME):
            part = xyz[start : start + _ROWS_AT_A_TIME]
            raw = bytearray(kind.itemsize * len(part))
            unpacker.decompress_many(raw)
            part[:] = np.frombuffer(raw, kind)["xyz"]
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # a panic of Rust is no Exception
        raise ScanError(
            f"{path}: its {rows} compressed points cannot be unpacked ({one_line(error)}); "
            "copy or export the scan again"
        ) from None
    return xyz


def _laszip_record(content: bytes) -> bytes:
    """Data of the record that says how the points are compressed. Raises ValueError where there is none."""
    place, count = struct.unpack_from("<H4xI", content, 94)
    for _ in range(count):
        if place + _RECORD_BYTES > len(content):
            break
        user, number, length = struct.unpack_from("<2x16sHH", content, place)
        place += _RECORD_BYTES
        if (user.rstrip(b"\0"), number) == _LASZIP:
            return content[place : place + length]
        place += length
    raise ValueError("no record says how")
