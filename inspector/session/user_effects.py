"""The user's own effects, read again whenever their file changes on disk."""

from __future__ import annotations

from pathlib import Path

from calib.dataset.dataset import Dataset
from calib.effects.catalogue.user_file import load_effects
from calib.effects.effect import Family
from calib.errors import CalibError
from calib.fitting.observations import nominal_state

POLL_S = 0.5
_Version = tuple[int, int] | None


class UserEffects:
    """Effects of a user's file, as families made for each dataset; while the file has an error, its last good ones."""

    def __init__(self, path: Path | None = None) -> None:
        self.path = path
        self.problem = ""  # what went wrong, one line; "" where all is well
        self._good: dict[str, tuple[_Version, tuple[Family, ...]]] = {}  # by dataset, with the file's version

    def stale(self, name: str, known: tuple[Family, ...]) -> bool:
        """Whether a dataset's families are out of date: the file changed, or `known` are not its families."""
        if self.path is None:
            return False
        version, families = self._good.get(name, (None, ()))
        return name not in self._good or version != self.version or families is not known

    def families(self, name: str, dataset: Dataset) -> tuple[Family, ...]:
        """Effect families of the present file; while the file has an error (in `problem`), its last good ones."""
        if self.path is None:
            return ()
        version = self.version
        before, families = self._good.get(name, (None, ()))
        if name in self._good and before == version:
            return families
        try:
            families = load_effects(self.path, nominal_state(dataset))
            self.problem = ""
        except CalibError as error:
            kept = f"; {', '.join(f.name for f in families)} as before" if families else ""
            self.problem = f"{error}{kept}"
        self._good[name] = (version, families)
        return families

    @property
    def version(self) -> _Version:
        """Modification time and size of the file; None where it does not exist."""
        try:
            status = self.path.stat() if self.path is not None else None
        except OSError:
            return None
        return None if status is None else (status.st_mtime_ns, status.st_size)
