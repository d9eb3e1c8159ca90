"""Damage to tables of comma-separated values by hands and programs, and changes that leave their meaning."""

from __future__ import annotations

from collections.abc import Callable

from soaking.inputs import odd_values
from soaking.inputs.odd_values import Rng, at

Rows = list[list[str]]


def _rows(content: bytes) -> Rows:
    return [line.split(",") for line in content.decode().strip("\n").split("\n")]


def _bytes(rows: Rows) -> bytes:
    return ("\n".join(",".join(row) for row in rows) + "\n").encode("utf-8", "surrogatepass")


def _change(rng: Rng, rows: Rows) -> None:
    """Change the meaning of a table once, in place."""
    kind = int(rng.integers(16))
    i, j, column = at(rng, len(rows)), at(rng, len(rows)), at(rng, len(rows[0]))
    body = rows[1:]
    if kind == 0 and len(rows) > 2:
        del rows[i]
    elif kind == 1:
        rows.insert(i, list(rows[j]))
    elif kind == 2:
        rows[i], rows[j] = rows[j], rows[i]
    elif kind == 3:
        for row in rows:
            del row[column : column + 1]
    elif kind == 4:
        for row in rows:
            row.insert(column, row[at(rng, len(row))] if row else "")
    elif kind == 5:
        for row in body:  # a column of another unit
            try:
                row[column] = repr(float(row[column]) * 57.29577951308232)
            except (ValueError, IndexError):
                continue
    elif kind == 6:
        units = {
            "_deg": "_rad",
            "_rad": "_deg",
            "_mm": "_m",
            "_m": "_in",
            "_kg": "_g",
            "_c": "_f",
            "_s": "_ms",
        }
        for old, new in units.items():
            rows[0] = [name[: -len(old)] + new if name.endswith(old) else name for name in rows[0]]
    elif kind == 7 and rows[0]:
        rows[0][column % len(rows[0])] = odd_values.cell(rng)
    elif kind == 8 and body:
        worst = odd_values.cell(rng)
        for row in body:  # all of a column alike
            if column < len(row):
                row[column] = worst
    elif kind == 9:
        del rows[max(2, i) :]
    elif kind == 10:
        rows += [list(row) for row in body]
    elif kind == 11:
        rows[i] = rows[i] + [odd_values.cell(rng)] * int(rng.integers(1, 4))
    elif kind == 12:
        for row in rows:
            row += [""] * 1000
    elif kind == 13:
        rows.insert(1, list(rows[0]))
    else:
        for _ in range(int(rng.integers(1, 6))):
            row = rows[at(rng, len(rows))]
            if row:
                row[at(rng, len(row))] = odd_values.cell(rng)


def changed(rng: Rng, content: bytes) -> bytes:
    """A table after one to three changes of cells, rows and columns."""
    rows = _rows(content)
    for _ in range(int(rng.integers(1, 4))):
        _change(rng, rows)
        rows = rows or [[]]
    return _bytes(rows)


def _numbers(rows: Rows) -> list[int]:
    """Columns that hold nothing but numbers."""
    return [k for k in range(len(rows[0])) if all(k < len(row) and _is_number(row[k]) for row in rows[1:])]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def plausible(rng: Rng, content: bytes) -> bytes:
    """A table after one to three changes that leave it readable, however odd the measurement."""
    rows = _rows(content)
    for _ in range(int(rng.integers(1, 4))):
        columns = _numbers(rows)
        if len(rows) < 3 or not columns:
            break
        k, i, j = columns[at(rng, len(columns))], 1 + at(rng, len(rows) - 1), 1 + at(rng, len(rows) - 1)
        values = [float(row[k]) for row in rows[1:]]
        kind = int(rng.integers(11))
        if kind == 0:
            rows[i][k] = repr(float(rows[i][k]) * float(rng.choice([-1.0, 0.0, 2.0, 1e3, 1e-3, 57.29577951308232])))
        elif kind == 1:
            rows[i][k], rows[j][k] = rows[j][k], rows[i][k]
        elif kind == 2:
            values = [values[0]] * len(values)
        elif kind == 3:
            values = [float(round(value)) for value in values]
        elif kind == 4:
            values = [value * float(rng.choice([-1.0, 1e3, 1e-3, 1e6])) for value in values]
        elif kind == 5:
            values = [value + float(rng.choice([1e-3, 180.0, 1e4, 1e9])) for value in values]
        elif kind == 6:
            values = sorted(values)
        elif kind == 7:
            rows[1:] = [row for row in rows[1:] if rng.random() < 0.7]
        elif kind == 8:  # a pose measured again, where the others stay as they are
            rows[i][1:] = rows[j][1:]
        elif kind == 9 and "role" in rows[0]:
            role, told = rows[0].index("role"), str(rng.choice(["train", "test", "reference"]))
            for row in rows[1:]:
                row[role] = told if rng.random() < 0.8 else row[role]
        else:
            values = [value + float(rng.normal(0, 10.0 ** rng.integers(-6, 4))) for value in values]
        if kind in (2, 3, 4, 5, 6, 10):
            for row, value in zip(rows[1:], values, strict=True):
                row[k] = repr(value)
    return _bytes(rows)


def other_separator(rng: Rng, content: bytes) -> bytes:
    """The table as spreadsheets of other countries write it; sometimes with the decimal comma too."""
    if rng.random() < 0.5:
        content = content.replace(b",", b";").replace(b".", b",")
    return content.replace(b",", (b";", b"\t", b"|", b" ")[rng.integers(4)])


CHANGES: dict[str, Callable[[Rng, bytes], bytes]] = {
    "cells": changed,
    "cells again": changed,  # as often as two of the others
    **{f"plausible cells {k}": plausible for k in (1, 2, 3, 4, 5, 6)},
    "another separator": other_separator,
    **odd_values.BYTES,
}
"""By name: what a table may suffer."""


def shuffled_rows(rng: Rng, content: bytes) -> bytes:
    """The rows in another order below their header."""
    rows = _rows(content)
    return _bytes([rows[0], *(rows[1 + int(k)] for k in rng.permutation(len(rows) - 1))])


def shuffled_columns(rng: Rng, content: bytes) -> bytes:
    """The columns in another order."""
    order = [int(k) for k in rng.permutation(len(_rows(content)[0]))]
    return _bytes([[row[k] for k in order] for row in _rows(content)])


def quoted(rng: Rng, content: bytes) -> bytes:
    """Every cell in quotes."""
    return _bytes([[f'"{cell}"' for cell in row] for row in _rows(content)])


def spaced(rng: Rng, content: bytes) -> bytes:
    """A blank after each comma."""
    return content.replace(b",", b", ")


def padded(rng: Rng, content: bytes) -> bytes:
    """Zeros behind decimals."""
    rows = _rows(content)
    return _bytes([rows[0], *([f"{c}00" if _is_decimal(c) else c for c in row] for row in rows[1:])])


def _is_decimal(cell: str) -> bool:
    whole, point, part = cell.partition(".")
    return bool(point) and whole.lstrip("-").isdigit() and part.isdigit()


SAME: dict[str, Callable[[Rng, bytes], bytes]] = {
    "columns in another order": shuffled_columns,
    "cells in quotes": quoted,
    "blanks after commas": spaced,
    "zeros behind decimals": padded,
    "byte order mark": odd_values.byte_order_mark,
    "line ends": odd_values.windows_lines,
    "empty lines at the end": odd_values.blank_lines,
}
"""By name: what changes nothing of a table's meaning, whatever it holds."""
