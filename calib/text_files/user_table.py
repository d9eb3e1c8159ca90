"""Tables as users have them: any usual separator, decimal commas, optional header, units in the columns' names."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.errors import DatasetError
from calib.rendering.numbers import natural_order
from calib.text_files.csv_text import MOST_BYTES, as_number, csv_rows
from calib.text_files.layout import PLAIN_NUMBERS, NumberStyle, header_of, number_style, separator_of, without_comments
from calib.text_files.records import content_of, declared_positions, is_records, list_columns, read_records, rows_of
from calib.text_files.text_file import read_text

Naming = Callable[[Sequence[str]], bool]
"""Whether cells are names of columns that the reader knows."""
_LABELS = 3  # columns in which a turned table may have its labels: groups, names, units
_MOST_LABELS = 200
_TITLES = 15  # rows above a table in which its names are looked for
_FEWEST_CELLS = 3  # of a row that is no title or note
_STYLE_ROWS = 2000  # by which the way of writing numbers is told
LINE, COLUMN, FILE = "line", "column", "file"
_MOST_FILES = 10_000


@dataclass(frozen=True)
class RowFault:
    """Fault of one row of a table, which concerns no other row."""

    path: Path
    line: int
    found: str  # the column, what was found there and what is needed
    column: str = ""  # "" where the whole row is concerned
    rows_are: str = LINE  # what the number counts

    def __str__(self) -> str:
        return f"{self.path}: {self.place}: {self.found}"

    @property
    def place(self) -> str:
        """Line and column in the file."""
        across = "row" if self.rows_are == COLUMN else "column"
        return f"{self.rows_are} {self.line}" + (f", {across} {self.column}" if self.column else "")


Fault = str | RowFault


@dataclass(frozen=True)
class UserTable:
    """A user's table as text cells, with the line of each row."""

    path: Path
    columns: tuple[str, ...]  # without a header "column 1", ...
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    has_header: bool
    positions: tuple[int, ...] = ()  # of the rows in the file, from 0; (): rows 0, 1, 2 ...
    separator: str = ","  # of a text
    style: NumberStyle = PLAIN_NUMBERS  # of the numbers in a text; those of the rows are plain
    rate_hz: float = 0.0  # of the rows, where the file tells it
    rows_are: str = LINE  # what a row is in the file, or of the files, and its line's number counts

    def __len__(self) -> int:
        return len(self.rows)

    def text(self, column: str) -> list[str]:
        """The cells of a column, as text."""
        k = self.columns.index(column)
        return [row[k] for row in self.rows]

    def position(self, row: int) -> int:
        """Index, from 0, that a row has among all rows of the file."""
        return self.positions[row] if self.positions else row

    def fault(self, row: int, found: str, column: str = "") -> RowFault:
        """Fault of a row, by its place in the file, or by the name of the file that it is."""
        rows_are = f"{self.rows[row][0]}{self.path.suffix}, {FILE}" if self.rows_are == FILE else self.rows_are
        return RowFault(self.path, self.lines[row], found, column, rows_are)

    def without(self, lines: Collection[int]) -> UserTable:
        """Table without the rows of these lines."""
        return self.of_rows([i for i, line in enumerate(self.lines) if line not in lines])

    def of_rows(self, kept: Collection[int]) -> UserTable:
        """Table with some of its rows."""
        return replace(
            self,
            rows=tuple(self.rows[i] for i in kept),
            lines=tuple(self.lines[i] for i in kept),
            positions=tuple(map(self.position, kept)),
        )

    def numbers(self, column: str, fault: Callable[[Fault], None], *, may_be_empty: bool = False) -> Array:
        """Finite numbers (rows,) of a column; a cell that holds none is reported to `fault` and becomes NaN.

        may_be_empty: whether an empty cell is NaN and no fault.
        """
        out = np.full(len(self), math.nan)
        for i, cell in enumerate(self.text(column)):
            value = as_number(cell)
            if value is not None:
                out[i] = value
            elif cell or not may_be_empty:
                fault(self.fault(i, f"found {cell[:40]!r}; a number is needed", column))
        return out

    def known(self, columns: Iterable[str]) -> Array:
        """Numbers (rows, columns) of some columns; NaN for a cell that holds none."""
        return np.column_stack([self.numbers(column, lambda _: None) for column in columns])


def load_table(
    path: Path,
    fault: Callable[[Fault], None] | None = None,
    *,
    any_encoding: bool = False,
    is_names: Naming | None = None,
) -> UserTable:
    """Read a user's table from a file. Raises DatasetError where it is not one.

    `any_encoding` accepts what spreadsheets write besides UTF-8. With `fault`, each mistake in names and rows is
    reported there and the table is read all the same. Spreadsheets, JSON records and NumPy's arrays are read, too, and
    by a pattern, `poses/*.json`, files with a row each. With `is_names`, a table whose names stand below each other, a
    column a pose, is turned.
    """
    if "*" in path.name:
        files = sorted(path.parent.glob(path.name), key=lambda file: natural_order(file.name))[:_MOST_FILES]
        cells = _rows_of_files(path, files, any_encoding=any_encoding)
        rows = list(enumerate(cells, 1 + len(files) - len(cells)))  # the names of columns are of no file
        return replace(_table_of(path, rows, fault, is_names=is_names), rows_are=FILE)
    if is_records(path):
        rows = [(k + 1, row) for k, row in enumerate(read_records(path)) if any(row)]
        return _table_of(path, rows, fault, is_names=is_names)
    return parse_table(
        path,
        read_text(
            path, missing="name a table of numbers", kind="CSV", most_bytes=MOST_BYTES, any_encoding=any_encoding
        ),
        fault,
        is_names,
    )


def _rows_of_files(path: Path, files: Sequence[Path], *, any_encoding: bool) -> list[list[str]]:
    """Rows of cells of files with a record each, the file's name first. Raises DatasetError."""
    if not files:
        raise DatasetError(f"{path}: no such files; name a table of numbers")
    records: list[Any] = []
    for file in files:
        if is_records(file):
            records.append(content_of(file))
            continue
        table = load_table(file, lambda _: None, any_encoding=any_encoding)
        named = table.has_header and len(table) == 1
        records.append(dict(zip(table.columns, table.rows[0], strict=True)) if named else list(map(list, table.rows)))
    if all(isinstance(each, dict) for each in records):
        return rows_of(path, [{"file": file.stem, **each} for file, each in zip(files, records, strict=True)])
    rows = [[file.stem, *row] for file, row in zip(files, rows_of(path, records), strict=True)]
    if len(set(map(len, rows))) > 1:
        usual = Counter(map(len, rows)).most_common(1)[0][0]
        odd = next(k for k, row in enumerate(rows) if len(row) != usual)
        raise DatasetError(
            f"{files[odd]}: found {len(rows[odd]) - 1} numbers, the other files of {path} have {usual - 1}; a "
            "record of one length a file is needed"
        )
    return rows


def parse_table(
    path: Path, text: str, fault: Callable[[Fault], None] | None = None, is_names: Naming | None = None
) -> UserTable:
    """Parse a user's table from text; `path` names it in errors. Otherwise as `load_table`."""
    if not text.strip():
        raise DatasetError(f"{path}: the file is empty; a header line with column names is needed")
    if positions := declared_positions(text):
        return _table_of(path, positions, fault)
    separator = separator_of(text)
    text = without_comments(text, separator)
    if separator == " ":
        text = "\n".join(
            ",".join(f'"{word}"' if "," in word else word for word in line.split()) for line in text.splitlines()
        )
    numbered = [
        (line, [" ".join(c.split()) for c in row])
        for line, row in csv_rows(path, text, "," if separator == " " else separator)
        if any(c.strip() for c in row)
    ]
    return replace(_table_of(path, numbered, fault, separator, is_names), separator=separator)


def _turned(rows: Sequence[tuple[int, list[str]]], is_names: Naming) -> list[tuple[int, list[str]]]:
    """Columns of a table whose names stand below each other, as rows with their numbers; [] where they do not."""
    cells = [row for _, row in rows if sum(map(bool, row)) >= _FEWEST_CELLS]
    if len(cells) > _MOST_LABELS or any(map(is_names, cells[:_TITLES])):
        return []
    for k in range(_LABELS):
        labels = [row[k] if k < len(row) else "" for row in cells]
        if is_names([label for label in labels if label]):
            width = max(map(len, cells))
            columns = ([row[i] if i < len(row) else "" for row in cells] for i in range(k, width))
            return [(i + 1, column) for i, column in enumerate(columns, k) if any(column)]
    return []


def _numbers(row: Sequence[str]) -> int:
    return sum(as_number(cell) is not None for cell in row)


def _table_of(
    path: Path, numbered: Sequence[tuple[int, list[str]]], fault: Callable[[Fault], None] | None, separator: str = ",",
    is_names: Naming | None = None,
) -> UserTable:  # fmt: skip
    """Table of rows of cells, each with its line; names stand above the first row of numbers, else as `load_table`."""

    def wrong(message: Fault) -> None:
        if fault is None:
            raise DatasetError(str(message))
        fault(message)

    style = number_style([cell for _, row in numbered[:_STYLE_ROWS] for cell in row], separator)
    numbered = [(line, list(map(style.plain, row))) for line, row in numbered]
    turned = _turned(numbered, is_names) if is_names is not None and numbered else []
    numbered = turned or numbered
    if is_names is not None:  # limits and means may stand above the names
        words = [k for k, (_, row) in enumerate(numbered[:_TITLES]) if not _numbers(row) and is_names(row)]
        numbered = [row for k, row in enumerate(numbered) if not words or k >= words[0] or not _numbers(row[1])]
    header = header_of(numbered)
    again = next(row for line, row in numbered if line == header.line) if header.names else None
    body, names = [(line, row) for line, row in numbered[header.first :] if row != again], list(header.names)
    columns = names or [f"column {k + 1}" for k in range(len(numbered[0][1]))]
    columns = [name or f"column {k + 1}" for k, name in enumerate(columns)]
    for repeated in [name for name, times in Counter(columns).items() if times > 1]:
        wrong(f"{path}: line {header.line}: column {repeated!r} stands there twice; rename one")
        columns = [
            f"{name} ({columns[:k].count(name) + 1})" if name == repeated and name in columns[:k] else name
            for k, name in enumerate(columns)
        ]
    if not body:
        raise DatasetError(f"{path}: no row below the header; one row a pose is needed")
    wide = [(number, row) for number, row in body if any(row[len(columns) :])]
    if 2 * len(wide) > len(body):
        raise DatasetError(
            f"{path}: line {header.line}: found {len(columns)} names and {len(wide[0][1])} cells in line "
            f"{wide[0][0]} and most others; part the names by the same sign as the cells, and name all columns"
        )
    for number, row in wide:
        found = f"found {len(row)} cells, the first line has {len(columns)}; name the others or remove them"
        wrong(RowFault(path, number, found))
    width = len(columns)
    rows = [(row + [""] * width)[:width] for _, row in body]
    columns, rows = list_columns(columns, rows)
    return UserTable(
        path, tuple(columns), tuple(map(tuple, rows)), tuple(number for number, _ in body), bool(names), style=style,
        rate_hz=header.rate_hz, rows_are=COLUMN if turned else LINE,
    )  # fmt: skip
