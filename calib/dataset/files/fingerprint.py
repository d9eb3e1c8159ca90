"""Hashes of a dataset's files, to detect changes since the dataset was read."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from calib.dataset.dataset import Dataset
from calib.errors import DatasetError
from calib.scans.scan import scan_file
from calib.text_files.toml_table import TomlTable

_CHUNK = 1 << 20
_WITHOUT_POINTS = 3  # files: dataset.toml, robot, poses


def content_hash(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal. Raises DatasetError where it cannot be read."""
    digest = hashlib.sha256()
    if path.exists() and not path.is_file():  # reading a pipe would wait for ever
        raise DatasetError(f"{path}: is no file; put the dataset's file in its place")
    try:
        with path.open("rb") as file:
            while chunk := file.read(_CHUNK):
                digest.update(chunk)
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror})") from None
    return digest.hexdigest()


def fingerprint(dataset: Dataset) -> dict[str, str]:
    """Hashes of the files that a fit of the dataset reads, by path below its folder.

    These are dataset.toml, the robot, the poses and the points, each as it was when the dataset was loaded. Scans are
    included only where there are no points.
    """
    if dataset.folder is None:
        raise DatasetError(f"dataset {dataset.name}: it has no folder; write it to one first")
    hashes = dict(dataset.read_files) or table_hashes(dataset.folder)
    if len(hashes) == _WITHOUT_POINTS and dataset.scan_folder is not None:
        scans = [scan_file(Path(name)).as_posix() for name in dataset.poses.scan_names]
        names = dict.fromkeys(f"{dataset.scan_folder}/{name}" for name in scans)
        hashes |= {name: content_hash(dataset.folder / name) for name in names}
    return hashes


def table_hashes(folder: Path, *, so_far: bool = False) -> dict[str, str]:
    """Hashes of dataset.toml, the robot, the poses and, where named, the points; by path below the folder.

    `so_far`: only of those that exist by now. Raises DatasetError.
    """
    top = TomlTable.load(folder / "dataset.toml")
    named = (top.text("robot", "robot.toml"), top.text("poses", "poses.csv"), top.text("points"))
    names = [name for name in ("dataset.toml", *named) if name and (not so_far or (folder / name).is_file())]
    return {name: content_hash(folder / name) for name in names}


def changed(before: Mapping[str, str], now: Mapping[str, str]) -> tuple[str, ...]:
    """Names of files that changed, were added or removed, in the order of `now`, the removed ones last."""
    return tuple(name for name in dict.fromkeys([*now, *before]) if now.get(name) != before.get(name))
