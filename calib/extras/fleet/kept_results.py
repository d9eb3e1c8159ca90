"""Results of a run so far, one file per dataset in a folder next to the table, from which a later run continues."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from calib.dataset.files.atomic_write import write_bytes_atomically
from calib.errors import DatasetError
from calib.extras.fleet.drift import Drift
from calib.extras.fleet.judge import Judged

Kept = TypeVar("Kept", Judged, Drift)


@dataclass(frozen=True)
class KeptResults:
    """Folder with the results of a run so far; damaged files count as missing."""

    folder: Path

    def begin(self) -> None:
        """Make the folder. Raises DatasetError where it cannot."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DatasetError(
                f"{self.folder}: cannot be written ({error.strerror or error}); name another place for the table"
            ) from None

    def write(self, name: str, result: Judged | Drift) -> None:
        """Keep a result under a name, replacing an earlier one."""
        write_bytes_atomically(self._place(name), msgspec.json.encode(result, enc_hook=np.ndarray.tolist))

    def read(self, name: str, kind: type[Kept]) -> Kept | None:
        """The result that is kept under a name; None where there is none."""
        try:
            return msgspec.json.decode(self._place(name).read_bytes(), type=kind, dec_hook=lambda _, of: np.array(of))
        except (OSError, msgspec.MsgspecError):
            return None

    def _place(self, name: str) -> Path:
        return self.folder / f"{hashlib.sha256(name.encode()).hexdigest()[:32]}.json"
