"""Tables that are no text: sheets of a spreadsheet, and JSON records, as rows of cells that keep their line numbers.

A sheet of a workbook is named behind its file, `points.xlsx#Sheet2`; without a name its first sheet with a table is
meant.
"""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from calib.errors import DatasetError
from calib.text_files.csv_text import MOST_BYTES, MOST_CELLS
from calib.text_files.text_file import read_text

SPREADSHEETS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
RECORDS = (*SPREADSHEETS, ".json")
"""Suffixes of the files that are read as rows of cells."""
_MOST_UNPACKED = 200_000_000  # bytes of a workbook, which is a zip
_MOST_ROWS = 200_000
_FEWEST_CELLS = 3  # filled in a row of a table; titles above it have fewer
_ANGLES = ("q", "joints", "joint", "jointpositions", "jointangles", "jointstates", "jointvalues", "angles", "actualq",
           "jointpos", "qpos")  # fmt: skip
_PLACES = ("position", "positions")  # beside lists of angles; without them they are the joints'
_JOINTS = (*_ANGLES, *_PLACES)
_LIST = re.compile(r"\[[^\[\]]*\]|\([^()]*\)")
_POINT = ("point", "xyz", "measured", "translation", "marker", "tcp", "tracker")

Rows = list[list[str]]


def table_file(path: Path) -> tuple[Path, str]:
    """File that holds a table, and the name of its sheet; "" where none is named."""
    name, mark, sheet = path.name.rpartition("#")
    if mark and Path(name).suffix.lower() in SPREADSHEETS and not path.exists():
        return path.with_name(name), sheet
    return path, ""


def is_records(path: Path) -> bool:
    """Whether a path names a spreadsheet, one of its sheets, or JSON."""
    return table_file(path)[0].suffix.lower() in RECORDS


def read_records(path: Path) -> Rows:
    """Rows of cells of a sheet, with what stands above its table, or of JSON records below their names.

    Raises DatasetError where the file cannot be read or holds no such table.
    """
    file, wanted = table_file(path)
    if file.suffix.lower() == ".json":
        return _json_rows(file)
    found = sheets(file)
    if wanted:
        rows = found.get(wanted)
        if rows is None:
            raise DatasetError(f"{file}: no sheet {wanted!r}; there are {', '.join(map(repr, found)) or 'none'}")
        return rows
    if not found:
        raise DatasetError(f"{file}: no sheet holds a table; a row of column names with the values below is needed")
    return next(iter(found.values()))


def sheets(path: Path) -> dict[str, Rows]:
    """Sheets of a workbook that hold a table, by name. Raises DatasetError."""
    if not path.is_file():
        raise DatasetError(f"{path}: no such file; name a table of numbers")
    _refuse_large(path)
    try:
        from python_calamine import CalamineError, CalamineWorkbook
    except ModuleNotFoundError:
        raise DatasetError(
            f"{path}: a spreadsheet is read with python-calamine, which is not installed: "
            "pip install 'robot-calibration-inspector[sheets]', or save the sheet as CSV"
        ) from None
    try:
        workbook = CalamineWorkbook.from_path(str(path))
        named = {
            name: workbook.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in workbook.sheet_names
        }
    except (CalamineError, OSError, ValueError, zipfile.BadZipFile) as error:
        raise DatasetError(f"{path}: cannot be read as a spreadsheet ({error}); save its sheet as CSV") from None
    tables = {name: _of_table([list(map(_cell, row)) for row in rows[:_MOST_ROWS]]) for name, rows in named.items()}
    return {name: rows for name, rows in tables.items() if rows}


def _refuse_large(path: Path) -> None:
    """Raise DatasetError for a workbook that is too large packed or unpacked."""
    size = path.stat().st_size
    try:
        with zipfile.ZipFile(path) as packed:
            size = max(size, sum(info.file_size for info in packed.infolist()))
    except zipfile.BadZipFile:
        pass  # an .xls is none
    if size > _MOST_UNPACKED:
        raise DatasetError(
            f"{path}: unpacked it has {size / 1e6:.4g} MB, a workbook has at most {_MOST_UNPACKED / 1e6:g} MB; "
            "save the sheet as CSV"
        )


def _of_table(rows: Rows) -> Rows:
    """The rows where several have three filled cells or more, which titles have not; [] where there is no table."""
    return rows if sum(sum(map(bool, row)) >= _FEWEST_CELLS for row in rows) > 1 else []


def _cell(value: Any) -> str:
    """Text of a cell: numbers with all their digits, whole ones without a point."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    if isinstance(value, date):
        return value.isoformat()
    return " ".join(str(value).split())


# ---- JSON ------------------------------------------------------------------------------------------------------------


def _json_rows(path: Path) -> Rows:
    """Rows of a JSON list of records; of an object the longest list of records in it."""
    text = read_text(path, missing="name a table of numbers", kind="JSON", most_bytes=MOST_BYTES)
    try:
        content = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise DatasetError(f"{path}: cannot be read as JSON ({error}); one object a pose in a list is needed") from None
    if isinstance(content, Mapping):
        lists = {name: value for name, value in content.items() if isinstance(value, list) and value}
        of_records = [value for value in lists.values() if all(isinstance(each, Mapping) for each in value)]
        if of_records or not lists:
            content = max(of_records, key=len, default=content)
        else:  # a list a column
            most = max(map(len, lists.values()))
            named = {name: value for name, value in lists.items() if len(value) == most}
            content = [dict(zip(named, row, strict=True)) for row in zip(*named.values(), strict=True)]
    if not isinstance(content, list) or not content or not all(isinstance(each, Mapping) for each in content):
        raise DatasetError(f"{path}: holds no list of records; one object a pose in a list is needed")
    records = [flat_record(each) for each in content[:_MOST_ROWS]]
    names = list(dict.fromkeys(name for record in records for name in record))
    if len(records) * len(names) > MOST_CELLS:
        found = f"its {len(records)} records have {len(names)} different keys"
        raise DatasetError(f"{path}: {found}; give all records the same keys")
    return [names, *[[record.get(name, "") for name in names] for record in records]]


def flat_record(record: Mapping[str, Any]) -> dict[str, str]:
    """Cells of a record by column: a list of joints as q1 ..., of a point as x, y, z, an object by its keys."""
    out: dict[str, str] = {}
    keys = {name: "".join(c for c in str(name).lower() if c.isalnum()) for name in record}
    has_joints = any(isinstance(record[name], list) and key in _ANGLES for name, key in keys.items())
    for name, value in record.items():
        key = f"point{keys[name]}" if has_joints and keys[name] in _PLACES else keys[name]
        if isinstance(value, Mapping):
            for inner, cell in flat_record(value).items():
                out[inner if inner in ("x", "y", "z") else f"{name}_{inner}"] = cell
        elif isinstance(value, list):
            out |= {column: _cell(v) for column, v in zip(_names(str(name), key, value), value, strict=True)}
        elif value is not None:
            out[str(name)] = _cell(value)
    return out


def _names(name: str, key: str, values: Sequence[Any]) -> list[str]:
    """Columns of a list: its name with numbers, unless it is the joints' or a point's."""
    if len(values) == 3 and any(key.startswith(word) for word in _POINT):
        return ["x", "y", "z"]
    start = "q" if key in _JOINTS or key.endswith(("state", "qpos")) else f"{name}_"
    return [f"{start}{k + 1}" for k in range(len(values))]


def list_columns(names: Sequence[str], rows: Sequence[list[str]]) -> tuple[list[str], list[list[str]]]:
    """Columns whose cells are lists of numbers, such as [0.1, 0.2], as a column each, named as those of records."""
    lists: dict[int, list[list[str]]] = {}
    for k in range(len(names)):
        if rows and all(_LIST.fullmatch(row[k]) for row in rows):
            found = [re.split(r"[,;\s]+", row[k][1:-1].strip()) for row in rows]
            if len({len(each) for each in found}) == 1 and len(found[0]) > 1:
                lists[k] = found
    if not lists:
        return list(names), list(rows)
    flat = list(flat_record({name: [0] * len(lists[k][0]) if k in lists else "" for k, name in enumerate(names)}))
    cells = [
        [cell for k, old in enumerate(row) for cell in (lists[k][i] if k in lists else [old])]
        for i, row in enumerate(rows)
    ]
    return (flat, cells) if len(flat) == len(cells[0]) else (list(names), list(rows))
