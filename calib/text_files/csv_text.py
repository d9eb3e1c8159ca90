"""CSV text, read within size limits and written so that a spreadsheet takes no cell for a formula.

A text that begins as a formula does (`=cmd|...`, `@SUM(...)`, `+1+2`) is written behind an apostrophe, as
spreadsheets themselves do. Reading takes the apostrophe away, so a table comes back as it was. Numbers stay.
Source: "CSV Injection", OWASP.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Sequence
from io import StringIO
from pathlib import Path

from calib.errors import DatasetError, printable, visible
from calib.lazy_modules import pd
from calib.rendering import numbers

MOST_BYTES = 200_000_000
MOST_CELLS = 10_000_000  # a hundred thousand poses with a hundred columns
MOST_COLUMNS = 2_000  # that hold anything
WIDEST = 20_000  # cells of a row, the empty ones of a spreadsheet's 16,384 columns counted
_LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+\Z")
_FORMULA = re.compile(r"[=+\-@\t\r\uff1d\uff0b\uff0d\uff20]")  # the last four: their full-width forms
_GUARDED = re.compile(rf"'+{_FORMULA.pattern}")


def as_number(cell: str) -> float | None:
    """Finite number in a cell; None for a cell without one. Neither 1_0 nor digits of other scripts are numbers."""
    try:
        value = float(cell) if cell.isascii() and "_" not in cell else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def csv_rows(path: Path, text: str, delimiter: str = ",") -> list[tuple[int, list[str]]]:
    """Non-empty rows of CSV text, each with the number, from 1, of the line that it ends in.

    Raises DatasetError for more than `MOST_CELLS` cells, before any is made, and for text that is no CSV.
    """
    cells = text.count(delimiter) + text.count("\n") + text.count("\r")
    if cells > MOST_CELLS:
        raise DatasetError(
            f"{path}: the file has about {cells / 1e6:.3g} million cells, empty ones counted; a table has at most "
            f"{MOST_CELLS / 1e6:g} million, so remove empty rows and columns, or split it"
        )
    reader = csv.reader(lines_of(text), delimiter=delimiter, skipinitialspace=True)
    rows: list[tuple[int, list[str]]] = []
    try:
        for row in reader:
            if any(row):
                _refuse_wide(path, reader.line_num, row)
                rows.append((reader.line_num, list(map(_plain, row))))
        return rows
    except csv.Error as error:
        raise DatasetError(f"{path}: cannot be read as CSV ({' '.join(str(error).split())})") from None


def _refuse_wide(path: Path, line: int, row: list[str]) -> None:
    """Raise DatasetError for a row of more columns than a table of measurements may have."""
    if len(row) <= MOST_COLUMNS:
        return
    used = max(k + 1 for k, cell in enumerate(row) if cell)
    if used > MOST_COLUMNS or len(row) > WIDEST:
        raise DatasetError(
            f"{path}: line {line}: found {len(row)} columns; a table has at most {MOST_COLUMNS}, so remove the others "
            "or turn rows and columns round"
        )


def lines_of(text: str) -> Iterator[str]:
    """Lines of a text with their line ends, made with less memory than a file object needs."""
    return (found[0] for found in _LINE.finditer(text))


def _plain(cell: str) -> str:
    return cell[1:] if cell.startswith("'") and _GUARDED.match(cell) else cell


def _guarded(cell: object) -> object:
    """Cell text as written: one that begins like a formula, or with an apostrophe, gets an apostrophe in front.

    Control characters become escapes, except line ends and tabs, which a quoted cell may hold.
    """
    if not isinstance(cell, str) or as_number(cell) is not None:
        return cell
    cell = visible(cell, kept="\n\r\t")
    return f"'{cell}" if _FORMULA.match(cell) or _GUARDED.match(cell) else cell


def frame_csv(frame: pd.DataFrame) -> str:
    """A table as CSV text."""
    texts = {
        k: [_guarded(cell) for cell in frame.iloc[:, k]]
        for k, kind in enumerate(frame.dtypes)
        if not pd.api.types.is_numeric_dtype(kind)
    }
    columns = [texts[k] if k in texts else frame.iloc[:, k].to_numpy() for k in range(frame.shape[1])]
    out = pd.DataFrame(dict(enumerate(columns)), index=frame.index)
    out.columns = pd.Index([_guarded(str(name)) for name in frame.columns])
    return str(out.to_csv(index=False, lineterminator="\n"))


def rows_csv(rows: Sequence[Sequence[str]]) -> str:
    """Rows of texts as CSV text."""
    out = StringIO()
    csv.writer(out, lineterminator="\n").writerows([[_guarded(cell) for cell in row] for row in rows])
    return out.getvalue()


def names_in_short(names: Sequence[str]) -> str:
    """The first of some names, each cut to a few characters, separated by commas."""
    return numbers.in_short([printable(name[:60]) for name in names], 30)
