"""Results of a run so far, one file per dataset in a folder next to the table, from which a later run continues."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec

from calib.dataset.files.atomic_write import write_text_atomically
from calib.errors import CalibError, DatasetError
from calib.extras.fleet.drift import Drift
from calib.extras.fleet.judge import Judged
from calib.strict_json import JsonFile, to_json

KIND, VERSION = "robot-calibration-inspector fleet result", 2
SIZE_LIMIT = 100_000_000  # bytes; a thousand corners are 0.4 MB

Kept = TypeVar("Kept", Judged, Drift)


@dataclass(frozen=True)
class KeptResults:
    """Folder with the results of a run so far; damaged files count as missing."""

    folder: Path

    def begin(self, *, fresh: bool) -> None:
        """Make the folder, and delete what is in it for a fresh start. Raises DatasetError where it cannot."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for path in self.folder.glob("*.json") if fresh else ():
                path.unlink(missing_ok=True)
        except OSError as error:
            raise DatasetError(
                f"{self.folder}: cannot be written ({error.strerror or error}); name another place for the table"
            ) from None

    def store(self, judged: Judged) -> None:
        """Write the result of a dataset, replacing an earlier one."""
        self._write(judged.row.path, judged)

    def judged(self, path: str) -> Judged | None:
        """Stored result of a dataset; None where there is none."""
        return self._read(path, Judged)

    def surely(self, path: str) -> Judged:
        """Stored result of a dataset that has one. Raises DatasetError where another run has deleted it."""
        judged = self.judged(path)
        if judged is None:
            raise DatasetError(f"{self.folder}: the result of {path} is gone; start again, one run at a time")
        return judged

    def store_drift(self, drift: Drift, key: str) -> None:
        """Write the comparison of two datasets of an arm, under the key of both."""
        self._write(key, drift)

    def drift(self, key: str) -> Drift | None:
        """Stored comparison of two datasets of an arm, by its key; None where there is none."""
        return self._read(key, Drift)

    def _place(self, name: str) -> Path:
        return self.folder / f"{hashlib.sha256(name.encode()).hexdigest()[:32]}.json"

    def _write(self, name: str, result: Judged | Drift) -> None:
        document = {"format": KIND, "version": VERSION, "result": msgspec.to_builtins(result)}
        write_text_atomically(self._place(name), to_json(document) + "\n")

    def _read(self, name: str, kind: type[Kept]) -> Kept | None:
        file = JsonFile(self._place(name), "fleet result", "it is made again", CalibError, SIZE_LIMIT)
        try:
            return file.checked(["result"], file.read(KIND, VERSION).get("result"), kind)
        except CalibError:
            return None
