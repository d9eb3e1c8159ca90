"""Rows of a user's tables that cannot be read: which rows are left out with them, and the notes that say so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from calib.dataset_import.pose_names import comparable_id
from calib.dataset_import.reading import ImportReport, LeftOutRow
from calib.errors import visible
from calib.rendering import numbers
from calib.text_files.column_names import listed, plain
from calib.text_files.csv_text import as_number
from calib.text_files.user_table import RowFault, UserTable

_FEWEST = 3  # columns of a table in which a row of one cell is a remark
_SHOWN = 4
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
    report.left_out += [
        LeftOutRow(table.path.name, table.lines[i], name, "a remark or summary")
        for i, name in zip(left_out, names, strict=True)
    ]
    where = numbers.in_short([str(table.lines[i]) for i in left_out], _DETAILED)
    shown = numbers.in_short([repr(name) for name in names], _SHOWN)
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


@dataclass(frozen=True)
class LeftOutRows:
    """Lines of each table that are left out of an import, and the notes that name them."""

    by_table: Mapping[Path, frozenset[int]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def lines(self, path: Path) -> frozenset[int]:
        """Lines of a table that are left out."""
        return self.by_table.get(path, frozenset())


NOTHING_LEFT_OUT = LeftOutRows()


def too_many_bad_rows(tables: Sequence[UserTable], bad: Sequence[RowFault]) -> tuple[str, ...]:
    """Fault of each table with more bad rows than half of its rows, which are too many to leave out."""
    faults = []
    for table in tables:
        count = sum(row.path == table.path for row in bad)
        if 2 * count > len(table):
            faults.append(
                f"{table.path}: {count} of {len(table)} rows cannot be read, more than half of them: too many to leave "
                "out; check the separator, the decimal sign and the meaning of the columns"
            )
    return tuple(faults)


def left_out_rows(tables: Sequence[UserTable], bad: Sequence[RowFault], pose_columns: Sequence[str]) -> LeftOutRows:
    """Rows to leave out: the bad ones, and in the table of points those that belong to a bad row of joints.

    Where the table of points has no column of poses, rows of both tables belong together by their order.

    Args:
        tables: the table of joints, then that of points where it is another one.
        pose_columns: the column of each table that names the pose, "" where there is none.
    """
    lines = {table.path: {row.line for row in bad if row.path == table.path} for table in tables}
    notes = [_note(table, [row for row in bad if row.path == table.path]) for table in tables if lines[table.path]]
    if len(tables) == 2:
        joints, points = tables
        if pose_columns[1]:
            named = joints.text(pose_columns[0]) if pose_columns[0] else [f"p{i + 1}" for i in range(len(joints))]
            of_joints = zip(map(comparable_id, named), joints.lines, strict=True)
            gone = {name for name, line in of_joints if line in lines[joints.path] and name}
            of_points = zip(map(comparable_id, points.text(pose_columns[1])), points.lines, strict=True)
            more = {points.path: {line for name, line in of_points if name in gone} - lines[points.path]}
        else:
            both = list(zip(joints.lines, points.lines, strict=False))
            more = {
                joints.path: {j for j, p in both if p in lines[points.path]} - lines[joints.path],
                points.path: {p for j, p in both if j in lines[joints.path]} - lines[points.path],
            }
        for path, further in more.items():
            if further:
                lines[path] |= further
                are = "is" if len(further) == 1 else "are"
                lines_of_it = _lines(sorted(further))
                notes.append(
                    f"{_name(path)}: {lines_of_it} {are} left out, too, as the other table's rows of these poses are"
                )
    return LeftOutRows({path: frozenset(of_table) for path, of_table in lines.items()}, tuple(notes))


def _note(table: UserTable, bad: Sequence[RowFault]) -> str:
    """Sentence with the lines of a table that are left out, and what was found there."""
    are = "is" if len(bad) == 1 else "are"
    bad = sorted(bad, key=lambda row: row.line)
    detailed = "; ".join(f"{row.place} ({row.found.partition(';')[0]})" for row in bad[:_DETAILED])
    more = f"; and {_lines([row.line for row in bad[_DETAILED:]])}" if len(bad) > _DETAILED else ""
    text = f"{_name(table.path)}: {len(bad)} of {len(table)} rows {are} left out, as unreadable: {detailed}{more}"
    return visible(text)


def _lines(lines: Sequence[int]) -> str:
    return f"{'lines' if len(lines) > 1 else 'line'} {', '.join(map(str, lines))}"


def _name(path: Path) -> str:
    return visible(path.name)
