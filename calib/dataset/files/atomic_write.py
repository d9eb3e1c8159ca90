"""Files written atomically: a reader finds the old content or the new, never a part; several are new all or none."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from calib.errors import DatasetError

_PART = ".part"
_NAME = 100  # characters of a file's name in that of the temporary one, which has to be a name too
_LEFT_OVER_S = 3600.0  # age of a temporary file whose writer was killed


def write_text_atomically(path: Path, text: str) -> None:
    """Write UTF-8 text through a temporary file in the same folder, so that no reader finds a partial text."""
    write_all_atomically({path: text})


def write_bytes_atomically(path: Path, content: bytes) -> None:
    """Write bytes through a temporary file in the same folder; a terminal or a pipe is written to directly.

    Raises DatasetError where the path is a folder or cannot be written.
    """
    write_all_atomically({path: content})


def write_all_atomically(contents: Mapping[Path, str | bytes]) -> None:
    """Write a set of files of which none is changed unless all could be written, texts as UTF-8.

    Each goes to a temporary file in its own folder first; then all take their names, in the order given. A terminal or
    a pipe is written to directly, at its turn.

    Raises DatasetError where a path is a folder or cannot be written.
    """
    data = {
        path: content if isinstance(content, bytes) else content.encode("utf-8") for path, content in contents.items()
    }
    made: dict[Path, Path] = {}  # temporary files by those whose names they take
    path = Path()
    try:
        for path, content in data.items():
            if path.is_dir():
                raise DatasetError(f"{path}: is a folder; name a file to write")
            if path.is_file() or not path.exists():
                made[path] = _temporary(path.resolve(), content)  # a link stays a link
        for path, content in data.items():
            if path in made:
                os.replace(made[path], path.resolve())
                del made[path]
            else:
                path.write_bytes(content)
    except BrokenPipeError:
        raise
    except OSError as error:  # its own text names no file for a full disk, else the temporary one
        raise _unwritable(path, error) from None
    finally:
        for temporary in made.values():
            temporary.unlink(missing_ok=True)


def _unwritable(path: Path, error: OSError) -> DatasetError:
    return DatasetError(f"{path}: cannot be written ({error.strerror or error}); name another place")


def require_free(out: Path) -> None:
    """Raise DatasetError where a path exists and is no empty folder."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DatasetError(f"{out}: exists and is not empty; name a new folder")


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """Path of a folder to make, which becomes `out`, new or empty, once the context ends without an error.

    Raises DatasetError where `out` is not free or cannot be written.
    """
    require_free(out)
    try:
        with tempfile.TemporaryDirectory(dir=out.absolute().parent, prefix=_cleared_prefix(out), suffix=_PART) as made:
            draft = Path(made) / "whole"
            yield draft
            if out.exists():
                out.rmdir()
            draft.rename(out)
    except OSError as error:
        raise _unwritable(out, error) from None


def _cleared_prefix(path: Path) -> str:
    """How temporary names beside a path begin; what killed writers left of them is removed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    prefix = f".{path.name[:_NAME]}."
    for old in path.parent.iterdir():
        if old.name.startswith(prefix) and old.suffix == _PART and old.stat().st_mtime < time.time() - _LEFT_OVER_S:
            shutil.rmtree(old) if old.is_dir() else old.unlink(missing_ok=True)
    return prefix


def _temporary(path: Path, content: bytes) -> Path:
    """A temporary file with the content of one to be, in its folder."""
    prefix = _cleared_prefix(path)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=prefix, suffix=_PART)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.chmod(name, 0o644)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return Path(name)
