"""Points as text (.xyz, .asc, .pts, .csv, .txt): one per line, any usual delimiter, header lines, comments, a count."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from calib.errors import ScanError
from calib.scans.readers.parsing import NO_VALUE, PointsAndNormals, columns_of, numbers, split, text_lines, truncated

_COMMENTS = ("#", "//", "%", "!")
_DELIMITERS = (";", "\t", ",", "|")
_NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?|[-+]?(nan|inf(inity)?)", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
_WHOLE_NUMBER = re.compile(r"\d{1,18}", re.ASCII)
_WORD = re.compile(r"[a-df-zA-DF-Z#]")  # some character that no number has
_UNIT = re.compile(r"^(n?[xyz]|normal_[xyz])[ _]*[\[(]?(mm|m|cm|um|µm|in|inch)?[\])]?$", re.IGNORECASE)


def read_text(path: Path, content: bytes) -> PointsAndNormals:
    """Points and normals of a text file. Raises ScanError.

    Lines that start with #, //, % or ! are comments. A header line, or a comment right above the points, may name the
    columns (x, y, z and nx, ny, nz, in any order, x_mm or "X [mm]" too); without one the first three columns are x y z.
    The delimiter is ; or a tab, a comma, |, or white space, the decimal sign a point, or a comma where no comma can
    delimit. Empty cells are points without a value. A line of one whole number above the points is their number.
    """
    if b"\0" in content:
        raise ScanError(f"{path}: not three numbers a line (it is no text); write x y z in each line, in UTF-8")
    lines = text_lines(path, content)
    comments = [i for i, line in enumerate(lines) if line.lstrip().startswith(_COMMENTS)]
    skip = set(comments)
    rows = [line for i, line in enumerate(lines) if i not in skip]
    promised, rows = _counted(rows)
    if not rows:
        return _none(path, promised)
    header = ""
    delimiter = _delimiter(rows[min(1, len(rows) - 1)])
    if _is_header(rows[0], delimiter):
        header, rows = rows[0], rows[1:]
    elif comments and comments[0] == 0:
        above = 0
        while above + 1 in skip:
            above += 1
        comment = lines[above].strip().lstrip("#/%! ")
        if {"x", "y", "z"} <= {_bare(path, name) for name in _cells(comment, _delimiter(comment))}:
            header = comment
    columns, has_normals = [0, 1, 2], False
    if promised is None:
        promised, rows = _counted(rows)  # below the names
    if not rows:
        return _none(path, promised)
    if promised is not None and len(rows) < promised:
        raise truncated(path, promised, len(rows))
    if header:
        names = _cells(header, _delimiter(header))
        columns, has_normals = columns_of(path, [_bare(path, name) for name in names])
    return split(numbers(path, _plain(rows, delimiter), columns, delimiter=delimiter), has_normals)


def _none(path: Path, promised: int | None) -> PointsAndNormals:
    """Empty points for a file without rows. Raises ScanError where its header announces some."""
    if promised:
        raise truncated(path, promised, 0)
    return np.zeros((0, 3)), None


def _counted(rows: list[str]) -> tuple[int | None, list[str]]:
    """Number of points where the first line is only a number, else None; and the rows below."""
    first, second = ([line.strip() for line in rows[:2]] + ["", ""])[:2]
    if not _WHOLE_NUMBER.fullmatch(first) or _WHOLE_NUMBER.fullmatch(second):
        return None, rows
    return int(first), rows[1:]


def _delimiter(line: str) -> str | None:
    """Delimiter of a row of numbers; None stands for white space."""
    delimiter = next((d for d in _DELIMITERS if d in line), None)
    if delimiter == ",":
        words = line.split()
        if len(words) >= 3 and all(_DECIMAL_COMMA.fullmatch(word) for word in words[:3]):
            return None
    if delimiter == "\t" and not any(line.strip().split("\t")[1:]):
        return None
    return delimiter


def _cells(line: str, delimiter: str | None) -> list[str]:
    """Cells of a line without white space and quotes around them."""
    return [cell.strip().strip("\"'") for cell in line.strip().split(delimiter)]


def _is_header(line: str, delimiter: str | None) -> bool:
    """Whether a line names columns: none of its first three cells is a number."""
    cells = _cells(line, delimiter if delimiter and delimiter in line else _delimiter(line))
    return not any(_NUMBER.fullmatch(cell) or not cell or NO_VALUE.fullmatch(cell) for cell in cells[:3])


def _bare(path: Path, name: str) -> str:
    """A column's name without its unit. Raises ScanError where a coordinate's unit is not the millimetre."""
    match = _UNIT.match(name.strip())
    if match is None:
        return name
    unit = (match[2] or "mm").lower()
    if unit != "mm":
        raise ScanError(
            f"{path}: its header gives {name!r}, coordinates in {unit}; scans are in mm, write them in millimetres"
        )
    return match[1].lower()


def _plain(rows: list[str], delimiter: str | None) -> list[str]:
    """Rows in the form that numpy parses: no quotes, NaN spelt nan, a value in each cell, decimal points."""
    text = "\n".join(rows).replace('"', "")
    if _WORD.search(text):
        text = NO_VALUE.sub("nan", text)
    if delimiter is not None:
        dense = "\n" + text.replace(" ", "") + "\n"
        if any(blank in dense for blank in (2 * delimiter, delimiter + "\n", "\n" + delimiter)):
            text = re.sub(rf"(?m)(^|(?<={re.escape(delimiter)})) *(?={re.escape(delimiter)}|$)", "nan", text)
    if delimiter != "," and "," in text:
        text = text.replace(",", ".")
    return text.split("\n")
