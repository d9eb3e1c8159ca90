"""Polygon files (.ply): text, and binary of both byte orders. Only the vertices are read.

Source: Turk, "The PLY Polygon File Format" (1994). Other readers fail on damaged or hostile files: trimesh returns a
part of a truncated text file, Open3D fills up with zeros and prints, plyfile makes arrays as large as the header says
and loops over the rows of an element without properties. plyfile also rounds text to the header's float and reads every
face of a mesh in Python; the tests compare whole files with it.
"""

from __future__ import annotations

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
_BYTE_ORDER = {"binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass
class _Element:
    """One `element` of the header: how many rows, and what each row holds."""

    name: str
    rows: int
    names: list[str] = field(default_factory=list)
    types: list[tuple[str, ...]] = field(
        default_factory=list
    )  # (type,), or of a list (its count's, its values')

    def has_lists(self) -> bool:
        return any(len(types) > 1 for types in self.types)

    def row_type(self, order: str) -> np.dtype:
        """A row without lists as numpy sees it; its fields are numbered, since names may stand twice."""
        return np.dtype([(f"f{i}", order + types[0]) for i, types in enumerate(self.types)])


def read_ply(path: Path, content: bytes) -> PointsAndNormals:
    """The vertices of a .ply, with normals where it has them. Raises ScanError."""
    kind, elements, body = _header(path, content)
    at = next((i for i, element in enumerate(elements) if element.name == "vertex"), None)
    if at is None:
        raise ScanError(f"{path}: the .ply header names no vertices; export the scan as a point cloud")
    vertex = elements[at]
    if vertex.rows == 0:
        raise ScanError(f"{path}: the scan holds no points (element vertex 0); scan the pose again")
    columns, has_normals = columns_of(path, vertex.names)
    if vertex.has_lists():
        raise ScanError(f"{path}: its vertices hold lists; export the scan as a plain point cloud")
    if kind == "ascii":
        lines = text_lines(content[body:])
        lines = lines[sum(element.rows for element in elements[:at]) :][: vertex.rows]
        if len(lines) < vertex.rows:
            raise truncated(path, vertex.rows, len(lines))
        return split(numbers(path, lines, columns), has_normals)
    order = _BYTE_ORDER[kind]
    for element in elements[:at]:
        body = _end_of(element, content, body, order)
    row = vertex.row_type(order)
    held = max(0, len(content) - body) // row.itemsize
    if held < vertex.rows:
        raise truncated(path, vertex.rows, held)
    table = np.frombuffer(content, row, vertex.rows, body)
    return split(_stack(table, columns), has_normals)


def write_ply(file: IO[bytes], points_mm: Array, normals: Array | None) -> None:
    """Write binary little-endian float32, with normals where there are any. points_mm, normals  # (N, 3)"""
    columns = ["x", "y", "z"] if normals is None else ["x", "y", "z", "nx", "ny", "nz"]
    rows = points_mm if normals is None else np.hstack([points_mm, normals])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property float {name}" for name in columns] + ["end_header", ""]
    file.write("\n".join(header).encode("ascii"))
    file.write(np.ascontiguousarray(rows, dtype="<f4").tobytes())


def _stack(table: np.ndarray, columns: list[int]) -> Array:
    return np.stack([doubles(table[f"f{i}"]) for i in columns], axis=1)


def _header(path: Path, content: bytes) -> tuple[str, list[_Element], int]:
    """The format, the elements, and where the body starts."""
    head = content[:MOST_HEADER_BYTES]
    line_end = next((e for e in (b"\r\n", b"\n", b"\r") if head.startswith(b"ply" + e)), None)
    if line_end is None:
        raise ScanError(f"{path}: not a .ply file (it starts with {head[:8]!r}); export the scan as .ply")
    last = head.find(line_end + b"end_header")
    body = head.find(line_end, last + len(line_end)) + len(line_end)
    if last < 0 or body < last + len(line_end):
        raise ScanError(f"{path}: the .ply header has no end_header line; export the scan again")
    kind = ""
    elements: list[_Element] = []
    for line in head[:last].decode("ascii", "replace").splitlines():
        match line.split():
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
            case ["ply"] | ["comment" | "obj_info", *_] | []:
                pass
            case _:
                raise ScanError(
                    f"{path}: the .ply header has a line {line[:60]!r}, which says nothing; export the scan again"
                )
    if kind != "ascii" and kind not in _BYTE_ORDER:
        raise ScanError(
            f"{path}: the .ply header has format {kind!r}; export as ascii or binary_little_endian"
        )
    return kind, elements, body


def _type(path: Path, word: str) -> str:
    if word not in _TYPES:
        raise ScanError(f"{path}: the .ply header has a property of type {word[:20]!r}; export it as float")
    return _TYPES[word]


def _end_of(element: _Element, content: bytes, start: int, order: str) -> int:
    """Where the rows of an element before the vertices end; past the content where they are cut."""
    if not element.has_lists():
        return start + element.rows * sum(int(types[0][1:]) for types in element.types)
    for _ in range(element.rows):
        for types in element.types:
            if len(types) > 1:
                size = int(types[0][1:])
                counted = np.frombuffer(content[start : start + size].ljust(size, b"\0"), order + types[0])[0]
                start += size + max(0, int(counted)) * int(types[1][1:])
            else:
                start += int(types[0][1:])
        if start > len(content):
            break
    return start
