"""Session files that are dropped on a page: recognised by content, their dataset found among those at hand."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path, PurePosixPath

from calib.dataset.files.fingerprint import table_hashes
from calib.dataset.files.folder import load_dataset
from calib.errors import CalibError, visible
from calib.served_process import within_limits
from inspector.session.session_file import KIND, Saved, SessionFileError, load_session

_HEAD_BYTES = 4096


def is_session_file(path: Path) -> bool:
    """Whether the beginning of a file says that it is a session."""
    try:
        with path.open("rb") as file:
            return KIND.encode() in file.read(_HEAD_BYTES)
    except OSError:
        return False


def read_session(path: Path, name: str) -> Saved:
    """Session of a dropped file; `name`: what messages call the file. Raises CalibError."""
    try:
        return replace(within_limits(name, load_session, path), path=Path(name))
    except SessionFileError as error:
        raise SessionFileError(str(error).replace(str(path), name)) from None


def dataset_of_session(saved: Saved, folders: Iterable[Path]) -> Path | None:
    """Folder of a session's dataset: with the recorded files, else with the recorded name; None where none has them.

    Of several with the recorded name, one in a folder that is called as the recorded one.
    """
    try:
        return within_limits(saved.path.name, _recorded, saved, tuple(folders))
    except CalibError:
        return None


def _recorded(saved: Saved, folders: tuple[Path, ...]) -> Path | None:
    readable = {folder: files for folder in folders if (files := _hashes(folder)) is not None}
    for folder, files in readable.items():
        if all(saved.origin.files.get(name) == content for name, content in files.items()):
            return folder
    called = PurePosixPath(saved.folder).name
    named = sorted(filter(lambda folder: _name(folder) == saved.name, readable), key=lambda f: f.name != called)
    return next(iter(named), None)


def dataset_needed(saved: Saved) -> str:
    """Sentence on the dataset that a session needs and that is not there."""
    called = PurePosixPath(saved.folder).name
    folder = f" (folder {called!r:.100})" if called not in ("", ".", saved.name) else ""
    return visible(
        f"{saved.path.name} is a session on the dataset {saved.name!r:.100}{folder}, which is not here: drop that "
        "dataset's folder or zip together with the session"
    )


def _hashes(folder: Path) -> dict[str, str] | None:
    try:
        return table_hashes(folder)
    except CalibError:
        return None


def _name(folder: Path) -> str:
    try:
        return load_dataset(folder).name
    except CalibError:
        return ""
