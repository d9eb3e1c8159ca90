"""Origin of a result: when, by whom and by which command it was made, with which program, from which files.

Models, sessions and reports carry it alike, so that each can be held against the dataset's files later.
"""

from __future__ import annotations

import getpass
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from html import unescape
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

from calib.brief import Brief
from calib.dataset.dataset import Dataset
from calib.dataset.files.fingerprint import fingerprint
from calib.errors import DatasetError
from calib.presented import Presented
from calib.strict_json import Text

PROGRAM = "robot-calibration-inspector"
_command: tuple[str, ...] = ()  # words of the command line that this process runs; none from Python
_EMBEDDED = re.compile(r'<meta name="origin" content="([^"]*)">')
_HEAD, _LARGEST = 1_000_000, 100_000_000  # characters of a page that are searched, bytes of a file that is read
SAME, CHANGED, MISSING, NEW = "same", "changed", "missing", "new"


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


@dataclass(frozen=True)
class FileState:
    """State of one file of a dataset, beside its hash when a result was made of it."""

    path: str
    state: str  # SAME, CHANGED, MISSING or NEW


@dataclass(frozen=True)
class Verified(Presented):
    """A result's origin, held against the files of a dataset and this program's version."""

    path: str  # of the result
    origin: Origin
    files: tuple[FileState, ...]
    same_program: bool

    @property
    def is_same(self) -> bool:
        """Whether the result was made of exactly the dataset's present files."""
        return all(file.state == SAME for file in self.files)

    def _brief(self) -> str:
        return f"{self.path}: {'the same files' if self.is_same else 'other files'}"


def verify(path: str | Path, dataset: Dataset) -> Verified:
    """Origin of a model, session or report, held against the files of a dataset.

    Raises DatasetError where the result carries no origin, and for unreadable files.
    """
    origin, now = read_origin(Path(path)), fingerprint(dataset)

    def state(name: str) -> str:
        if name not in now:
            return MISSING
        if name not in origin.files:
            return NEW
        return SAME if now[name] == origin.files[name] else CHANGED

    files = tuple(FileState(name, state(name)) for name in dict.fromkeys([*origin.files, *now]))
    return Verified(str(path), origin, files, origin.program_version == program_version())


class _SavedFiles(msgspec.Struct, frozen=True):
    files: dict[str, Text] = {}


class _Saved(msgspec.Struct, frozen=True):
    """The keys of a model or a session that tell where it comes from."""

    format: Text
    dataset: _SavedFiles = _SavedFiles()
    program_version: Text = ""
    origin: SavedOrigin = SavedOrigin()


class _Embedded(msgspec.Struct, frozen=True):
    """Origin as a report carries it."""

    made: Text = ""
    by: Text = ""
    command: tuple[Text, ...] = ()
    program_version: Text = ""
    files: dict[str, Text] = {}


def read_origin(path: Path) -> Origin:
    """Origin that a model, a session or a report in HTML carries. Raises DatasetError where there is none."""
    if not path.is_file():  # reading a pipe would wait for ever
        raise DatasetError(f"{path}: {'is no file' if path.exists() else 'no such file'}")
    try:
        content = path.read_text(encoding="utf-8") if path.stat().st_size <= _LARGEST else ""
    except (OSError, UnicodeDecodeError):
        content = ""
    try:
        embedded = _EMBEDDED.search(content[:_HEAD])
        if embedded:
            found = msgspec.json.decode(unescape(embedded[1]), type=_Embedded)
            return Origin(found.made, found.by, found.command, found.program_version, found.files)
        saved = msgspec.json.decode(content, type=_Saved)
    except (msgspec.DecodeError, UnicodeEncodeError, RecursionError):
        saved = None
    if saved is None or not saved.format.startswith(PROGRAM) or not saved.dataset.files:
        raise DatasetError(
            f"{path}: carries no hashes of the files that it was made of; a model.json, a session or a report in HTML "
            "of this program does"
        )
    return Origin.read(saved.origin, saved.program_version, saved.dataset.files)


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
