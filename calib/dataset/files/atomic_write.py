"""Files written atomically: a reader finds the old content or the new, never a part."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from calib.errors import DatasetError

_NAME = 100  # characters of a file's name in that of the temporary one, which has to be a name too


def write_text_atomically(path: Path, text: str) -> None:
    """Write UTF-8 text through a temporary file in the same folder, so that no reader finds a partial text."""
    write_bytes_atomically(path, text.encode("utf-8"))


def write_bytes_atomically(path: Path, content: bytes) -> None:
    """Write bytes through a temporary file in the same folder; a terminal or a pipe is written to directly.

    Raises DatasetError where the path is a folder or cannot be written.
    """
    if path.is_dir():
        raise DatasetError(f"{path}: is a folder; name a file to write")
    try:
        _write(path.resolve(), content)  # a link stays a link
    except BrokenPipeError:
        raise
    except OSError as error:  # its own text names no file for a full disk, else the temporary one
        raise DatasetError(f"{path}: cannot be written ({error.strerror or error}); name another place") from None


def _write(path: Path, content: bytes) -> None:
    if path.exists() and not path.is_file():
        path.write_bytes(content)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name[:_NAME]}.", suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.chmod(name, 0o644)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
