"""Parsing shared by the readers of scan files: lines and numbers from bytes, and the errors for damaged files.

Every reader takes the file's bytes and returns points and normals. None trusts a header: the number of points in it is
compared with the bytes of the file before an array of that size is made.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from calib.array_types import Array
from calib.errors import ScanError

MOST_HEADER_BYTES = 65536
MOST_POINTS = 30_000_000  # six times those of a fine structured-light scan; they take 0.7 GB
PointsAndNormals = tuple[Array, Array | None]
"""Points (N, 3), rows without a value included, and normals (N, 3) or None."""
Reader = Callable[[Path, bytes], PointsAndNormals]

NO_VALUE = re.compile(r"[-+]?nan\(\w*\)|[-+]?1\.#\w+|#?n/?a\b|\bnull\b|-nan\b", re.IGNORECASE)
"""How the printf of some C libraries and spreadsheets write NaN."""

_NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))


def require_bounded(path: Path, points: int) -> None:
    """Raise ScanError for more points than any scan has, before memory is allocated for a number from a header."""
    if points > MOST_POINTS:
        raise ScanError(
            f"{path}: the scan has {points / 1e6:.4g} million points, which would take {24e-9 * points:.2g} GB as "
            f"numbers alone; crop it to the jig, or keep every {-(-points // MOST_POINTS)}th point: at most "
            f"{MOST_POINTS / 1e6:g} million are read"
        )


def text_lines(path: Path, content: bytes) -> list[str]:
    """Lines of a text file that are not blank, with any of the three line ends.

    Bytes that are no UTF-8 (a degree sign of another encoding in a comment) become replacement characters. Raises
    ScanError for more lines than a scan has points.
    """
    require_bounded(path, max(content.count(b"\n"), content.count(b"\r")))
    text = content.decode("utf-8-sig", "replace").replace("\r\n", "\n").replace("\r", "\n")
    return [line for line in text.split("\n") if line.strip()]


def numbers(path: Path, lines: Sequence[str], columns: Sequence[int], *, delimiter: str | None = None) -> Array:
    """Columns of text lines as (len(lines), len(columns)) float64. Raises ScanError where a number is missing."""
    if not lines:
        return np.zeros((0, len(columns)))
    try:
        return _parsed(lines, columns, delimiter)
    except (ValueError, OverflowError) as error:
        message = one_line(error)
    try:  # odd spellings of NaN are seldom, and looking for them takes a quarter of the time
        return _parsed([NO_VALUE.sub("nan", line) for line in lines], columns, delimiter)
    except (ValueError, OverflowError):
        raise ScanError(f"{path}: not three numbers a line ({message}); write x y z in each line") from None


def _parsed(lines: Sequence[str], columns: Sequence[int], delimiter: str | None) -> Array:
    return np.loadtxt(lines, ndmin=2, usecols=columns, delimiter=delimiter, comments=None)


def columns_of(path: Path, names: Sequence[str]) -> tuple[list[int], bool]:
    """Indices among column names of x, y, z and of a normal's three components, and whether there are normals.

    Raises ScanError where there is no x, y or z.
    """
    lower = [name.lower() for name in names]
    if not {"x", "y", "z"} <= set(lower):
        found = ", ".join(names[:12]) or "nothing"
        raise ScanError(f"{path}: its points have no x, y, z (found: {found}); export the coordinates too")
    columns = [lower.index(name) for name in "xyz"]
    for normals in _NORMALS:
        if set(normals) <= set(lower):
            return columns + [lower.index(name) for name in normals], True
    return columns, False


def doubles(values: np.ndarray) -> Array:
    """Values as float64, without a warning for bits that are a signalling NaN of float32."""
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)


def split(rows: Array, has_normals: bool) -> PointsAndNormals:
    """Points, and normals or None, from rows of three or six columns."""
    return rows[:, :3], rows[:, 3:6] if has_normals else None


def count(path: Path, word: str) -> int:
    """Number of points in a header as an integer. Raises ScanError where the word is no number."""
    if not (word.isascii() and word.isdigit() and len(word) <= 18):  # no file holds a number of 19 digits
        raise ScanError(f"{path}: the header has {word[:20]!r} for a number of points; export the scan again")
    return int(word)


def truncated(path: Path, promised: int, held: int) -> ScanError:
    """Error for a file that ends too early, with the numbers of points announced and present."""
    return ScanError(
        f"{path}: the file is truncated: its header promises {promised} points, it holds {held}; "
        "copy or export the scan again"
    )


def one_line(error: BaseException) -> str:
    """Text of an exception in one line of at most 120 characters."""
    return " ".join(str(error).split())[:120] or type(error).__name__
