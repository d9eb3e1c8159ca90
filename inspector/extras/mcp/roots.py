"""The folders in which a tool may read and write."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from calib.errors import CalibError


class RootError(CalibError):
    """Error: a place outside the folders that were allowed."""


@dataclass(frozen=True)
class Roots:
    """Folders, resolved, in which a tool may read and write."""

    folders: tuple[Path, ...]

    @classmethod
    def of(cls, folders: Iterable[Path]) -> Roots:
        """Roots of the given folders. Raises RootError for one that is no folder."""
        given = tuple(folders)
        for folder in given:
            if not folder.is_dir():
                raise RootError(f"--root {folder}: is no folder")
        return cls(tuple(folder.resolve() for folder in given))

    def require(self, place: str) -> Path:
        """The resolved place, a relative one being in the first folder.

        Raises RootError where it is in none of the folders, links being followed.
        """
        if "\0" in place:
            raise RootError(f"{place!r}: is no path")
        resolved = (self.folders[0] / place).resolve()
        if not any(resolved.is_relative_to(folder) for folder in self.folders):
            allowed = ", ".join(map(str, self.folders))
            raise RootError(f"{place}: is outside of what may be read and written here, {allowed} (mcp --root)")
        return resolved
