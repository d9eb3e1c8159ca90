"""What has arrived in a dataset folder that is being filled, and which of its files have come to rest.

A file that is being written grows, or is renamed into place. It counts as settled when its size and time were the
same at two looks, `SETTLED_S` apart at least; a file that changes later counts as a new arrival. Nothing depends on
events of the file system, which network drives do not send.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from calib.errors import DatasetError
from calib.scans.scan import scan_file

SETTLED_S = 0.4
"""Time for which a file must not change before it is read as whole."""


@dataclass(frozen=True)
class FileState:
    """Size and time of change of a file, and when they were first seen so."""

    size: int
    changed_ns: int
    since_s: float

    @property
    def version(self) -> tuple[int, int]:
        """Size and time of change, which tell one content of a file from the next."""
        return self.size, self.changed_ns


@dataclass(frozen=True)
class FolderState:
    """Files of a folder and its scan folder, by path, as they were at the last look."""

    files: Mapping[Path, FileState] = field(default_factory=dict)
    looked_s: float = 0.0

    def looked_again(self, folders: tuple[Path, ...], now_s: float) -> FolderState:
        """State after another look at the files of some folders; a folder that does not exist has none."""
        files: dict[Path, FileState] = {}
        for folder in folders:
            for path, size, changed_ns in _files_in(folder):
                before = self.files.get(path)
                same = before is not None and before.version == (size, changed_ns)
                files[path] = before if same and before is not None else FileState(size, changed_ns, now_s)
        return FolderState(files, now_s)

    def settled(self, path: Path) -> tuple[int, int] | None:
        """Version of a file that has come to rest and holds something; None while it is missing or being written."""
        state = self.files.get(scan_file(path))
        if state is None or state.size == 0 or self.looked_s - state.since_s < SETTLED_S:
            return None
        return state.version

    def rested_s(self, path: Path) -> float:
        """Time for which a file has not changed; 0 where it is missing."""
        state = self.files.get(scan_file(path))
        return 0.0 if state is None else self.looked_s - state.since_s

    def growing(self) -> tuple[str, ...]:
        """Names of the files that are not settled yet."""
        return tuple(path.name for path in self.files if self.settled(path) is None)

    @property
    def is_at_rest(self) -> bool:
        """Whether no file is being written."""
        return not self.growing()


def _files_in(folder: Path) -> list[tuple[Path, int, int]]:
    """Path, size and time of change of each file in a folder. Raises DatasetError where it cannot be read."""
    found = []
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                try:
                    if entry.is_file():
                        status = entry.stat()
                        found.append((folder / entry.name, status.st_size, status.st_mtime_ns))
                except OSError:  # gone since, as a writer's temporary file
                    continue
    except FileNotFoundError:
        return []
    except OSError as error:
        raise DatasetError(f"{folder}: {error.strerror or error}; check that the folder can be read") from None
    return found
