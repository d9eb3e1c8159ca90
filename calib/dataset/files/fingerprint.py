"""Hashes of the files that a dataset's numbers come from, which tell whether one of them has changed."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from calib.dataset.dataset import Dataset
from calib.errors import DatasetError
from calib.scans.scan import scan_file
from calib.text_files.toml_table import TomlTable

_CHUNK = 1 << 20


def content_hash(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal. Raises DatasetError where it cannot be read."""
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            while chunk := file.read(_CHUNK):
                digest.update(chunk)
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror})") from None
    return digest.hexdigest()


def fingerprint(dataset: Dataset) -> dict[str, str]:
    """The hash of each file that a fit of the dataset reads, by path below its folder.

    Those are dataset.toml, the robot, the poses and the points; the scans only where there are no points.
    """
    if dataset.folder is None:
        raise DatasetError(f"dataset {dataset.name}: it has no folder; write it to one first")
    top = TomlTable.load(dataset.folder / "dataset.toml")
    names = ["dataset.toml"]
    names += [
        top.text(key, default) or default
        for key, default in (("robot", "robot.toml"), ("poses", "poses.csv"))
    ]
    points = top.text("points")
    if dataset.points is not None and points is not None:
        names.append(points)
    elif dataset.scan_folder is not None:
        scans = [scan_file(Path(name)).as_posix() for name in dataset.poses.scan_names]
        names += [f"{dataset.scan_folder}/{name}" for name in scans]
    return {name: content_hash(dataset.folder / name) for name in dict.fromkeys(names)}


def changed(before: Mapping[str, str], now: Mapping[str, str]) -> tuple[str, ...]:
    """Files that differ, came or went, in the order of `now`, then those that are gone."""
    return tuple(name for name in dict.fromkeys([*now, *before]) if now.get(name) != before.get(name))
