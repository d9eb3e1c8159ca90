"""Text of small files, read with bounds on size and type so that a pipe or device cannot block the program."""

from __future__ import annotations

import codecs
import re
from pathlib import Path

from calib.errors import DatasetError


def decoded(content: bytes) -> str:
    """A table's text in UTF-8, UTF-16 or UTF-32, as spreadsheets write them, else in Windows' Western encoding.

    UTF-16 without a byte order mark is recognised by the zero bytes of its ASCII characters.
    """
    if content.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)):
        return content.decode("utf-32", errors="replace")
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", errors="replace")
    head = content[:1000]
    for encoding, zeros, others in (("utf-16-le", head[1::2], head[::2]), ("utf-16-be", head[::2], head[1::2])):
        if len(head) >= 4 and zeros.count(0) > 0.6 * len(zeros) and not others.count(0):
            return content.decode(encoding, errors="replace")
    try:
        return codecs.getincrementaldecoder("utf-8-sig")().decode(content)  # a beginning may end within a character
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def read_text(
    path: Path, *, missing: str, kind: str, most_bytes: int, pipe: bool = False, any_encoding: bool = False
) -> str:
    """A file's text without its byte order mark, which editors on Windows and spreadsheets write.

    Args:
        path: of the file.
        missing: the remedy in the error where the file does not exist.
        kind: name of the format in errors, "TOML" or "CSV".
        most_bytes: the largest size that is read.
        pipe: whether a pipe is accepted, as where the user names one on the command line.
        any_encoding: whether encodings other than UTF-8 are accepted.

    Raises:
        DatasetError: it is missing, no file (reading a pipe would wait for ever), too large, or not UTF-8.
    """
    try:
        if path.exists() and not (path.is_file() or (pipe and path.is_fifo())):
            raise DatasetError(f"{path}: this is no file; put a {kind} file in its place")
        size, content = path.stat().st_size, b""
        if size <= most_bytes:
            with path.open("rb") as file:
                content = file.read(size or most_bytes + 1)  # a pipe has no size
        size = max(size, len(content))
        if size > most_bytes:
            raise DatasetError(
                f"{path}: the file has {size / 1e6:.4g} MB; a {kind} file of a dataset has at most "
                f"{most_bytes / 1e6:g} MB"
            )
        text = decoded(content) if any_encoding else content.decode("utf-8-sig")
        return re.sub("\r\n?", "\n", text)
    except FileNotFoundError:
        raise DatasetError(f"{path}: no such file; {missing}") from None
    except NotADirectoryError:
        raise DatasetError(f"{path.parent}: is a file; name the folder that it lies in") from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        words = f"line {line}: {' '.join(str(error).split())}"
        raise DatasetError(f"{path}: cannot be read as {kind} ({words}); save it as UTF-8") from None
    except OSError as error:
        raise DatasetError(f"{path}: {error.strerror or error}; check that the file can be read") from None
