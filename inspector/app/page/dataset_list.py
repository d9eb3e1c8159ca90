"""The page's list of datasets: a name for each, and whether it has scans."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from calib.dataset.files.folder import load_dataset
from calib.errors import CalibError, printable


def has_scans(folder: Path) -> bool:
    """Whether a dataset has scans; False for a folder that cannot be read, whose error appears when it is opened."""
    try:
        return load_dataset(folder).scan_folder is not None
    except CalibError:
        return True


def names_of(folders: Sequence[Path]) -> list[str]:
    """Distinct name for each dataset folder: the folder's own where that is unique."""
    names = [printable(folder.resolve().name) for folder in folders]
    return [
        printable(str(folder)) if names.count(name) > 1 else name for folder, name in zip(folders, names, strict=True)
    ]
