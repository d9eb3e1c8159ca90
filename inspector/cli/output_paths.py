"""Checks that a command neither overwrites its inputs nor writes to the same place twice."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import dataset_files
from calib.errors import DatasetError


def check_outputs(dataset: Dataset, outputs: Iterable[Path | None], inputs: Iterable[Path | None] = ()) -> None:
    """Raise DatasetError where an output is one of the dataset's files or of the other inputs, or is given twice.

    Before the work starts: a calibrated robot.toml in the nominal one's place would be taken for nominal the next time.
    """
    read = {path.resolve(): "is what this command reads" for path in inputs if path is not None}
    read |= {path.resolve(): f"is a file of the dataset {dataset.name}" for path in dataset_files(dataset)}
    written: set[Path] = set()
    for path in (output for output in outputs if output is not None):
        place = path.resolve()
        if place in read:
            raise DatasetError(f"{path}: {read[place]}, which would be lost; name another file to write")
        if place in written and (place.is_file() or not place.exists()):
            raise DatasetError(f"{path}: is to be written twice; name a file for each")
        written.add(place)
