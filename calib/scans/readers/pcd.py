"""Point Cloud Library files (.pcd): text, binary and compressed.

Source: "The PCD (Point Cloud Data) file format", pointclouds.org, and the description of liblzf's stream. Open3D reads
it too, but in C++ inside this process, which a damaged file could end.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

import numpy as np

from calib.errors import ScanError
from calib.scans.readers.parsing import (
    MOST_HEADER_BYTES,
    PointsAndNormals,
    columns_of,
    count,
    doubles,
    numbers,
    require_bounded,
    split,
    text_lines,
    truncated,
)

_TYPES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}  # bytes that a value of each TYPE may have
_MOST_TIMES = 88  # the most that LZF packs: 264 bytes into three
_MOST_VALUES = 65535  # of one field; a histogram has hundreds


@dataclass(frozen=True)
class _Header:
    """The header of a .pcd file; a field is one column or `counts` adjacent columns."""

    names: list[str]
    types: list[str]  # numpy's, without byte order
    counts: list[int]
    points: int
    data: str
    body: int  # where it starts

    def field_bytes(self) -> list[int]:
        """Bytes of each field in one row."""
        return [int(kind[1:]) * n for kind, n in zip(self.types, self.counts, strict=True)]


def read_pcd(path: Path, content: bytes) -> PointsAndNormals:
    """Points of a .pcd file, organised or not, with normals where it has them. Raises ScanError."""
    header = _header(path, content)
    if header.points == 0:
        raise ScanError(f"{path}: the scan holds no points (POINTS 0); scan the pose again")
    fields, has_normals = columns_of(path, header.names)
    sizes = header.field_bytes()
    row, size = sum(sizes), len(content) - header.body
    if header.data == "ascii":
        lines = [line for line in text_lines(path, content[header.body :]) if not line.lstrip().startswith("#")]
        if len(lines) < header.points:
            raise truncated(path, header.points, len(lines))
        first = list(accumulate(header.counts, initial=0))
        return split(numbers(path, lines[: header.points], [first[i] for i in fields]), has_normals)
    if header.data == "binary":
        if size // row < header.points:
            raise truncated(path, header.points, size // row)
        require_bounded(path, header.points)
        offset = list(accumulate(sizes, initial=0))
        table = np.frombuffer(content, np.uint8, header.points * row, header.body).reshape(-1, row)
        columns = [
            np.ascontiguousarray(table[:, offset[i] : offset[i] + int(header.types[i][1:])]).view(
                "<" + header.types[i]
            )[:, 0]
            for i in fields
        ]
    elif header.data == "binary_compressed":
        unpacked = _unpack(path, content, header, row * header.points)
        offset = [n * header.points for n in accumulate(sizes, initial=0)]  # one field after the other
        columns = [
            np.frombuffer(unpacked, "<" + header.types[i], header.points * header.counts[i], offset[i])[
                :: header.counts[i]
            ]
            for i in fields
        ]
    else:
        raise ScanError(f"{path}: the .pcd has DATA {header.data[:20]!r}; export as ascii, binary or binary_compressed")
    return split(np.stack([doubles(column) for column in columns], axis=1), has_normals)


def _header(path: Path, content: bytes) -> _Header:
    """Header of a .pcd file, its fields checked against the format. Raises ScanError."""
    lines: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in lines and (end := content.find(b"\n", start, MOST_HEADER_BYTES)) >= 0:
        words = content[start:end].decode("ascii", "replace").split()
        lines |= {words[0]: words[1:]} if words else {}
        start = end + 1
    try:
        names = lines["FIELDS"] if "FIELDS" in lines else lines["COLUMNS"]  # as before version 0.6
        values = lines.get("COUNT", ["1"] * len(names))
        if "POINTS" in lines:
            points = count(path, lines["POINTS"][0])
        else:
            points = count(path, lines["WIDTH"][0]) * count(path, lines["HEIGHT"][0])
        described = list(zip(names, lines["TYPE"], lines["SIZE"], values, strict=True))
        data = lines["DATA"][0]
    except (KeyError, IndexError, ValueError):
        raise ScanError(
            f"{path}: not a .pcd file (no FIELDS, SIZE, TYPE, POINTS and DATA lines that agree); export the scan again"
        ) from None
    for name, kind, size, n in described:
        if size not in map(str, _TYPES.get(kind, ())) or not 0 < count(path, n) <= _MOST_VALUES:
            raise ScanError(
                f"{path}: the .pcd's field {name[:20]!r} has TYPE {kind[:9]}, SIZE {size[:9]}, COUNT {n[:9]}; "
                "export the scan again"
            )
    types = [kind.lower() + size for _, kind, size, _ in described]
    return _Header(names, types, [int(n) for n in values], points, data, start)


def _unpack(path: Path, content: bytes, header: _Header, needed: int) -> bytes:
    """Unpacked bytes of a compressed body: two lengths (4 bytes each), then the packed block. Raises ScanError."""
    body = content[header.body :]
    packed, unpacked = int.from_bytes(body[:4], "little"), int.from_bytes(body[4:8], "little")
    if len(body) < 8 or len(body) - 8 < packed or unpacked < needed:
        raise truncated(path, header.points, 0)  # all z come after all x and y: no point is whole
    require_bounded(path, header.points)
    if unpacked > _MOST_TIMES * packed:
        raise ScanError(f"{path}: the compressed points are damaged; copy or export the scan again")
    try:
        return unpack_lzf(body[8 : 8 + packed], unpacked)
    except (ValueError, IndexError):
        raise ScanError(f"{path}: the compressed points are damaged; copy or export the scan again") from None


def unpack_lzf(packed: bytes, length: int) -> bytes:
    """Bytes unpacked from an LZF stream: a control byte n < 32 precedes n + 1 literals, any other repeats output.

    Raises ValueError or IndexError where the stream is damaged or does not give `length` bytes.
    """
    out = bytearray()
    i = 0
    while i < len(packed) and len(out) <= length:
        control = packed[i]
        i += 1
        if control < 32:
            out += packed[i : i + control + 1]
            i += control + 1
            continue
        run = control >> 5
        if run == 7:
            run += packed[i]
            i += 1
        run += 2
        back = ((control & 31) << 8) + packed[i] + 1
        i += 1
        start = len(out) - back
        if start < 0:
            raise ValueError("a repeat from before the start")
        if back >= run:
            out += out[start : start + run]
        else:  # it repeats what it has just written
            out += (out[start:] * (run // back + 1))[:run]
    if len(out) != length or i != len(packed):
        raise ValueError(f"{len(out)} bytes of {length}")
    return bytes(out)
