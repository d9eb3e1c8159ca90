"""Logs that are tables: CSV of controllers, RTDE and PlotJuggler, spreadsheets, JSON records, parquet.

Of a wide log only the columns of time, joints and points are read.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.dataset_import.column_words import WORDS, is_called
from calib.dataset_import.columns import Meaning, end_in_joint, recognise
from calib.dataset_import.place_columns import point_groups
from calib.extras.logs.log_times import Log, has_fast_rows, seconds_of, time_of
from calib.extras.logs.series import PARQUET, JointSeries, PointSeries, Recording, RecordingError, in_order
from calib.kinematics.robot import Robot
from calib.lazy_modules import pd
from calib.text_files.column_names import plain, split_unit
from calib.text_files.records import is_records
from calib.text_files.text_file import decoded
from calib.text_files.user_table import UserTable, load_table, parse_table

MOST_BYTES = 4_000_000_000
_MOST_NUMBERS = 200_000_000  # of a parquet file
_HEAD_BYTES = 1_000_000
_FEWEST_ROWS = 40
_STATE = "observation.state"  # of LeRobot


def is_always_log(path: Path) -> bool:
    """Whether a path is a form that only recordings have: parquet, a folder of LeRobot."""
    return path.suffix.lower() == PARQUET or (path / "meta" / "info.json").is_file()


def is_log(path: Path, mapping: Mapping[str, Meaning]) -> bool:
    """Whether a table is a log by time: its rows come faster than an arm's poses.

    One whose time is mapped to `ignore` is a table of poses. Raises DatasetError where it cannot be read.
    """
    head = _head(path)
    return len(head) >= _FEWEST_ROWS and has_fast_rows(_log_of(head), mapping)


def has_time(path: Path) -> bool:
    """Whether a table has a column of time. Raises DatasetError where it cannot be read."""
    return time_of(_log_of(_head(path)), {}) is not None


def _head(path: Path) -> UserTable:
    """Beginning of a table; the whole of spreadsheets and JSON. Raises DatasetError."""
    if is_records(path):
        return load_table(path, lambda _: None)
    with path.open("rb") as file:
        content = file.read(_HEAD_BYTES)
    text = decoded(content)
    if len(content) == _HEAD_BYTES and "\n" in text:
        text = text[: text.rindex("\n")]
    return parse_table(path, text, lambda _: None)


@dataclass(frozen=True)
class _Columns:
    """What the columns of a log hold, by their names."""

    joints: tuple[str, ...]  # of the robot, in order; () where it has not all
    points: Mapping[str, tuple[str, str, str]]  # x, y, z by what names the point
    label: str  # that names the point of each row; "" where there is none

    @classmethod
    def of(cls, log: Log, robot: Robot | None, mapping: Mapping[str, Meaning]) -> _Columns:
        """Columns of a log; faults of the joints' names are the caller's to tell."""
        columns = log.columns
        joints = () if robot is None else _joint_columns(columns, robot, mapping)
        return cls(
            joints,
            _triples(columns, mapping, joints),
            next((name for name in columns if plain(name) in WORDS["label"]), ""),
        )

    @property
    def names(self) -> set[str]:
        """Names of all of them."""
        of_points = (name for triple in self.points.values() for name in triple)
        return {*self.joints, *of_points, self.label}


def read_table_log(path: Path, robot: Robot, mapping: Mapping[str, Meaning]) -> Recording:
    """Joints and points of a log that is a table. Raises RecordingError where it has no column of time."""
    log = _loaded(path, robot, mapping)
    time = seconds_of(log, mapping)
    if time is None:
        raise RecordingError(
            f"{path}: no column of time; found {', '.join(log.columns[:30])}; name it time_s (or time_ms, stamp)"
        )
    faults = recognise(log.columns, robot, mapping).faults
    if faults:
        raise RecordingError(f"{path}: {'; '.join(faults)}")
    time_s, notes = time
    found = _Columns.of(log, robot, mapping)
    is_unknown = any(name.startswith(_STATE) for name in found.joints) and not any(m.unit for m in mapping.values())
    joints = (_joints(log, time_s, found),) if found.joints else ()
    return Recording(joints, _points(log, time_s, mapping, found), (), notes, is_unknown)


def describe(path: Path) -> tuple[bool, bool]:
    """Whether a log has joints and points by the names of its columns, without a robot. Raises DatasetError."""
    return _described(_loaded(path, None, {}))


def describe_table(table: UserTable) -> tuple[bool, bool]:
    """Whether a table has joints and points by the names of its columns, without a robot. Raises DatasetError."""
    return _described(_log_of(table))


def _described(log: Log) -> tuple[bool, bool]:
    meant = recognise(log.columns, None, {})
    named = [name for name in log.columns if name.startswith(_STATE) or name.lower().endswith("/position")]
    angles = [n for n in log.columns if split_unit(n)[1] in ("deg", "rad") and not is_called(n, "turn")]
    has_joints = "q1" in meant.columns or bool(meant.faults) or end_in_joint(log.columns)
    return has_joints or max(len(named), len(angles)) > 1, bool(_triples(log.columns, {}, ()))


# ---- files -----------------------------------------------------------------------------------------------------------


def _loaded(path: Path, robot: Robot | None, mapping: Mapping[str, Meaning]) -> Log:
    if path.is_dir() or path.suffix.lower() == PARQUET:
        return _parquet(path)
    return _log_of(load_table(path, lambda _: None)) if is_records(path) else _csv(path, robot, mapping)


def _log_of(table: UserTable) -> Log:
    """Log of a table, with joints named by the cells beside them (`name_1`, `field.name0`) as messages are exported.

    Raises RecordingError where such names change from row to row.
    """
    frame = pd.DataFrame(list(table.rows), columns=list(table.columns))
    named: dict[str, str] = {}
    for column in table.columns:
        before, found, number = column.rpartition("name")
        values = f"{before}position{number}"
        if found and values in frame:
            if frame[column].nunique() > 1:
                raise RecordingError(
                    f"{table.path}: column {column}: joints are named in another order from row to row; give the bag "
                    "itself"
                )
            named[values] = f"{frame[column].iloc[0]}/position"
    return Log(table.path, frame.rename(columns=named), table.rate_hz)


def _csv(path: Path, robot: Robot | None, mapping: Mapping[str, Meaning]) -> Log:
    """Columns of interest of a CSV; rows that cannot be read are left out, cells without a number are NaN."""
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise RecordingError(f"{path}: has {size / 1e9:.3g} GB, such a log at most {MOST_BYTES / 1e9:g} GB; cut it")
    head = _head(path)
    short = _log_of(head)
    time = time_of(short, mapping)
    wanted = {*(() if time is None else time[1]), *_Columns.of(short, robot, mapping).names}
    options: dict[str, Any] = {
        "sep": r"\s+" if head.separator == " " else head.separator, "header": None, "skiprows": head.lines[0] - 1,
        "skipinitialspace": True, "encoding_errors": "replace", "on_bad_lines": "skip", "decimal": head.style.decimal,
        "thousands": "." if head.style.has_dot_groups else None,
    }  # fmt: skip
    try:
        if pd.read_csv(path, **options, nrows=1).shape[1] < len(head.columns):
            return _log_of(load_table(path, lambda _: None, any_encoding=True))  # its cells hold lists
        places = [k for k, name in enumerate(short.columns) if name in wanted]
        frame = pd.read_csv(path, **options, usecols=places, low_memory=False)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, ValueError) as error:
        raise RecordingError(f"{path}: cannot be read as CSV ({' '.join(str(error).split())})") from None
    return Log(path, frame.set_axis([short.columns[k] for k in places], axis=1), head.rate_hz)


def _parquet(path: Path) -> Log:
    """Parquet of numbers and of vectors of numbers, and LeRobot's folder of them; videos and images are left out."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ModuleNotFoundError:
        raise RecordingError(
            f"{path}: parquet is read with pyarrow, which is not installed: pip install "
            "'robot-calibration-inspector[logs]', or export it as CSV"
        ) from None
    files = sorted((path / "data").rglob("*.parquet")) if path.is_dir() else [path]
    if not files:
        raise RecordingError(f"{path}: holds no data/*.parquet; give LeRobot's folder with its data")
    frames, is_number = [], (pa.types.is_floating, pa.types.is_integer, pa.types.is_timestamp)
    try:
        for file in files:
            table = pq.ParquetFile(file)
            if table.metadata.num_rows * table.metadata.num_columns > _MOST_NUMBERS:
                raise RecordingError(f"{file}: has {table.metadata.num_rows} rows; cut it")
            kinds = {each.name: getattr(each.type, "value_type", each.type) for each in table.schema_arrow}
            names = [name for name, kind in kinds.items() if any(test(kind) for test in is_number)]
            frames.append(table.read(columns=names).to_pandas())
    except (pa.ArrowException, OSError) as error:
        raise RecordingError(f"{path}: cannot be read as parquet ({' '.join(str(error).split())[:200]})") from None
    frame = pd.concat(frames, ignore_index=True)
    told, columns = _entry_names(path), dict[str, Any]()
    for name, values in frame.items():
        if values.dtype != object:
            columns[str(name)] = values
        elif len({np.shape(row) for row in values}) == 1:
            rows = np.stack(list(values))
            entries = told.get(str(name)) or _usual_names(str(name), rows.shape[1])
            columns |= {f"{name}_{entry}": column for entry, column in zip(entries, rows.T, strict=True)}
    if not columns:
        raise RecordingError(f"{path}: holds no columns of numbers")
    order = [name for name in ("episode_index", "frame_index") if name in columns]
    frame = pd.DataFrame(columns)
    return Log(path, frame.sort_values(order, kind="stable", ignore_index=True) if order else frame)


def _usual_names(name: str, width: int) -> list[str]:
    """Names of the entries of a vector: of joints q1 ..., of a place x, y, z."""
    is_joints = plain(name).endswith(("state", "joints", "positions", "position", "q", "qpos", "angles"))
    return list("xyz") if width == 3 and not is_joints else [f"{'q' * is_joints}{k + 1}" for k in range(width)]


def _entry_names(path: Path) -> dict[str, list[Any]]:
    """Names of the entries of each vector by the meta/info.json of LeRobot's folder; {} where it tells none."""
    try:
        features = json.loads((path / "meta" / "info.json").read_text(encoding="utf-8"))["features"]
        told = {key: (feature.get("names"), feature.get("shape")) for key, feature in features.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}
    lists = {key: (next(iter(of.values()), ()) if isinstance(of, dict) else of, n) for key, (of, n) in told.items()}
    return {key: names for key, (names, shape) in lists.items() if isinstance(names, list) and [len(names)] == shape}


# ---- columns ---------------------------------------------------------------------------------------------------------


def _joint_columns(columns: Sequence[str], robot: Robot, mapping: Mapping[str, Meaning]) -> tuple[str, ...]:
    meant = recognise(columns, robot, mapping).columns
    wanted = [f"q{k + 1}" for k in range(robot.n_joints)]
    return tuple(meant[name].name for name in wanted) if set(wanted) <= set(meant) else ()


def _triples(
    columns: Sequence[str], mapping: Mapping[str, Meaning], joints: Sequence[str]
) -> dict[str, tuple[str, str, str]]:
    told = {meant.name: column for column, meant in mapping.items() if meant.name in ("x", "y", "z")}
    if len(told) == 3 and set(told.values()) <= set(columns):
        return {"": (told["x"], told["y"], told["z"])}
    return point_groups([name for name in columns if name not in joints])


def _joints(log: Log, time_s: Array, found: _Columns) -> JointSeries:
    names = found.joints
    rows = np.column_stack([log.numbers(name) for name in names])
    known = np.isfinite(rows).all(axis=1)
    kept_s, kept = in_order(time_s[known], rows[known])
    return JointSeries(str(log.path), kept_s, names, kept)


def _points(log: Log, time_s: Array, mapping: Mapping[str, Meaning], found: _Columns) -> tuple[PointSeries, ...]:
    named = log.frame[found.label].astype(str).to_numpy() if found.label else np.full(len(time_s), "")
    out = []
    for key, triple in found.points.items():
        xyz = np.column_stack([log.numbers(name) for name in triple])
        known = np.isfinite(xyz).all(axis=1)
        units = {mapping[n].unit if n in mapping else split_unit(n)[1] for n in triple}
        unit = units.pop() if len(units) == 1 else ""
        for label in dict.fromkeys(named[known]):
            rows = known & (named == label)
            kept_s, kept = in_order(time_s[rows], xyz[rows])
            out.append(PointSeries(key, str(label), kept_s, kept, unit))
    return tuple(out)
