"""Tables that are no text: sheets of a spreadsheet, JSON records and NumPy's arrays, as rows of cells.

A sheet of a workbook is named behind its file, `points.xlsx#Sheet2`; without a name its first sheet with a table is
meant. Files with a record each are named by a pattern, `poses/*.json`.
"""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from datetime import date
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from calib.bounded_process import ProcessFailed, ProcessLimits, ask
from calib.errors import DatasetError
from calib.text_files.column_names import listed, plain, split_unit
from calib.text_files.csv_text import MOST_BYTES, MOST_CELLS, lines_of
from calib.text_files.text_file import read_text

SPREADSHEETS = listed(".xlsx .xlsm .xlsb .xls .ods")
ARRAYS = (".npz", ".npy")
JSON_LINES = (".jsonl", ".ndjson")
YAML = (".yaml", ".yml")
RECORDS = (*SPREADSHEETS, *ARRAYS, ".json", *JSON_LINES)
"""Suffixes of the files that are read as rows of cells."""
_MOST_UNPACKED = 200_000_000  # bytes of a workbook, which is a zip
_MOST_ROWS = 200_000
_MOST_YAML_BYTES = 20_000_000
_FEWEST_CELLS = 3  # filled in a row of a table; titles above it have fewer
_JOINTS = re.compile(r"(actual|measured|current|get)*(q|qpos|angles?|joints?(pos|positions?|angles?|states?|values?)?)")
_END_IN_JOINTS = listed("q joints jointpositions jointangles state qpos")  # behind what they are of
_PLACES = listed("position positions translation xyz point pos")  # names that tell nothing but a place
_TURNS, _QUATERNION = listed("orientation rotation quaternion quat"), listed("w x y z")
_NAMES = ("name", "names", "joint_names")
_LIST = re.compile(r"\[[^\[\]]*\]|\([^()]*\)")
_ENTRY = re.compile(r"([AE][1-6]|[XYZABC])\s+([-+.\dEe]+)")  # of a position of KUKA's
_POSITION = r"\{[\s,]*(?:(?:[AE][1-6]|[XYZABCST])\s+[-+.\dEe]+[\s,]*)+\}"
_DECLARED = re.compile(rf"\s*(?:[A-Za-z]\w*\s+)*(?:X?(?P<name>\w+)\s*=\s*)?(?P<position>{_POSITION})")

Rows = list[list[str]]


def table_file(path: Path) -> tuple[Path, str]:
    """File that holds a table, and the name of its sheet; "" where none is named."""
    name, mark, sheet = path.name.rpartition("#")
    if mark and Path(name).suffix.lower() in SPREADSHEETS and not path.exists():
        return path.with_name(name), sheet
    return path, ""


def is_records(path: Path) -> bool:
    """Whether a path names a spreadsheet, one of its sheets, JSON, YAML, or arrays of NumPy."""
    return table_file(path)[0].suffix.lower() in (*RECORDS, *YAML)


def read_records(path: Path) -> Rows:
    """Rows of cells of a sheet, with what stands above its table, or of records below their names.

    Raises DatasetError where the file cannot be read or holds no such table.
    """
    file, wanted = table_file(path)
    if file.suffix.lower() not in SPREADSHEETS:
        content = content_of(file)
        try:
            return rows_of(file, records_in(content))
        except RecursionError:
            raise DatasetError(f"{file}: is nested too deep; one object a pose in a list is needed") from None
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
    if find_spec("python_calamine") is None:
        raise DatasetError(
            f"{path}: a spreadsheet is read with python-calamine, which is not installed: "
            "pip install 'robot-calibration-inspector[sheets]', or save the sheet as CSV"
        )
    status = path.stat()
    return _sheets(path, (status.st_mtime_ns, status.st_size))


@lru_cache(maxsize=4)
def _sheets(path: Path, _version: tuple[int, int]) -> dict[str, Rows]:
    """Sheets of a workbook, which two cells far apart lead to ask for any memory: read in a bounded process."""
    try:
        told = ask("calib.text_files.records:workbook", {"path": str(path.absolute())}, ProcessLimits(seconds=60.0))
    except ProcessFailed as error:
        told = f"it {error}"
    if isinstance(told, str):
        raise DatasetError(f"{path}: cannot be read as a spreadsheet ({told}); save its sheet as CSV")
    return {name: rows for name, rows in told.items() if rows}


def workbook(request: Mapping[str, str]) -> dict[str, Rows] | str:
    """Tables of a workbook's sheets by name, or why it cannot be read: the answer of a bounded process."""
    from python_calamine import CalamineError, CalamineWorkbook

    try:
        book = CalamineWorkbook.from_path(request["path"])
        named = {name: book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in book.sheet_names}
    except (CalamineError, OSError, ValueError, zipfile.BadZipFile) as error:
        return str(error)
    return {name: _of_table([list(map(_cell, row)) for row in rows[:_MOST_ROWS]]) for name, rows in named.items()}


def _refuse_large(path: Path) -> None:
    """Raise DatasetError for a workbook, or arrays of NumPy, too large packed or unpacked."""
    size = path.stat().st_size
    try:
        with zipfile.ZipFile(path) as packed:
            size = max(size, sum(info.file_size for info in packed.infolist()))
    except zipfile.BadZipFile:
        pass  # an .xls is none
    if size > _MOST_UNPACKED:
        raise DatasetError(
            f"{path}: unpacked it has {size / 1e6:.4g} MB, a table has at most {_MOST_UNPACKED / 1e6:g} MB; "
            "save what is needed of it as CSV"
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


# ---- records ---------------------------------------------------------------------------------------------------------


def content_of(path: Path) -> Any:
    """Content of a JSON or YAML file, a list of its lines' or documents', or of NumPy's arrays. Raises DatasetError."""
    if path.suffix.lower() in YAML:
        documents = yaml_documents(path)
        return documents[0] if len(documents) == 1 else documents
    if path.suffix.lower() in ARRAYS:
        try:
            _refuse_large(path)
            found = np.load(path, allow_pickle=False)
            return found.tolist() if path.suffix.lower() == ".npy" else {key: found[key].tolist() for key in found}
        except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise DatasetError(f"{path}: cannot be read as arrays of NumPy ({error})") from None
    text = read_text(path, missing="name a table of numbers", kind="JSON", most_bytes=MOST_BYTES)
    try:
        if path.suffix.lower() in JSON_LINES:
            return [json.loads(line) for line in text.splitlines() if line.strip()]
        return json.loads(text)
    except (ValueError, RecursionError) as error:  # a ValueError also for an integer of thousands of digits
        raise DatasetError(f"{path}: cannot be read as JSON ({error}); one object a pose in a list is needed") from None


def yaml_documents(path: Path) -> list[Any]:
    """Documents of a YAML file, several where --- part them. Raises DatasetError."""
    text = read_text(path, missing="name a file of records", kind="YAML", most_bytes=_MOST_YAML_BYTES)
    try:
        import yaml
    except ImportError:
        raise DatasetError(
            f"{path}: YAML needs PyYAML, which is not installed: pip install 'robot-calibration-inspector[sheets]'"
        ) from None

    class Loader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML has no types
        """Safe loader that takes OpenCV's matrices as maps, and refuses aliases, by which small files grow huge."""

        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.events.AliasEvent):
                raise yaml.YAMLError("aliases (*name) are not read")
            return super().compose_node(parent, index)

    Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", lambda loader, node: loader.construct_mapping(node, True))
    if text.startswith("%YAML:"):  # OpenCV's own way of writing the version
        text = text.partition("\n")[2]
    try:
        return [one for one in yaml.load_all(text, Loader) if one is not None]
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: is no YAML that can be read: {' '.join(str(error).split())[:200]}") from None


def records_in(content: Any) -> list[Any]:
    """Records of a document: its longest list of objects, however deep, else its lists as columns or rows."""
    found = max(_lists_of_objects(content), key=len, default=[])
    if len(found) > 1:
        return found
    if isinstance(content, Mapping):
        lists = {name: value for name, value in content.items() if isinstance(value, list)}
        most = max(map(len, lists.values()), default=0)
        named = {name: value for name, value in lists.items() if len(value) == most > 0}
        return [dict(zip(named, row, strict=True)) for row in zip(*named.values(), strict=True)]
    rows = content if isinstance(content, list) else []
    return rows if all(isinstance(row, list) for row in rows) else found


def _lists_of_objects(content: Any) -> Iterator[list[Any]]:
    """Lists of objects in a document, and objects by name as a list of them."""
    inside = list(content.values()) if isinstance(content, Mapping) else content if isinstance(content, list) else []
    if inside and all(isinstance(each, Mapping) for each in inside):
        keys = [list(each) for each in inside]
        if isinstance(content, list):
            yield content
        elif all(key == keys[0] for key in keys) and len(inside) > 1:
            if all(str(key).isdigit() for key in keys[0]):  # columns by name, their rows by number, as pandas writes
                yield [{name: column[key] for name, column in content.items()} for key in keys[0]]
            else:
                yield [{"name": name, **each} for name, each in content.items()]
    for each in inside:
        yield from _lists_of_objects(each)


def rows_of(path: Path, records: Sequence[Any]) -> Rows:
    """Rows of cells of records below their names, or of lists of numbers without names. Raises DatasetError."""
    if records and all(isinstance(each, list) for each in records):
        return [list(map(_cell, _flat(each))) for each in records[:_MOST_ROWS]]
    if not records or not all(isinstance(each, Mapping) for each in records):
        raise DatasetError(f"{path}: holds no list of records; one object a pose in a list is needed")
    flat = [flat_record(each) for each in records[:_MOST_ROWS]]
    names = list(dict.fromkeys(name for record in flat for name in record))
    if len(flat) * len(names) > MOST_CELLS:
        found = f"its {len(flat)} records have {len(names)} different keys"
        raise DatasetError(f"{path}: {found}; give all records the same keys")
    return [names, *[[record.get(name, "") for name in names] for record in flat]]


def _flat(values: Any) -> list[Any]:
    return [each for value in values for each in _flat(value)] if isinstance(values, list) else [values]


def flat_record(record: Mapping[str, Any], within: str = "") -> dict[str, str]:
    """Cells of a record by column: a list of joints as q1 ..., of a place as x, y, z, an object by its keys.

    within: the names of the objects that the record is in, which stand before its own.
    """
    out: dict[str, str] = {}
    named = next((list(map(str, record[key])) for key in _NAMES if isinstance(record.get(key), list)), [])
    has_joints = any(isinstance(value, list) and _JOINTS.fullmatch(_key(name)) for name, value in record.items())
    for name, value in record.items():
        base, unit = split_unit(str(name))
        key, behind = plain(base), f" [{unit}]" if unit else ""
        is_turn, is_place = key in _TURNS, key in _PLACES and (has_joints or not named)
        first = f"{within}{'q' if is_turn else ''}x{behind}"
        stem = within if (is_turn or key in _PLACES) and first not in out else f"{within}{base}_"
        if isinstance(value, Mapping):
            inner = {f"q{axis}" if is_turn and axis in _QUATERNION else axis: cell for axis, cell in value.items()}
            out |= {f"{column}{behind}": cell for column, cell in flat_record(inner, stem).items()}
        elif isinstance(value, list) and str(name) not in _NAMES:
            cells = list(map(_cell, _flat(value)))
            if len(named) == len(cells):  # joints in any order, as in ROS
                columns = [one if key in _PLACES or _JOINTS.fullmatch(key) else f"{base}_{one}" for one in named]
            elif len(cells) == 3 and (is_place or not _JOINTS.fullmatch(key)):
                columns = [f"{stem}{axis}" for axis in "xyz"]
            elif _JOINTS.fullmatch(key) or key in _PLACES:
                columns = [f"{within}q{k + 1}" for k in range(len(cells))]
            else:
                joints = "q" if key.endswith(_END_IN_JOINTS) else ""
                columns = [f"{stem}{joints}{k + 1}" for k in range(len(cells))]
            out |= {f"{column}{behind}": cell for column, cell in zip(columns, cells, strict=True)}
        elif value is not None and not isinstance(value, list):
            out[f"{within}{name}"] = _cell(value)
    return out


def _key(name: object) -> str:
    return plain(split_unit(str(name))[0])


def list_columns(names: Sequence[str], rows: Sequence[list[str]]) -> tuple[list[str], list[list[str]]]:
    """Columns whose cells are lists of numbers, such as [0.1, 0.2], as a column each, named as those of records."""
    lists: dict[int, list[list[str]]] = {}
    for k in range(len(names)):
        if rows and all(re.fullmatch(_POSITION, row[k]) for row in rows):
            entries = [dict(_ENTRY.findall(row[k])) for row in rows]
            keys = list(dict.fromkeys(key for each in entries for key in each))
            named = [f"{key} [{'mm' if key in 'XYZ' else 'deg'}]" for key in keys]
            more = [
                [*row[:k], *(each.get(key, "") for key in keys), *row[k + 1 :]]
                for row, each in zip(rows, entries, strict=True)
            ]
            return list_columns([*names[:k], *named, *names[k + 1 :]], more)
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


def declared_positions(text: str) -> list[tuple[int, list[str]]]:
    """Rows of the positions in a program or data list of KUKA, each with its line, below their names; [] of none.

    Of positions by joints and by places those are taken that are more.
    """
    lines = lines_of(text) if "{" in text else ()
    found = [(k, match) for k, line in enumerate(lines, 1) if (match := _DECLARED.match(line))]
    by_joints = [(k, match) for k, match in found if "A1" in match["position"]]
    kept = by_joints if 2 * len(by_joints) >= len(found) else [each for each in found if each not in by_joints]
    rows = [(k, [match["name"] or f"line {k}", match["position"]]) for k, match in kept]
    return [(0, ["name", "position"]), *rows] if len(rows) > 1 else []
