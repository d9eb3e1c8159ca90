"""Logs that are tables: CSV of controllers, RTDE and PlotJuggler, spreadsheets, JSON records and lines, parquet.

Of a wide log only the columns of time, joints, points and conditions are read.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.consistency.own_pose import own_pose_columns
from calib.dataset_import.columns import Meaning, end_in_joint, point_groups, recognise, words_of
from calib.extras.logs.log_times import Log, has_fast_rows, seconds_of, time_of
from calib.extras.logs.series import (
    JSON_LINES,
    PARQUET,
    JointSeries,
    PointSeries,
    Recording,
    RecordingError,
    in_order,
)
from calib.kinematics.robot import Robot
from calib.lazy_modules import pd
from calib.text_files.column_names import plain, split_unit
from calib.text_files.csv_text import as_number
from calib.text_files.records import flat_record, is_records
from calib.text_files.text_file import decoded
from calib.text_files.user_table import UserTable, load_table, parse_table

MOST_BYTES = 4_000_000_000
_MOST_NUMBERS = 200_000_000  # of a parquet file
_HEAD_BYTES = 1_000_000
_FEWEST_ROWS = 40
_NOT_PLACES = {"angular", "linear", "twist", "accelerometer", "gravity", "scale", "covariance"}
_TURNS = {"rx", "ry", "rz", "roll", "pitch", "yaw", "rotation", "tilt", "a", "b", "c"}
_LABELS = ("target", "marker", "markerid", "tagid", "childframeid", "pointname")
_CONDITIONS = {"effort": ("effort", "torque"), "temperature": ("temperatures", "temperature", "temp")}
_NOT_MEASURED = {"target", "desired", "command", "tcp", "control"}
_STATE = "observation.state"  # of LeRobot
_RADIANS = re.compile(r"(?:^|_)actual_q_\d$|[/.]position$|[/.]position(?:[.\[]\d+\]?)$|^field\.position\d+$")
_NAME = re.compile(r"(?P<prefix>.*?)name[._\[]?(?P<k>\d+)\]?")
_VALUE = re.compile(r"(?P<prefix>.*?)(?P<what>position|effort|velocity|q)[._\[]?(?P<k>\d+)\]?")


def is_always_log(path: Path) -> bool:
    """Whether a path is a form that only recordings have: parquet, JSON lines, a folder of LeRobot."""
    return path.suffix.lower() in (PARQUET, *JSON_LINES) or (path / "meta" / "info.json").is_file()


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
    conditions: Mapping[str, str]  # of joints, by their name in a series
    points: Mapping[str, tuple[str, str, str]]  # x, y, z by what names the point; the controller's own tool is the last
    label: str  # that names the point of each row; "" where there is none

    @classmethod
    def of(cls, log: Log, robot: Robot | None, mapping: Mapping[str, Meaning]) -> _Columns:
        """Columns of a log; faults of the joints' names are the caller's to tell."""
        columns = log.columns
        joints = () if robot is None else _joint_columns(columns, robot, mapping)
        return cls(
            joints,
            _condition_columns(columns, joints, robot) if robot is not None and joints else {},
            _triples(columns, mapping, joints),
            next((name for name in columns if plain(name) in _LABELS), ""),
        )

    @property
    def names(self) -> set[str]:
        """Names of all of them."""
        of_points = (name for triple in self.points.values() for name in triple)
        return {*self.joints, *self.conditions.values(), *of_points, self.label}


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
    time_s, of_time, notes = time
    found = _Columns.of(log, robot, mapping)
    used = {*of_time, *found.names} - {*found.conditions.values(), found.label}
    return Recording(
        (_joints(log, time_s, found),) if found.joints else (), _points(log, time_s, mapping, found),
        tuple(name for name in log.columns if name not in used), notes,
        any(name.startswith(_STATE) for name in found.joints) and not any(m.unit for m in mapping.values()),
    )  # fmt: skip


def describe(path: Path) -> tuple[bool, bool]:
    """Whether a log has joints and points by the names of its columns, without a robot. Raises DatasetError."""
    return _described(_loaded(path, None, {}))


def describe_table(table: UserTable) -> tuple[bool, bool]:
    """Whether a table has joints and points by the names of its columns, without a robot. Raises DatasetError."""
    return _described(_log_of(table))


def _described(log: Log) -> tuple[bool, bool]:
    meant = recognise(log.columns, None, {})
    named = [name for name in log.columns if name.startswith(_STATE) or name.lower().endswith("/position")]
    angles = [n for n in log.columns if split_unit(n)[1] in ("deg", "rad") and not words_of(n) & _TURNS]
    has_joints = "q1" in meant.columns or bool(meant.faults) or end_in_joint(log.columns)
    return has_joints or max(len(named), len(angles)) > 1, bool(_triples(log.columns, {}, ()))


# ---- files -----------------------------------------------------------------------------------------------------------


def _loaded(path: Path, robot: Robot | None, mapping: Mapping[str, Meaning]) -> Log:
    if path.is_dir() or path.suffix.lower() == PARQUET:
        return _parquet(path)
    if path.suffix.lower() in JSON_LINES:
        return _json_lines(path)
    return _log_of(load_table(path, lambda _: None)) if is_records(path) else _csv(path, robot, mapping)


def _log_of(table: UserTable) -> Log:
    """Log of a table; one without names as `ros2 topic echo --csv` writes messages."""
    names = table.columns if table.has_header else _echoed(table.rows[0])
    return _named_by_cells(Log(table.path, pd.DataFrame(list(table.rows), columns=list(names)), table.rate_hz))


def _echoed(row: Sequence[str]) -> list[str]:
    """Names of the cells of a message that `ros2 topic echo --csv` wrote: stamp, frame, joints or a place."""
    cells = [f"column {k + 1}" for k in range(len(row))]
    if len(row) < 6 or not (row[0].isdigit() and row[1].isdigit() and as_number(row[2]) is None):
        return cells
    cells[:3] = ["sec", "nanosec", "frame_id"]
    words = next((k for k in range(3, len(row)) if as_number(row[k]) is not None), len(row)) - 3
    rest = len(row) - 3 - words
    if words > 1 and rest % words == 0:
        lists = ("name", "position", "velocity", "effort")[: 1 + rest // words]
        cells[3:] = [f"{each}{k}" for each in lists for k in range(words)]
    elif words <= 1 and rest in (3, 7):
        cells[3 + words :] = ["x", "y", "z", "qx", "qy", "qz", "qw"][:rest]
    return cells


def _csv(path: Path, robot: Robot | None, mapping: Mapping[str, Meaning]) -> Log:
    """Columns of interest of a CSV; rows that cannot be read are left out, cells without a number are NaN."""
    _refuse_large(path, MOST_BYTES)
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


def _refuse_large(path: Path, most: float) -> None:
    size = path.stat().st_size
    if size > most:
        raise RecordingError(f"{path}: has {size / 1e9:.3g} GB, such a log at most {most / 1e9:g} GB; cut it")


def _json_lines(path: Path) -> Log:
    """JSON lines: one record a line; lists of joints become q1 ..., of a point x, y, z."""
    _refuse_large(path, MOST_BYTES / 10)
    records = []
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            try:
                record = json.loads(line) if line.strip() else {}
            except (json.JSONDecodeError, RecursionError):
                record = None
            if not isinstance(record, dict):
                raise RecordingError(f"{path}: line {number}: holds no JSON object; one object a line is needed")
            records += [flat_record(record)] if record else []
    if not records:
        raise RecordingError(f"{path}: holds no record; one object a line is needed")
    return _named_by_cells(Log(path, pd.DataFrame(records)))


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
    entries = _entries(path)
    columns: dict[str, Any] = {}
    for name, values in frame.items():
        if values.dtype != object:
            columns[str(name)] = values
        elif len({np.shape(row) for row in values}) == 1:
            rows = np.stack(list(values))
            columns |= dict(zip(_names_of(str(name), rows.shape[1], entries), rows.T, strict=True))
    if not columns:
        raise RecordingError(f"{path}: holds no columns of numbers")
    order = [name for name in ("episode_index", "frame_index") if name in columns]
    frame = pd.DataFrame(columns)
    return Log(path, frame.sort_values(order, kind="stable", ignore_index=True) if order else frame)


def _names_of(name: str, width: int, entries: Mapping[str, Any]) -> list[str]:
    """Names of the entries of a vector: as told, of joints q1 ..., of a place x, y, z."""
    told = entries.get(name, ())
    if len(told) != width:
        is_joints = plain(name).endswith(("state", "joints", "positions", "position", "q", "qpos", "angles"))
        told = list("xyz") if width == 3 and not is_joints else [f"{'q' * is_joints}{k + 1}" for k in range(width)]
    return [f"{name}_{each}" for each in told]


def _entries(path: Path) -> dict[str, list[Any]]:
    """Names of the entries of each vector by LeRobot's meta/info.json; {} where there is none."""
    for folder in (path, *list(path.parents)[:3]):
        try:
            features = json.loads((folder / "meta" / "info.json").read_text(encoding="utf-8"))["features"]
            named = {key: feature.get("names") for key, feature in features.items()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            continue
        lists = {k: next(iter(v.values()), None) if isinstance(v, dict) else v for k, v in named.items()}
        return {key: value for key, value in lists.items() if isinstance(value, list)}
    return {}


def _named_by_cells(log: Log) -> Log:
    """Log with joints named by cells beside them (`name_1`, `field.name0`), as messages of joint states are exported.

    Raises RecordingError where the names change from row to row.
    """
    named: dict[tuple[str, str], str] = {}
    for column in log.columns:
        if match := _NAME.fullmatch(column):
            names = log.frame[column].dropna().unique().tolist()
            if len(names) > 1:
                raise RecordingError(
                    f"{log.path}: column {column}: joints are named in another order from row to row; give the bag "
                    "itself"
                )
            if names:
                named[match["prefix"], match["k"]] = str(names[0])
    renamed: dict[str, str] = {}
    for column in log.columns if named else ():
        match = _VALUE.fullmatch(column)
        if match and (match["prefix"], match["k"]) in named:
            renamed[column] = f"{named[match['prefix'], match['k']]}/{match['what'].replace('q', 'position')}"
    return Log(log.path, log.frame.rename(columns=renamed), log.rate_hz)


# ---- columns ---------------------------------------------------------------------------------------------------------


def _joint_columns(columns: Sequence[str], robot: Robot, mapping: Mapping[str, Meaning]) -> tuple[str, ...]:
    meant = recognise(columns, robot, mapping).columns
    wanted = [f"q{k + 1}" for k in range(robot.n_joints)]
    return tuple(meant[name].name for name in wanted) if set(wanted) <= set(meant) else ()


def _condition_columns(columns: Sequence[str], joints: Sequence[str], robot: Robot) -> dict[str, str]:
    """Columns of torque and temperature of each joint, by their name in a series, such as "effort q1"."""
    out: dict[str, str] = {}
    for key, words in _CONDITIONS.items():
        of_kind = [name for name in columns if words_of(name) & {*words} and not words_of(name) & _NOT_MEASURED]
        as_positions = {re.sub("|".join(words), "position", name): name for name in of_kind}
        found = _joint_columns(list(as_positions), robot, {})
        out |= {f"{key} {joint}": as_positions[name] for joint, name in zip(joints, found, strict=False)}
    return out


def _triples(
    columns: Sequence[str], mapping: Mapping[str, Meaning], joints: Sequence[str]
) -> dict[str, tuple[str, str, str]]:
    told = {meant.name: column for column, meant in mapping.items() if meant.name in ("x", "y", "z")}
    if len(told) == 3 and set(told.values()) <= set(columns):
        return {"": (told["x"], told["y"], told["z"])}
    others = [name for name in columns if name not in joints]
    found = {key: names for key, names in point_groups(others).items() if not words_of(key) & _NOT_PLACES}
    own = own_pose_columns([name for name in others if name[-1:].isdigit()])
    return found | ({} if own is None else {f"tcp {own[0]}": own})


def _joints(log: Log, time_s: Array, found: _Columns) -> JointSeries:
    names = found.joints
    rows = np.column_stack([log.numbers(name) for name in (*names, *found.conditions.values())])
    known = np.isfinite(rows[:, : len(names)]).all(axis=1)
    kept_s, kept = in_order(time_s[known], rows[known])
    unit = "rad" if all(_RADIANS.search(name) and not split_unit(name)[1] for name in names) else ""
    further = dict(zip(found.conditions, kept[:, len(names) :].T, strict=True))
    return JointSeries(str(log.path), kept_s, names, kept[:, : len(names)], unit, further)


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
