"""The vertices of meshes: .stl, text and binary, and .obj."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.array_types import Array
from calib.errors import ScanError
from calib.scans.readers.parsing import PointsAndNormals, doubles, numbers, require_bounded, text_lines, truncated

_STL_START = 84  # bytes before the triangles: a free text of 80, the number of triangles
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(path: Path, content: bytes) -> PointsAndNormals:
    """Vertices of an .stl file, each once, without the triangles' normals. Raises ScanError."""
    promised = int.from_bytes(content[80:_STL_START], "little")
    held = (len(content) - _STL_START) // _TRIANGLE.itemsize
    # Some programs begin a binary file with the text's "solid": the file length decides.
    binary = len(content) >= _STL_START and held == promised
    if content.lstrip().startswith(b"solid") and not binary:
        return _read_text_stl(path, content), None
    if len(content) < _STL_START or promised == 0:
        raise ScanError(f"{path}: not a readable .stl (no triangles in it); export the scan again")
    if held < promised:
        raise truncated(path, 3 * promised, 3 * held)
    require_bounded(path, 3 * promised)
    table = np.frombuffer(content, _TRIANGLE, promised, _STL_START)
    return _once(doubles(table["vertices"].reshape(-1, 3))), None


def _read_text_stl(path: Path, content: bytes) -> Array:
    """Vertices (N, 3) of a text .stl file, each once. Raises ScanError."""
    words = [line.split() for line in text_lines(path, content)]
    vertices = [" ".join(w[1:4]) for w in words if w[0] == "vertex"]
    if not vertices or words[-1][0] != "endsolid" or len(vertices) != 3 * sum(w[0] == "facet" for w in words):
        raise ScanError(f"{path}: not a readable .stl (no triangles in it, or cut short); export the scan again")
    return _once(numbers(path, vertices, [0, 1, 2]))


def read_obj(path: Path, content: bytes) -> PointsAndNormals:
    """Vertices of an .obj file, without the normals of faces' corners. Raises ScanError."""
    lines = [line.strip() for line in text_lines(path, content)]
    vertices = [line[1:] for line in lines if line[0] == "v" and line[1:2] in (" ", "\t")]
    if not vertices:
        raise ScanError(f"{path}: no vertex in the .obj (lines such as v 1.0 2.0 3.0); export the scan again")
    return numbers(path, vertices, [0, 1, 2]), None


def _once(points: Array) -> Array:
    """Points (N, 3) without repetitions; rows without a value are all kept, since they are counted later."""
    with_value = np.all(np.isfinite(points), axis=1)
    return np.vstack([np.unique(points[with_value], axis=0), points[~with_value]])
