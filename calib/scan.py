"""Scans: one point cloud of the jig as the scanner saw it; loading and writing one."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np
from numpy.typing import NDArray

from calib.errors import ScanError
from calib.scan_file import READERS


@dataclass(frozen=True)
class Scan:
    """Points in the scanner's frame: the scanner at the origin, millimetres."""

    name: str
    points_mm: NDArray  # (N, 3) float64
    normals: NDArray | None = None  # (N, 3) unit, or None
    dropped: int = 0  # non-finite rows left out on loading


def load_scan(path: Path) -> Scan:
    """Read a .ply (text or binary), .pcd, .xyz (text) or .stl (its vertices).

    Rows with NaN or infinity (pixels without depth) are left out and counted in `dropped`.

    Raises ScanError: missing, empty, truncated or not of its kind, or without a single point.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ScanError(
            f"{path}: '{path.suffix}' is not a kind of scan; a scan is one of {', '.join(READERS)}"
        )
    try:
        size = path.stat().st_size if path.is_file() else None
    except OSError as error:
        raise ScanError(f"{path}: {error.strerror}") from None
    if size is None:
        raise ScanError(f"{path}: no such file; check the scan's name in poses.csv, or export the scan again")
    if size == 0:
        raise ScanError(f"{path}: the file is empty (0 bytes); export the scan again")
    try:
        points, normals = reader(path)
    except OSError as error:
        raise ScanError(f"{path}: {error.strerror or error}; check that the file can be read") from None
    finite = np.all(np.isfinite(points), axis=1)
    if not finite.any():
        raise ScanError(
            f"{path}: no usable point, {len(points)} in the file, none with three finite coordinates"
        )
    points = np.ascontiguousarray(points[finite], dtype=np.float64)
    return Scan(
        path.stem, points, None if normals is None else normals[finite], int(np.count_nonzero(~finite))
    )


def write_scan(path: Path, scan: Scan) -> None:
    """Write a binary little-endian .ply, float32, with normals where the scan has them.

    The file appears whole or not at all: it is written beside its place and moved there.
    """
    columns = ["x", "y", "z"] if scan.normals is None else ["x", "y", "z", "nx", "ny", "nz"]
    rows = scan.points_mm if scan.normals is None else np.hstack([scan.points_mm, scan.normals])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property float {name}" for name in columns] + ["end_header", ""]
    with NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
        try:
            file.write("\n".join(header).encode("ascii"))
            file.write(np.ascontiguousarray(rows, dtype="<f4").tobytes())
            file.close()
            os.chmod(file.name, 0o644)
            os.replace(file.name, path)
        except BaseException:
            Path(file.name).unlink()
            raise
