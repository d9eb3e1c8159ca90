"""Origin of a result: when, by whom and by which command it was made, with which program, from which files.

Models, sessions and reports carry it alike; `sha256sum` of a dataset's files tells whether they are the same.
"""

from __future__ import annotations

import getpass
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

from calib.brief import Brief
from calib.dataset.dataset import Dataset
from calib.dataset.files.fingerprint import fingerprint
from calib.strict_json import Text

PROGRAM = "robot-calibration-inspector"
_command: tuple[str, ...] = ()  # words of the command line that this process runs; none from Python


class SavedOrigin(msgspec.Struct, frozen=True):
    """Who made a file, when and by which command, as `Origin.document` writes it."""

    made: Text = ""
    by: Text = ""
    command: tuple[Text, ...] = ()


def run_command(words: Sequence[str]) -> None:
    """Declare the command line that this process runs, for the origin of what it makes.

    Of absolute paths the name alone is kept: results are handed on, and where this machine has its files is not theirs.
    """
    global _command
    _command = tuple(_without_folders(word) for word in words)


def _without_folders(word: str) -> str:
    """A word of a command line with the name alone of an absolute path, also behind `--option=`."""
    option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
    return f"{option}{equals}{Path(value).name}" if Path(value).is_absolute() else word


@dataclass(frozen=True)
class Origin(Brief):
    """When, by whom and how a result was made, and the hashes of the files that it was made of."""

    made: str = ""  # date and time, ISO 8601, UTC; "" in files of older versions
    by: str = ""  # login name
    command: tuple[str, ...] = ()  # words of the command line; none from Python
    program_version: str = ""
    files: Mapping[str, str] = field(default_factory=dict)  # SHA-256 by path; none for a dataset in no folder

    @classmethod
    def of(cls, dataset: Dataset) -> Origin:
        """Origin of what is made of a dataset now."""
        return cls(
            datetime.now(UTC).isoformat(timespec="seconds"),
            _login(),
            _command,
            program_version(),
            {} if dataset.folder is None else fingerprint(dataset),
        )

    @classmethod
    def read(cls, saved: SavedOrigin, program_version: str, files: Mapping[str, str]) -> Origin:
        """Origin as a file has it."""
        return cls(saved.made, saved.by, saved.command, program_version, files)

    @property
    def document(self) -> dict[str, Any]:
        """Who, when and how, for a file that has program version and hashes at places of their own."""
        return {"made": self.made, "by": self.by, "command": self.command}


def program_version() -> str:
    """Version of the installed program."""
    return version(PROGRAM)


def command_text(words: Sequence[str]) -> str:
    """Words of a command line as one text, quoted as a shell takes them."""
    from shlex import join

    return join(words)


def _login() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):  # a system without users
        return ""
