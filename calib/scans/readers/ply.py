"""Polygon files (.ply): text, and binary of both byte orders. Only the vertices are read.

Source: Turk, "The PLY Polygon File Format" (1994). Other readers fail on damaged or hostile files: trimesh returns a
part of a truncated text file, Open3D fills up with zeros and prints, plyfile makes arrays as large as the header says
and loops over the rows of an element without properties. plyfile also rounds text to the header's float and reads every
face of a mesh in Python; the tests compare whole files with it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

from calib.array_types import Array
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

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_END = re.compile(rb"[\r\n]end_header[^\r\n]*\r?\n")
_OLD_MAC_END = re.compile(rb"\rend_header[^\r\n]*\r")
_BYTE_ORDER = {"binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass
class _Element:
    """One `element` of a .ply header: its number of rows and the properties of each row."""

    name: str
    rows: int
    names: list[str] = field(default_factory=list)
    types: list[tuple[str, ...]] = field(default_factory=list)  # (type,), or of a list (its count's, its values')

    def has_lists(self) -> bool:
        """Whether a property is a list, so that rows differ in length."""
        return any(len(types) > 1 for types in self.types)

    def row_type(self, order: str) -> np.dtype:
        """numpy type of a row without lists; its fields are numbered, since names may occur twice."""
        return np.dtype([(f"f{i}", order + types[0]) for i, types in enumerate(self.types)])


def read_ply(path: Path, content: bytes) -> PointsAndNormals:
    """Vertices of a .ply file, with normals where it has them. Raises ScanError."""
    kind, elements, body = _header(path, content)
    at = next((i for i, element in enumerate(elements) if element.name.lower() == "vertex"), None)
    if at is None:
        raise ScanError(f"{path}: the .ply header names no vertices; export the scan as a point cloud")
    vertex = elements[at]
    if vertex.rows == 0:
        raise ScanError(f"{path}: the scan holds no points (element vertex 0); scan the pose again")
    columns, has_normals = columns_of(path, vertex.names)
    if any(len(vertex.types[i]) > 1 for i in columns):
        raise ScanError(f"{path}: its coordinates are lists; export the scan as a plain point cloud")
    if kind == "ascii":
        lines = text_lines(path, content[body:])
        lines = lines[sum(element.rows for element in elements[:at]) :][: vertex.rows]
        if len(lines) < vertex.rows:
            raise truncated(path, vertex.rows, len(lines))
        if vertex.has_lists():
            lines = [_without_lists(line.split(), vertex) for line in lines]
        return split(numbers(path, lines, columns), has_normals)
    order = _BYTE_ORDER[kind]
    for element in elements[:at]:
        body = _row_starts(element, content, body, order)[-1]
    if vertex.has_lists():
        return split(_stack_by_rows(path, vertex, content, body, order, columns), has_normals)
    row = vertex.row_type(order)
    held = max(0, len(content) - body) // row.itemsize
    if held < vertex.rows:
        raise truncated(path, vertex.rows, held)
    require_bounded(path, vertex.rows)
    table = np.frombuffer(content, row, vertex.rows, body)
    return split(_stack(table, columns), has_normals)


def write_ply(file: IO[bytes], points_mm: Array, normals: Array | None) -> None:
    """Write points and, where there are any, normals (N, 3) as a binary little-endian .ply of float32."""
    columns = ["x", "y", "z"] if normals is None else ["x", "y", "z", "nx", "ny", "nz"]
    rows = points_mm if normals is None else np.hstack([points_mm, normals])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property float {name}" for name in columns] + ["end_header", ""]
    file.write("\n".join(header).encode("ascii"))
    file.write(np.ascontiguousarray(rows, dtype="<f4").tobytes())


def _stack(table: np.ndarray, columns: list[int]) -> Array:
    """Columns of a table of rows as (N, len(columns)) float64."""
    return np.stack([doubles(table[f"f{i}"]) for i in columns], axis=1)


def _header(path: Path, content: bytes) -> tuple[str, list[_Element], int]:
    """Format, elements, and start of the body of a .ply file. Raises ScanError."""
    head = content[:MOST_HEADER_BYTES]
    line_end = next((e for e in (b"\r\n", b"\n", b"\r") if head.startswith(b"ply" + e)), b"")
    if not line_end:
        raise ScanError(f"{path}: not a .ply file (it starts with {head[:8]!r}); export the scan as .ply")
    # A file whose first line ends in \r has no \n in its header: one behind end_header belongs to the body.
    end = _OLD_MAC_END if line_end == b"\r" else _END
    last = end.search(head)
    if last is None:
        raise ScanError(f"{path}: the .ply header has no end_header line; export the scan again")
    kind = ""
    elements: list[_Element] = []
    for line in head[: last.start()].decode("ascii", "replace").splitlines():
        keyword, *rest = line.split() or [""]
        match [keyword.lower(), *rest]:
            case ["format", word, *_]:
                kind = word
            case ["element", name, rows]:
                elements.append(_Element(name, count(path, rows)))
            case ["property", "list", counts, values, name] if elements:
                elements[-1].names.append(name)
                elements[-1].types.append((_type(path, counts), _type(path, values)))
            case ["property", word, name] if elements:
                elements[-1].names.append(name)
                elements[-1].types.append((_type(path, word),))
            case ["ply" | ""] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ScanError(
                    f"{path}: the .ply header has a line {line[:60]!r}, which says nothing; export the scan again"
                )
    if kind != "ascii" and kind not in _BYTE_ORDER:
        raise ScanError(f"{path}: the .ply header has format {kind!r}; export as ascii or binary_little_endian")
    return kind, elements, last.end()


def _type(path: Path, word: str) -> str:
    """numpy type of a property's type in the header. Raises ScanError where it is unknown."""
    if word not in _TYPES:
        raise ScanError(f"{path}: the .ply header has a property of type {word[:20]!r}; export it as float")
    return _TYPES[word]


def _row_starts(element: _Element, content: bytes, start: int, order: str) -> Sequence[int]:
    """Byte offsets of an element's rows and of the end behind the last; fewer where the content is cut off before."""
    if not element.has_lists():
        size = sum(int(types[0][1:]) for types in element.types)
        return range(start, start + (element.rows + 1) * size, size) if size else [start]
    starts = [start]
    for _ in range(element.rows):
        for types in element.types:
            size = int(types[0][1:])
            if len(types) > 1:
                counted = np.frombuffer(content[start : start + size].ljust(size, b"\0"), order + types[0])[0]
                start += max(0, int(counted)) * int(types[1][1:])
            start += size
        starts.append(start)
        if start > len(content):
            break
    return starts


def _stack_by_rows(path: Path, vertex: _Element, content: bytes, start: int, order: str, columns: list[int]) -> Array:
    """Columns (N, len(columns)) of vertices that hold lists too, such as the views of each point in photogrammetry."""
    first_list = next(i for i, types in enumerate(vertex.types) if len(types) > 1)
    if max(columns) > first_list:
        raise ScanError(f"{path}: its vertices hold lists before x, y, z; export the scan as a plain point cloud")
    if vertex.rows <= len(content):  # else it is reported as truncated
        require_bounded(path, vertex.rows)
    starts = np.array(_row_starts(vertex, content, start, order))
    held = int(np.count_nonzero(starts[1:] <= len(content)))
    if held < vertex.rows:
        raise truncated(path, vertex.rows, held)
    before = _Element("", 0, vertex.names[:first_list], vertex.types[:first_list]).row_type(order)
    content_bytes = np.frombuffer(content, np.uint8)
    rows = content_bytes[starts[:-1, None] + np.arange(before.itemsize)]
    return _stack(rows.view(before)[:, 0], columns)


def _without_lists(words: list[str], vertex: _Element) -> str:
    """A vertex's line of text with one word for each property; a list is replaced by its count."""
    out: list[str] = []
    at = 0
    for types in vertex.types:
        out += words[at : at + 1]
        counted = words[at] if at < len(words) and len(types) > 1 else "0"
        at += 1 + (int(counted) if counted.isascii() and counted.isdigit() and len(counted) < 9 else 0)
    return " ".join(out)
