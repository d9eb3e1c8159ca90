"""A dataset's CSV tables, whose every error names file, line and column; the header is line 1."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path

import numpy as np

from calib.array_types import Array
from calib.dataset.further_columns import Column, FurtherColumns
from calib.errors import DatasetError, is_one_line
from calib.text_files.csv_text import MOST_BYTES, as_number, csv_rows, names_in_short
from calib.text_files.text_file import read_text


@dataclass(frozen=True)
class TableFile:
    """A CSV file as a table of text cells, with the line of each row."""

    path: Path
    cells: dict[str, list[str]]  # by column
    lines: tuple[int, ...] = ()  # where each row ends in the file; without them one row a line, the header above

    @classmethod
    def load(cls, path: Path, *, pipe: bool = False, growing: bool = False) -> TableFile:
        """Read a CSV file. Raises DatasetError.

        Args:
            path: of the file.
            pipe: whether it may be a pipe.
            growing: whether it is still being written, so that a last line without its end is not read yet.
        """
        text = read_text(path, missing="dataset.toml names it", kind="CSV", most_bytes=MOST_BYTES, pipe=pipe)
        if growing:
            text = text[: text.rfind("\n") + 1]
        numbered = csv_rows(path, text)
        if not numbered:
            raise DatasetError(f"{path}: the file is empty; a header line with column names is needed")
        (_, names), *_ = numbered
        lines = tuple(line for line, _ in numbered[1:])
        body = [row for _, row in numbered[1:]]
        for other, called in ((";", "semicolons"), ("\t", "tabs")):
            if len(names) == 1 and other in names[0]:
                raise DatasetError(
                    f"{path}: line 1: cells are separated by {called}; separate them by commas, "
                    "with a point as decimal sign"
                )
        names = [" ".join(name.split()) for name in names]
        hidden = next((name for name in names if not is_one_line(name)), None)
        if hidden is not None:
            raise DatasetError(
                f"{path}: line 1: found a column {short(hidden)}; a name is one line without control characters"
            )
        while names and not names[-1]:  # a spreadsheet's empty columns on the right
            names.pop()
        for line, row in zip(lines, body, strict=True):
            if any(row[len(names) :]):
                raise DatasetError(
                    f"{path}: line {line}: found {len(row)} cells, the header names {len(names)} columns; "
                    "name the others or remove them"
                )
        repeated = next((name for name, times in Counter(names).items() if times > 1), None)
        if repeated is not None:
            raise DatasetError(f"{path}: line 1: column {short(repeated)} stands there twice; rename one")
        columns = zip_longest(*body, fillvalue="")
        return cls(path, {name: list(next(columns, [""] * len(body))) for name in names}, lines)

    def __len__(self) -> int:
        return len(next(iter(self.cells.values()), ()))

    def __contains__(self, column: str) -> bool:
        return column in self.cells

    def select(self, rows: Sequence[int]) -> TableFile:
        """The table with some of its rows, each with its line in the file."""
        cells = {name: [column[row] for row in rows] for name, column in self.cells.items()}
        return replace(self, cells=cells, lines=tuple(map(self.line, rows)))

    def line(self, row: int) -> int:
        """Line number of a row in the file, the first line being 1."""
        return self.lines[row] if self.lines else row + 2

    def error(self, row: int, column: str, found: str, remedy: str) -> DatasetError:
        return DatasetError(f"{self.path}: line {self.line(row)}, column {column}: {found}; {remedy}")

    def require(self, columns: Iterable[str]) -> None:
        missing = [name for name in columns if name not in self]
        if missing:
            raise DatasetError(
                f"{self.path}: line 1: missing column {', '.join(missing)}; found {names_in_short(list(self.cells))}"
            )

    def text(self, column: str, *, allow_empty: bool = False) -> list[str]:
        """Stripped cells of a column. Raises DatasetError for a missing column or, unless allowed, an empty cell."""
        values = [value.strip() for value in self.cells[column]]
        if not allow_empty and "" in values:
            raise self.error(values.index(""), column, "the cell is empty", "fill it in or remove the row")
        return values

    def numbers(self, columns: list[str]) -> Array:
        """Finite numbers (rows, columns) of some columns. Raises DatasetError with line and column."""
        out = np.empty((len(self), len(columns)))
        for k, column in enumerate(columns):
            texts = self.text(column)
            values = list(map(as_number, texts))
            if None in values:
                row = values.index(None)
                needed = "a finite number" if _is_number(texts[row]) else "a number"
                raise self.error(row, column, f"found {short(texts[row])}", f"{needed} is needed")
            out[:, k] = values
        return out

    def choices(self, column: str, allowed: tuple[str, ...]) -> list[str]:
        values = self.text(column)
        for row, value in enumerate(values):
            if value not in allowed:
                raise self.error(row, column, f"found {short(value)}", "expected " + ", ".join(allowed))
        return values

    def rest(self, known: Iterable[str]) -> FurtherColumns:
        """All columns except the known ones: as numbers where every cell is a number, else as text."""
        known = set(known)
        return FurtherColumns({name: _column(cells) for name, cells in self.cells.items() if name not in known})


def _column(cells: list[str]) -> Column:
    """Cells as whole numbers or numbers where every cell is one, else as text."""
    values = list(map(as_number, cells))
    if not values or None in values:
        return np.array(cells, dtype=object)
    try:
        return np.array(list(map(int, cells)), dtype=np.int64)
    except (ValueError, OverflowError):  # 1.5, or beyond 64 bits
        return np.array(values, dtype=float)


def _is_number(text: str) -> bool:
    """Whether Python reads a text as a number, nan and inf included."""
    try:
        float(text)
    except ValueError:
        return False
    return text.isascii() and "_" not in text


def short(text: str, most: int = 60) -> str:
    """Text in quotes for a message, cut to `most` characters, as an unclosed quote may make a very long cell."""
    return repr(text) if len(text) <= most else f"{text[:most]!r} ..."
