"""Discovery of datasets at any depth below a folder."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from calib.errors import DatasetError
from calib.extras.fleet.row import Failure


@dataclass(frozen=True)
class Discovered:
    """Dataset folders found below one folder, and folders that could not be listed."""

    folder: Path
    datasets: tuple[str, ...]  # paths below the folder, with slashes, in order; "." is the folder itself
    failures: tuple[Failure, ...]


def discover(folder: Path) -> Discovered:
    """Datasets in a folder and all folders below it, except hidden folders and those inside a dataset.

    Links are followed; a folder that two paths lead to counts once, by the first of them in order.

    Raises DatasetError where the folder cannot be looked into or holds no dataset.
    """
    if not folder.is_dir():
        what = "is a file" if folder.is_file() else "no such folder"
        raise DatasetError(f"{folder}: {what}; give a folder that holds datasets")
    datasets: list[str] = []
    seen: set[str] = set()
    refused: list[OSError] = []
    for place, below, files in os.walk(folder, followlinks=True, onerror=refused.append):
        real, is_dataset = os.path.realpath(place), "dataset.toml" in files
        if is_dataset and real not in seen:
            datasets.append(Path(place).relative_to(folder).as_posix())
        below[:] = [] if is_dataset or real in seen else sorted(name for name in below if not name.startswith("."))
        seen.add(real)
    failures = [
        Failure(
            Path(error.filename).relative_to(folder).as_posix(), f"cannot be looked into ({error.strerror or error})"
        )
        for error in refused
    ]
    if not datasets and not failures:
        raise DatasetError(f"{folder}: found no dataset.toml here nor below; a dataset folder has one")
    if not datasets and failures[0].path == ".":
        raise DatasetError(f"{folder}: {failures[0].reason}")
    return Discovered(folder, tuple(sorted(datasets)), tuple(sorted(failures, key=lambda f: f.path)))
