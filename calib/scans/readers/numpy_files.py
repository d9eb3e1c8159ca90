"""NumPy files: one array of points (.npy), or an archive (.npz) of `points` or `points_mm`, and `normals`.

Points are (N, 3), or organised as (rows, columns, 3).
"""

from __future__ import annotations

import math
import zipfile
from io import BytesIO
from pathlib import Path
from typing import IO

import numpy as np

from calib.array_types import Array
from calib.errors import ScanError
from calib.scans.readers.parsing import PointsAndNormals, doubles, one_line, require_bounded, truncated

_NAMES = ("points", "points_mm")
_MOST_HEADER = 4096


def read_npy(path: Path, content: bytes) -> PointsAndNormals:
    """Points of an .npy array; pickled objects are never loaded. Raises ScanError."""
    try:
        return _array(path, "the array", BytesIO(content), len(content)), None
    except ScanError:
        raise
    except Exception as error:  # whatever numpy raises, its cause is the file's content
        raise ScanError(f"{path}: not a readable .npy ({one_line(error)}); save the scan again") from None


def read_npz(path: Path, content: bytes) -> PointsAndNormals:
    """Points and normals of an .npz archive; pickled objects are never loaded. Raises ScanError."""
    try:
        with zipfile.ZipFile(BytesIO(content)) as archive:
            held = {name.removesuffix(".npy") for name in archive.namelist()}
            name = next((name for name in _NAMES if name in held), None)
            if name is None:
                raise ScanError(
                    f"{path}: no array named points in it (found: {', '.join(sorted(held)[:12]) or 'nothing'}); "
                    "save the points (N, 3) in mm under that name"
                )
            points = _member(path, archive, name)
            normals = _member(path, archive, "normals") if "normals" in held else None
    except ScanError:
        raise
    except Exception as error:  # whatever zipfile, zlib or numpy raise, its cause is the file's content
        raise ScanError(f"{path}: not a readable .npz ({one_line(error)}); save the scan again") from None
    if normals is not None and len(normals) != len(points):
        raise ScanError(
            f"{path}: {len(points)} points and {len(normals)} normals; save a normal for each point, or none"
        )
    return points, normals


def _member(path: Path, archive: zipfile.ZipFile, name: str) -> Array:
    """One array of an archive as (N, 3) float64."""
    info = archive.getinfo(f"{name}.npy")
    with archive.open(info) as file:
        return _array(path, name, file, info.file_size)


def _array(path: Path, name: str, file: IO[bytes], file_size: int) -> Array:
    """One array as (N, 3) float64, allocated only if its header agrees with the number of bytes."""
    version = np.lib.format.read_magic(file)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, kind = read_header(file, max_header_size=_MOST_HEADER)
    if kind.hasobject or kind.kind not in "fiu" or len(shape) < 2 or shape[-1] != 3:
        raise ScanError(
            f"{path}: {name} is {kind} of shape {shape}; save numbers of shape (N, 3) or (rows, columns, 3)"
        )
    rows = math.prod(shape[:-1])
    size = 3 * kind.itemsize
    there = (file_size - file.tell()) // size
    if there < rows:
        raise truncated(path, rows, there)
    require_bounded(path, rows)
    data = file.read(rows * size)
    if len(data) < rows * size:  # of an archive that promises more than it holds
        raise truncated(path, rows, len(data) // size)
    flat = np.frombuffer(data, kind, 3 * rows)
    return doubles(flat.reshape(shape, order="F" if fortran else "C").reshape(-1, 3))
