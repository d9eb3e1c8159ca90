"""Polygon files (.ply): text, and binary of both byte orders. Only the vertices are read.

Source: Turk, "The PLY Polygon File Format" (1994). Other readers fail on damaged or hostile files: trimesh returns a
part of a truncated text file, Open3D fills up with zeros and prints, plyfile makes arrays as large as the header says
and loops over the rows of an element without properties. plyfile also rounds text to the header's float and reads every
face of a mesh in Python; the tests compare whole files with it.
"""

from __future__ import annotations

import re
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
    name: kind
    for kind, names in {
        "i1": "char int8",
        "u1": "uchar uint8",
        "i2": "short int16",
        "u2": "ushort uint16",
        "i4": "int int32",
        "u4": "uint uint32",
        "f4": "float float32",
        "f8": "double float64",
    }.items()
    for name in names.split()
}
_END = re.compile(rb"[\r\n]end_header[^\r\n]*\r?\n")
_OLD_MAC_END = re.compile(rb"\rend_header[^\r\n]*\r")
_BYTE_ORDER = {"binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass
class _Element:
    """One `element` of a .ply header: its number of rows and the properties of each row."""

    name: str
    rows: int
    names: list[str] = field(default_factory=list)
    types: list[str] = field(default_factory=list)  # numpy's, or "list", whose rows differ in length

    def row_type(self, order: str) -> np.dtype:
        """numpy type of a row without lists; its fields are numbered, since names may occur twice."""
        return np.dtype([(f"f{i}", order + kind) for i, kind in enumerate(self.types)])


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
    if any("list" in element.types for element in (vertex, *elements[: at if kind != "ascii" else 0])):
        raise ScanError(f"{path}: lists stand before or among its vertices; export the scan as a plain point cloud")
    if kind == "ascii":
        lines = text_lines(path, content[body:])
        lines = lines[sum(element.rows for element in elements[:at]) :][: vertex.rows]
        if len(lines) < vertex.rows:
            raise truncated(path, vertex.rows, len(lines))
        return split(numbers(path, lines, columns), has_normals)
    row = vertex.row_type(_BYTE_ORDER[kind])
    body += sum(element.rows * element.row_type("<").itemsize for element in elements[:at])
    held = max(0, len(content) - body) // row.itemsize
    if held < vertex.rows:
        raise truncated(path, vertex.rows, held)
    require_bounded(path, vertex.rows)
    table = np.frombuffer(content, row, vertex.rows, body)
    return split(np.stack([doubles(table[f"f{i}"]) for i in columns], axis=1), has_normals)


def write_ply(file: IO[bytes], points_mm: Array, normals: Array | None) -> None:
    """Write points and, where there are any, normals (N, 3) as a binary little-endian .ply of float32."""
    columns = ["x", "y", "z"] if normals is None else ["x", "y", "z", "nx", "ny", "nz"]
    rows = points_mm if normals is None else np.hstack([points_mm, normals])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property float {name}" for name in columns] + ["end_header", ""]
    file.write("\n".join(header).encode("ascii"))
    file.write(np.ascontiguousarray(rows, dtype="<f4").tobytes())


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
            case ["property", "list", _, _, name] if elements:
                elements[-1].names.append(name)
                elements[-1].types.append("list")
            case ["property", word, name] if elements:
                elements[-1].names.append(name)
                elements[-1].types.append(_type(path, word))
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
