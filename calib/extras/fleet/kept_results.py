"""Results of a run so far, one file per dataset in a folder next to the table, from which a later run continues."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec

from calib.dataset.files.atomic_write import write_text_atomically
from calib.errors import CalibError, DatasetError
from calib.extras.fleet.drift import Drift
from calib.extras.fleet.judge import FoundCorners, Judged
from calib.extras.fleet.row import Row
from calib.strict_json import JsonFile, to_json

KIND, VERSION = "robot-calibration-inspector fleet result", 1
SIZE_LIMIT = 100_000_000  # bytes; a thousand corners are 0.4 MB

Kept = TypeVar("Kept")


class _JudgedFile(msgspec.Struct):
    format: str
    version: int
    key: str
    row: Row
    corners: FoundCorners | None
    seconds: float


class _DriftFile(msgspec.Struct):
    format: str
    version: int
    key: str
    drift: Drift


@dataclass(frozen=True)
class KeptResults:
    """Folder with the results of a run so far; damaged files count as missing."""

    folder: Path

    @contextmanager
    def held(self) -> Iterator[None]:
        """Context that locks the folder for one run. Raises DatasetError where another run has it locked.

        Raises it, too, where the folder cannot be made.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            lock = (self.folder / ".lock").open("a")
        except OSError as error:
            raise DatasetError(
                f"{self.folder}: cannot be written ({error.strerror or error}); name another place for the table"
            ) from None
        with lock:
            try:
                import fcntl

                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # it ends with the process, however that ends
            except ImportError:  # a system without file locks: two runs are not kept apart there
                pass
            except OSError:
                raise DatasetError(
                    f"{self.folder}: another run is writing there; wait for it, or name another table"
                ) from None
            yield

    def forget(self) -> None:
        """Delete all stored results."""
        for path in self.folder.glob("*.json"):
            path.unlink(missing_ok=True)

    def store(self, judged: Judged) -> None:
        """Write the result of a dataset, replacing an earlier one."""
        self._write(
            self._place(judged.row.path),
            {"key": judged.key, "row": judged.row, "corners": judged.corners, "seconds": judged.seconds},
        )

    def judged(self, path: str) -> Judged | None:
        """Stored result of a dataset; None where there is none."""
        file = self._read(self._place(path), _JudgedFile)
        if file is None or file.row.path != path:
            return None
        return Judged(file.key, file.row, file.corners, file.seconds)

    def store_drift(self, drift: Drift, key: str) -> None:
        """Write the comparison of two datasets of an arm."""
        self._write(self._place(drift.base, drift.later), {"key": key, "drift": drift})

    def drift(self, base: str, later: str, key: str) -> Drift | None:
        """Stored comparison of two datasets of an arm, by its key; None where there is none."""
        file = self._read(self._place(base, later), _DriftFile)
        return file.drift if file is not None and file.key == key else None

    def _place(self, *paths: str) -> Path:
        return self.folder / f"{hashlib.sha256(chr(0).join(paths).encode()).hexdigest()[:32]}.json"

    def _write(self, path: Path, content: dict[str, object]) -> None:
        document = {"format": KIND, "version": VERSION, **msgspec.to_builtins(content)}
        write_text_atomically(path, to_json(document) + "\n")

    def _read(self, path: Path, kind: type[Kept]) -> Kept | None:
        if not path.exists():
            return None
        file = JsonFile(path, "fleet result", "it is made again", CalibError, SIZE_LIMIT)
        try:
            return file.checked([], file.read(KIND, VERSION), kind)
        except CalibError:
            return None
