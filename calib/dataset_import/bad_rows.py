"""Rows of a user's tables that cannot be read: which rows are left out with them, and the notes that say so."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from calib.dataset_import.reading import ImportReport
from calib.errors import visible
from calib.rendering import numbers
from calib.text_files.column_names import listed, plain
from calib.text_files.csv_text import as_number
from calib.text_files.user_table import RowFault, UserTable

_FEWEST = 3  # columns of a table in which a row of one cell is a remark
_DETAILED = 30  # rows of a table whose fault a note names; of further ones it names the line


_SUMMARIES = frozenset(
    listed(
        "mean average avg mittelwert mittel durchschnitt moyenne media promedio 平均 平均値 平均值 std stdev "
        "stddev stdabw standardabweichung standarddeviation écarttype ecarttype 標準偏差 标准差 min max minimum "
        "maximum 最大 最小 最大値 最小値 rms range spannweite sum summe total median"
    )
)


def without_remarks(report: ImportReport, table: UserTable) -> UserTable:
    """Table without limits, means and other summaries, and without remarks at its end, which are told."""
    end = len(table)
    while end > 1 and _is_remark(table.rows[end - 1]):
        end -= 1
    left_out = [i for i, row in enumerate(table.rows) if i >= end or (_first(row) in _SUMMARIES and _is_remark(row))]
    if not left_out or len(left_out) == len(table):
        return table
    names = [next(cell for cell in table.rows[i] if cell)[:40] for i in left_out]
    shown = report.leave_out(table, left_out, names, "a remark or summary")
    where = numbers.in_short([str(table.lines[i]) for i in left_out], _DETAILED)
    report.notes.append(
        visible(
            f"{table.path}: remarks and summaries beside the poses are left out, {table.rows_are}s {where}: {shown}"
        )
    )
    return table.of_rows([i for i in range(len(table)) if i not in left_out])


def _first(row: Sequence[str]) -> str:
    return plain(next((cell for cell in row if cell), ""))


def _is_remark(row: Sequence[str]) -> bool:
    """Whether the cells of a row are one text alone, or the first of them names a mean or the like."""
    filled = [cell for cell in row if cell]
    if not filled or as_number(filled[0]) is not None:
        return False
    return _first(row) in _SUMMARIES or (len(filled) == 1 and len(row) > _FEWEST)


def lines_of(bad: Sequence[RowFault], path: Path) -> set[int]:
    """Lines of a file whose rows are bad."""
    return {row.line for row in bad if row.path == path}


def rows_of(table: UserTable, lines: set[int]) -> set[int]:
    """Indices of the rows of some lines."""
    return {i for i, line in enumerate(table.lines) if line in lines}


def too_many_bad_rows(tables: Sequence[UserTable], bad: Sequence[RowFault]) -> tuple[str, ...]:
    """Fault of each table with more bad rows than half of its rows, which are too many to leave out."""
    return tuple(
        f"{table.path}: {count} of {len(table)} rows cannot be read, more than half of them: too many to leave out; "
        "check the separator, the decimal sign and the meaning of the columns"
        for table in tables
        if 2 * (count := len(lines_of(bad, table.path))) > len(table)
    )


def note_of(table: UserTable, bad: Sequence[RowFault]) -> str:
    """Sentence with the rows of a table that are left out, and what was found there."""
    of_table = sorted((row for row in bad if row.path == table.path), key=lambda row: row.line)
    places = [f"{row.place} ({row.found.partition(';')[0]})" for row in of_table]
    are = "is" if len(places) == 1 else "are"
    detailed = numbers.in_short(places, _DETAILED)
    return visible(f"{table.path.name}: {len(places)} of {len(table)} rows {are} left out, as unreadable: {detailed}")
