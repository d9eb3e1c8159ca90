"""The page's list of datasets: a name for each, and whether it has scans."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from calib.dataset.files.folder import find_datasets, load_dataset
from calib.errors import CalibError, printable
from calib.served_process import within_limits


def have_scans(folders: Iterable[Path]) -> list[bool]:
    """Whether each dataset has scans; one that cannot be read counts, its error appears when it is opened."""
    given = tuple(folders)
    try:
        return within_limits("the datasets", _have_scans, given)
    except CalibError:
        return [True] * len(given)


def _have_scans(folders: Iterable[Path]) -> list[bool]:
    def has_scans(folder: Path) -> bool:
        try:
            return load_dataset(folder).scan_folder is not None
        except CalibError:
            return True

    return list(map(has_scans, folders))


def listed_folders(path: Path, data: Path | None) -> dict[Path, Path]:
    """Folders of the datasets in a place and in that of imported ones, by their resolved paths; none that is gone."""
    try:
        folders = find_datasets(path)
    except CalibError:
        folders = []
    imported = [] if data is None else sorted(found.parent for found in data.glob("*/dataset.toml"))
    return {folder.resolve(): folder for folder in [*folders, *imported]}


def names_of(folders: Sequence[Path]) -> list[str]:
    """Distinct name for each dataset folder: the folder's own where that is unique."""
    names = [printable(folder.resolve().name) for folder in folders]
    return [
        printable(str(folder)) if names.count(name) > 1 else name for folder, name in zip(folders, names, strict=True)
    ]
