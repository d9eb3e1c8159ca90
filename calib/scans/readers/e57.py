"""E57 files (.e57), by pye57, the Python face of libE57Format: the extra `e57`.

Source: ASTM E2807-11. Lengths are metres there. One file may hold several scans, each in the frame of its own scanner,
with a pose that leads to a frame of the file. The points are given in the scanner's frame, as the search for the corner
wants them; the pose is not applied.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.errors import ScanError
from calib.scans.readers.parsing import PointsAndNormals, one_line, require_bounded, truncated

SUFFIX = ".e57"
_SIGNATURE = b"ASTM-E57"
_LENGTH = slice(16, 24)  # of the header: how many bytes the file has
_MM = 1000.0  # a metre
_MOST_NAMED = 8
_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")


def split_part(path: Path) -> tuple[Path, str]:
    """Path of the .e57 file and name of the scan in it, from `cell.e57#left`; for any other path the name is empty."""
    start = path.name.lower().find(SUFFIX + "#")
    if start < 0:
        return path, ""
    end = start + len(SUFFIX)
    return path.with_name(path.name[:end]), path.name[end + 1 :]


def read_e57(path: Path, content: bytes) -> PointsAndNormals:
    """Points of one scan of an .e57 file, in mm, without normals; points marked invalid are NaN. Raises ScanError.

    Where the file holds several scans the path names one after a #: `cell.e57#left`, or its number, `cell.e57#2`.
    """
    file, name = split_part(path)
    if not content.startswith(_SIGNATURE):
        raise ScanError(f"{path}: not an .e57 file (it starts with {content[:8]!r}); export the scan again")
    promised = int.from_bytes(content[_LENGTH], "little")
    if promised > len(content):
        raise ScanError(
            f"{path}: the file is truncated: its header promises {promised} bytes, it holds {len(content)}; "
            "copy or export the scan again"
        )
    try:
        from pye57 import ScanHeader, libe57
    except ImportError:
        raise ScanError(
            f"{path}: .e57 is read by pye57, which is not installed: "
            "pip install 'robot-calibration-inspector[e57]', or export the scan as .ply"
        ) from None
    try:
        with closing(libe57.ImageFile(str(file), "r")) as image:
            scans = [ScanHeader(node) for node in image.root()["data3D"]]
            return _points(path, libe57, image, scans[_chosen(path, file, scans, name)], len(content)), None
    except ScanError:
        raise
    except Exception as error:  # libE57's own, or whatever pybind11 makes of what is not there
        message = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ScanError(
            f"{path}: not a readable .e57 ({one_line(ValueError(message))}); copy or export the scan again"
        ) from None


def _chosen(path: Path, file: Path, scans: list[Any], name: str) -> int:
    """Index, among a file's scans, of the scan that a path names. Raises ScanError where none or several match."""
    names = [str(scan["name"].value()) if scan.node.isDefined("name") else "" for scan in scans]
    numbers = [str(i + 1) for i in range(len(scans))]
    if not scans:
        raise ScanError(f"{path}: the .e57 holds no scan (pictures, perhaps); export the point cloud")
    if not name and len(scans) == 1:
        return 0
    for known in (names, numbers):
        if known.count(name) == 1:
            return known.index(name)
    listed = ", ".join(f"{number} {held!r}" for number, held in zip(numbers, names, strict=True))
    if len(scans) > _MOST_NAMED:
        listed = ", ".join(f"{i} {held!r}" for i, held in zip(numbers[:_MOST_NAMED], names, strict=False)) + " ..."
    problem = f"none of them is {name[:60]!r}" if name else "which one is not said"
    raise ScanError(
        f"{path}: the .e57 holds {len(scans)} scans ({listed}), {problem}; write {file.name}#1, or its name"
    )


def _points(path: Path, libe57: Any, image: Any, scan: Any, file_bytes: int) -> Array:
    """Points (N, 3) of one scan, mm, in the frame of its scanner. Raises ScanError."""
    fields = next((kind for kind in (_CARTESIAN, _SPHERICAL) if set(kind) <= set(scan.point_fields)), None)
    if fields is None:
        raise ScanError(
            f"{path}: its points have neither {', '.join(_CARTESIAN)} nor {', '.join(_SPHERICAL)} "
            f"(found: {', '.join(scan.point_fields[:12]) or 'nothing'}); export the coordinates too"
        )
    rows = scan.point_count
    if rows > 8 * file_bytes:  # a coordinate takes a bit at least
        raise truncated(path, rows, 0)
    require_bounded(path, rows)
    invalid = fields[0].removesuffix("X").removesuffix("Range") + "InvalidState"
    read = [*fields, invalid] if invalid in scan.point_fields else [*fields]
    values = np.zeros((len(read), rows))
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in zip(read, values, strict=True):
        buffers.append(libe57.SourceDestBuffer(image, name, column, rows, True, True))
    if rows:
        with closing(scan.points.reader(buffers)) as reader:
            held = reader.read()
        if held < rows:
            raise truncated(path, rows, held)
    points = values[:3].T if fields is _CARTESIAN else _cartesian(*values[:3])
    measured = np.all(values[3:] == 0, axis=0, keepdims=True).T  # (N, 1); 1 is a direction alone, 2 nothing
    return _MM * np.where(measured, points, np.nan)


def _cartesian(range_m: Array, azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Cartesian from spherical coordinates (N,): azimuth from x towards y, elevation up (ASTM E2807)."""
    level = range_m * np.cos(elevation_rad)
    return np.stack([level * np.cos(azimuth_rad), level * np.sin(azimuth_rad), range_m * np.sin(elevation_rad)], axis=1)
