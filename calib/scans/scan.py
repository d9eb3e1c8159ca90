"""Scans, point clouds as the scanner measured them: loading, writing and counting."""

from __future__ import annotations

import os
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np

from calib.array_types import Array, BoolArray
from calib.brief import Brief
from calib.errors import ScanError
from calib.scans.readers.e57 import SUFFIX, read_e57, split_part
from calib.scans.readers.las import read_las
from calib.scans.readers.mesh import read_obj, read_stl
from calib.scans.readers.numpy_files import read_npy, read_npz
from calib.scans.readers.parsing import Reader
from calib.scans.readers.pcd import read_pcd
from calib.scans.readers.ply import read_ply, write_ply
from calib.scans.readers.text import read_text

READERS: dict[str, Reader] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".xyz": read_text,
    ".asc": read_text,
    ".pts": read_text,
    ".csv": read_text,
    ".txt": read_text,
    ".stl": read_stl,
    ".obj": read_obj,
    ".npy": read_npy,
    ".npz": read_npz,
    ".las": read_las,
    ".laz": read_las,
    SUFFIX: read_e57,
}
"""Reader of each file format, by suffix. All raise ScanError; rows without a value are still in their result."""

_MOST_BYTES = 2**32  # a hundred times the size of a structured-light scan
_BEYOND_ANY_LENGTH_MM = 1e12


@dataclass(frozen=True)
class Scan(Brief):
    """Point cloud in the scanner's frame: the scanner at the origin, millimetres."""

    name: str
    points_mm: Array  # (N, 3) float64
    normals: Array | None = None  # (N, 3) unit, or None
    dropped: int = 0  # rows without a value, left out on loading

    def _brief(self) -> str:
        return f"{self.name}: {len(self.points_mm)} points"


@dataclass(frozen=True)
class PointCount:
    """Number of points in a scan's file, and number of its rows without a value."""

    points: int  # with a value
    dropped: int  # rows without one, left out on loading

    @property
    def share_dropped(self) -> float:
        """Share of all rows that have no value, 0 to 1."""
        return self.dropped / max(self.points + self.dropped, 1)


def load_scan(path: str | Path) -> Scan:
    """Read a scan: .ply, .pcd, .e57, .las, .laz, .xyz, .asc, .pts, .csv, .txt, .npy, .npz, or vertices (.stl, .obj).

    Rows without a value are left out and counted in `dropped`: NaN, infinity or a number beyond any length (FLT_MAX is
    used so), and several points at the scanner's own place, (0, 0, 0). Lengths are millimetres and nothing is scaled
    except .e57, whose standard says metres: whether another scan is in metres is checked by `find_corner`, which knows
    the jig's size. For an .e57 with several scans the path names one: `cell.e57#left` or, by its number, `cell.e57#2`.

    Raises ScanError: missing, empty, too large, truncated or not of its kind, or without a single point.

    >>> import calib
    >>> calib.load_scan("sample_data/rb5_jang/scans/p01.ply")
    Scan(p01: ... points)
    """
    path = Path(path)
    file = scan_file(path)
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        raise ScanError(f"{path}: '{path.suffix}' is not a kind of scan; a scan is one of {', '.join(READERS)}")
    try:
        points, normals = reader(path, _content(file))
    except OSError as error:
        raise ScanError(f"{path}: {error.strerror or error}; check that the file can be read") from None
    except MemoryError:
        raise ScanError(f"{path}: too large for this machine's memory; crop or thin the scan") from None
    usable = _with_value(points)
    if not usable.any():
        raise ScanError(f"{path}: no usable point, {len(points)} in the file, none with three finite coordinates")
    return Scan(
        path.stem if file == path else path.name,
        np.ascontiguousarray(points[usable], dtype=np.float64),
        None if normals is None else np.ascontiguousarray(normals[usable], dtype=np.float64),
        int(np.count_nonzero(~usable)),
    )


def scan_file(path: Path) -> Path:
    """Path of the file that holds a scan: the given path without the name of one scan in an .e57."""
    return split_part(path)[0]


def _content(path: Path) -> bytes:
    """Bytes of a scan's file. Raises ScanError for a missing, empty or too large file, and OSError."""
    if path.is_dir():
        raise ScanError(f"{path}: this is a folder, not a scan; check the scan's name in poses.csv")
    if not path.is_file():
        raise ScanError(f"{path}: no such file; check the scan's name in poses.csv, or export the scan again")
    size = path.stat().st_size
    if size == 0:
        raise ScanError(f"{path}: the file is empty (0 bytes); export the scan again")
    if size > _MOST_BYTES:
        raise ScanError(f"{path}: the file has {size / 2**30:.3g} GB; crop or thin the scan")
    return path.read_bytes()


def _with_value(points: Array) -> BoolArray:
    """Mask (N,): whether a row of points (N, 3) is a measured point, not a value that marks a missing measurement."""
    usable = np.all(np.abs(points) < _BEYOND_ANY_LENGTH_MM, axis=1)  # NaN is not below it either
    at_scanner = np.all(points == 0, axis=1)
    if np.count_nonzero(at_scanner) > 1:
        usable &= ~at_scanner
    return np.asarray(usable)


def write_scan(path: Path, scan: Scan) -> None:
    """Write a scan as binary little-endian .ply, float32, with normals where it has them.

    The file appears whole or not at all: it is written under another name in the same folder and moved to its path.
    """
    with NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
        try:
            write_ply(file.file, scan.points_mm, scan.normals)
            file.close()
            os.chmod(file.name, 0o644)
            os.replace(file.name, path)
        except BaseException:
            Path(file.name).unlink()
            raise


def seeded_generator(points_mm: Array) -> np.random.Generator:
    """Random generator seeded by the points (N, 3) of a scan, so that one scan gives one result on any machine.

    Some ten thousand of the points and their number make the seed.
    """
    some = points_mm[:: max(1, len(points_mm) // 10_000)]
    content = np.ascontiguousarray(some, dtype=np.float64).tobytes() + str(len(points_mm)).encode()
    return np.random.default_rng(int.from_bytes(blake2b(content, digest_size=8).digest(), "big"))
