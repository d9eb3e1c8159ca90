"""Logs that are tables: CSV of controllers, RTDE and PlotJuggler, spreadsheets, JSON records and lines, parquet.

Of a wide log only the columns of time, joints, points and conditions are read.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.consistency.own_pose import own_pose_columns
from calib.dataset_import.columns import Meaning, is_position, marker_columns, recognise, words_of
from calib.errors import DatasetError
from calib.extras.logs.bags import is_own_pose
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
from calib.text_files.csv_text import as_number
from calib.text_files.layout import PLAIN_NUMBERS
from calib.text_files.records import flat_record, is_records
from calib.text_files.text_file import decoded
from calib.text_files.user_table import UserTable, load_table, parse_table, plain, split_unit

MOST_BYTES = 4_000_000_000
_MOST_NUMBERS = 200_000_000  # that are kept of a log
_HEAD_BYTES = 1_000_000
_SLOWEST_S = 0.5  # between two rows of a log; a pose a row takes longer, as the arm has to get there
_FEWEST_ROWS = 40
_TIMES = ("time", "timestamp", "t", "stamp", "times", "zeit", "zeitstempel", "rosbagtimestamp", "headerstamp",
          "robottime", "elapsedtime", "logtime", "clock", "fieldheaderstamp", "uptime", "temps", "tiempo",
          "tempo", "duration", "ipoc", "时间", "时间戳")  # fmt: skip
_TIME_UNIT = re.compile(
    r"^(?P<name>.*?)(?:[\s_.]*[\[(]\s*|[\s_.]+)(?P<unit>ns|us|µs|ms|s|sec|seconds|nanosec|min)\s*[\])]?$"
)
_SCALES = {"ns": 1e-9, "nanosec": 1e-9, "us": 1e-6, "µs": 1e-6, "ms": 1e-3, "s": 1.0, "sec": 1.0, "seconds": 1.0,
           "min": 60.0}  # fmt: skip
_EPOCHS = ((1e8, 1e10, 1.0), (1e11, 1e13, 1e-3), (1e14, 1e16, 1e-6), (1e17, 1e19, 1e-9))  # since 1970, by its size
_COUNTED = 2000  # whole units of a clock that steps evenly, from which they are milliseconds
_SECONDS, _NANOSECONDS = ("sec", "secs"), ("nanosec", "nsec", "nsecs")
_NOT_PLACES = {"orientation", "quat", "quaternion", "rotation", "rpy", "euler", "velocity", "vel", "speed", "twist",
               "angular", "linear", "force", "wrench", "torque", "acceleration", "acc", "accelerometer", "gyro", "imu",
               "normal", "gravity", "scale", "covariance", "error"}  # fmt: skip
_TURNS = {"rx", "ry", "rz", "roll", "pitch", "yaw", "rotation", "tilt", "a", "b", "c"}
_LABELS = ("target", "marker", "markerid", "tagid", "childframeid", "pointname")
_STATE = "observation.state"
_RADIANS = re.compile(r"(?:^|_)actual_q_\d$|[/.]position$|[/.]position(?:[.\[]\d+\]?)$|^field\.position\d+$")


@dataclass(frozen=True)
class _Log:
    """A table by its columns, each read when it is wanted."""

    path: Path
    columns: tuple[str, ...]
    frame: Any  # pandas.DataFrame of what has been read
    rate_hz: float = 0.0  # of the rows, where the file tells it

    def numbers(self, name: str) -> Array:
        """Numbers (N,) of a column; NaN where a cell holds none."""
        column = self.frame[name]
        if column.dtype == object or str(column.dtype).startswith(("str", "string")):
            column = pd.to_numeric(column, errors="coerce")
        return np.asarray(column, dtype=float)


def is_always_log(path: Path) -> bool:
    """Whether a path is a form that only recordings have: parquet, JSON lines, a folder of LeRobot."""
    return path.suffix.lower() in (PARQUET, *JSON_LINES) or is_lerobot(path)


def is_lerobot(path: Path) -> bool:
    """Whether a folder is a data set of LeRobot."""
    return (path / "meta" / "info.json").is_file()


def is_log(path: Path, head: UserTable, mapping: Mapping[str, Meaning]) -> bool:
    """Whether a table, of which the beginning is given, is a log by time: its rows come faster than an arm's poses.

    One whose time is mapped to `ignore` is a table of poses.
    """
    if len(head) < _FEWEST_ROWS:
        return False
    try:
        time = _time(_log_of(head), mapping)
    except RecordingError:
        return False
    if time is None or any(name in mapping and mapping[name].name == "ignore" for name in time[1]):
        return False
    return len(time[0]) > 1 and _step_s(time[0]) <= _SLOWEST_S


def has_time(path: Path) -> bool:
    """Whether a table has a column of time. Raises DatasetError where it cannot be read."""
    return _time(_log_of(head_of(path)), {}) is not None


def head_of(path: Path) -> UserTable:
    """Beginning of a table; the whole of spreadsheets and JSON. Raises DatasetError."""
    if is_records(path):
        return load_table(path, lambda _: None)
    with path.open("rb") as file:
        content = file.read(_HEAD_BYTES)
    text = decoded(content)
    if len(content) == _HEAD_BYTES and "\n" in text:
        text = text[: text.rindex("\n")]
    return parse_table(path, text, lambda _: None)


def read_table_log(path: Path, robot: Robot, mapping: Mapping[str, Meaning]) -> Recording:
    """Joints and points of a log that is a table. Raises RecordingError where it has no column of time."""
    log, notes = _loaded(path, robot, mapping)
    time = _time(log, mapping)
    if time is None:
        raise RecordingError(
            f"{path}: no column of time; found {', '.join(log.columns[:30])}; name it time_s (or time_ms, stamp)"
        )
    time_s, named = time
    time_s, resets = _continued(time_s)
    if resets:
        notes.append(f"{path}: its time begins anew {resets} times; the parts are read one behind the other")
    others = tuple(name for name in log.columns if name not in named)
    joints = _joints(log, time_s, robot, mapping)
    of_joints = set() if joints is None else set(joints.names)
    points = _points(log, time_s, mapping, of_joints)
    used = {*named, *of_joints, *(name for triple in _triples(log, mapping, of_joints).values() for name in triple)}
    is_normalised = joints is not None and any(name.startswith(_STATE) for name in joints.names)
    return Recording(
        () if joints is None else (joints,), points, tuple(n for n in others if n not in used), tuple(notes),
        unit_is_unknown=is_normalised and not any(mapping.get(n) and mapping[n].unit for n in mapping),
    )  # fmt: skip


# ---- files -----------------------------------------------------------------------------------------------------------


def _loaded(path: Path, robot: Robot, mapping: Mapping[str, Meaning]) -> tuple[_Log, list[str]]:
    if is_lerobot(path) or path.suffix.lower() == PARQUET:
        return _parquet(path)
    if path.suffix.lower() in JSON_LINES:
        return _json_lines(path), []
    if is_records(path):
        return _log_of(load_table(path, lambda _: None)), []
    return _csv(path, robot, mapping)


def _log_of(table: UserTable) -> _Log:
    """Log of a table; one without names as `ros2 topic echo --csv` writes messages."""
    names = table.columns if table.has_header else _echoed(table.rows[0])
    frame = pd.DataFrame(list(table.rows), columns=list(names))
    return _named_by_cells(_Log(table.path, tuple(names), frame, table.rate_hz))


def _echoed(row: Sequence[str]) -> list[str]:
    """Names of the cells of a message that `ros2 topic echo --csv` wrote: stamp, frame, joints or a place."""
    names = [f"column {k + 1}" for k in range(len(row))]
    if len(row) < 6 or not (row[0].isdigit() and row[1].isdigit() and as_number(row[2]) is None):
        return names
    names[:3] = ["sec", "nanosec", "frame_id"]
    words = next((k for k in range(3, len(row)) if as_number(row[k]) is not None), len(row)) - 3
    rest = len(row) - 3 - words
    if words > 1 and rest % words == 0:
        lists = ("position", "velocity", "effort")[: rest // words]
        names[3:] = [f"name{k}" for k in range(words)] + [f"{each}{k}" for each in lists for k in range(words)]
    elif words <= 1 and rest in (3, 7):
        names[3 + words :] = ["x", "y", "z", "qx", "qy", "qz", "qw"][:rest]
    return names


def _csv(path: Path, robot: Robot, mapping: Mapping[str, Meaning]) -> tuple[_Log, list[str]]:
    """Columns of interest of a CSV, read in parts; rows that cannot be read are NaN."""
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise RecordingError(f"{path}: has {size / 1e9:.3g} GB; a log has at most {MOST_BYTES / 1e9:g} GB, cut it")
    head = head_of(path)
    short = _log_of(head)
    wanted = set(_columns_of_interest(short, robot, mapping))
    k_wanted = [k for k, name in enumerate(short.columns) if name in wanted]
    separator = r"\s+" if head.separator == " " else head.separator
    options: dict[str, Any] = {
        "sep": separator, "header": None, "skiprows": head.lines[0] - 1, "usecols": k_wanted, "dtype": str,
        "skipinitialspace": True, "on_bad_lines": "skip", "encoding_errors": "replace", "chunksize": 200_000,
        "engine": "python" if separator == r"\s+" else "c",
    }  # fmt: skip
    parts, count = [], 0
    try:
        first = pd.read_csv(path, **{**options, "usecols": None, "chunksize": None, "nrows": 1})
        if first.shape[1] < len(head.columns):
            return _log_of(load_table(path, lambda _: None, any_encoding=True)), []  # its cells hold lists
        for part in pd.read_csv(path, **options):
            made = part if head.style == PLAIN_NUMBERS else part.map(head.style.plain, na_action="ignore")
            if head.style.decimal == ",":  # of times of day, too
                made = made.apply(lambda column: column.str.replace(",", ".", regex=False))
            made.columns = [short.columns[k] for k in sorted(k_wanted)]
            numbers = made.apply(pd.to_numeric, errors="coerce")
            is_text = [name for name in made.columns if numbers[name].isna().all() and made[name].notna().any()]
            parts.append(numbers.assign(**{name: made[name] for name in is_text}))
            count += made.size
            if count > _MOST_NUMBERS:
                raise RecordingError(
                    f"{path}: has more than {_MOST_NUMBERS / 1e6:g} million numbers of interest; cut it"
                )
    except (pd.errors.ParserError, pd.errors.EmptyDataError, ValueError) as error:
        raise RecordingError(f"{path}: cannot be read as CSV ({' '.join(str(error).split())})") from None
    frame = pd.concat(parts, ignore_index=True)
    return _Log(path, tuple(frame.columns), frame, head.rate_hz), []


def _json_lines(path: Path) -> _Log:
    """JSON lines: one record a line; lists of joints become q1 ..., of a point x, y, z."""
    if path.stat().st_size > MOST_BYTES // 10:
        raise RecordingError(f"{path}: has {path.stat().st_size / 1e9:.3g} GB; export it as CSV or parquet")
    records = []
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            if not line.strip():
                continue
            try:
                record = json.loads(line)
            except (json.JSONDecodeError, RecursionError):
                raise RecordingError(
                    f"{path}: line {number}: cannot be read as JSON; one object a line is needed"
                ) from None
            if not isinstance(record, dict):
                raise RecordingError(f"{path}: line {number}: found no object; one object a line is needed")
            records.append(flat_record(record))
    if not records:
        raise RecordingError(f"{path}: holds no record; one object a line is needed")
    frame = pd.DataFrame(records)
    return _named_by_cells(_Log(path, tuple(map(str, frame.columns)), frame))


def _parquet(path: Path) -> tuple[_Log, list[str]]:
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
    info = _lerobot_info(path)
    columns: dict[str, list[Any]] = {}
    try:
        for file in files:
            table = pq.ParquetFile(file)
            names = [f.name for f in table.schema_arrow if _is_numeric(pa, f.type)]
            read = table.read(columns=names)
            if read.num_rows * max(1, read.num_columns) > _MOST_NUMBERS:
                raise RecordingError(f"{file}: has {read.num_rows} rows; cut it")
            for name in names:
                columns.setdefault(name, []).append(read.column(name))
    except (pa.ArrowException, OSError) as error:
        raise RecordingError(f"{path}: cannot be read as parquet ({' '.join(str(error).split())[:200]})") from None
    made: dict[str, Any] = {}
    for name, chunks in columns.items():
        kind = chunks[0].type
        if pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_large_list(kind):
            rows = [row for chunk in chunks for row in chunk.to_pylist()]
            widths = {len(row) for row in rows if row is not None}
            if len(widths) != 1:
                continue
            width = widths.pop()
            array = np.array([[np.nan] * width if row is None else row for row in rows], dtype=float)
            named = info.get(name, ())
            for k in range(width):
                is_joints = plain(name).endswith(("state", "joints", "positions", "position", "q", "qpos", "angles"))
                axis = f"q{k + 1}" if is_joints else "xyz"[k] if width == 3 else str(k + 1)
                label = str(named[k]) if len(named) == width else axis
                made[f"{name}_{label}"] = array[:, k]
        else:
            values = pd.concat([chunk.to_pandas() for chunk in chunks], ignore_index=True)
            if str(values.dtype).startswith("datetime"):
                values = values.astype("int64") * _SCALES[_unit_of_datetime(values)]
            made[name] = values
    if not made:
        raise RecordingError(f"{path}: holds no columns of numbers")
    frame = pd.DataFrame(made)
    episodes: list[str] = []
    if "episode_index" in frame:
        frame = frame.sort_values(
            ["episode_index", "frame_index"] if "frame_index" in frame else ["episode_index"], kind="stable"
        )
        episodes.append(f"{path}: {frame['episode_index'].nunique()} episodes")
    return _Log(path, tuple(frame.columns), frame.reset_index(drop=True)), episodes


def _unit_of_datetime(values: Any) -> str:
    found = re.search(r"\[(ns|us|ms|s)", str(values.dtype))
    return found[1] if found else "ns"


def _is_numeric(pa: Any, kind: Any) -> bool:
    types = pa.types
    if types.is_list(kind) or types.is_fixed_size_list(kind) or types.is_large_list(kind):
        return bool(types.is_floating(kind.value_type) or types.is_integer(kind.value_type))
    return bool(types.is_floating(kind) or types.is_integer(kind) or types.is_timestamp(kind))


def _lerobot_info(path: Path) -> dict[str, Sequence[str]]:
    """Names of the entries of each vector by LeRobot's meta/info.json; {} where there is none."""
    folders = [path] if path.is_dir() else list(path.parents)[:3]
    for folder in folders:
        if is_lerobot(folder):
            try:
                features = json.loads((folder / "meta" / "info.json").read_text(encoding="utf-8"))["features"]
                named = {key: feature.get("names") for key, feature in features.items()}
            except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
                return {}
            lists = {k: next(iter(v.values()), None) if isinstance(v, dict) else v for k, v in named.items()}
            return {key: [str(each) for each in value] for key, value in lists.items() if isinstance(value, list)}
    return {}


def _named_by_cells(log: _Log) -> _Log:
    """Log with joints named by cells beside them (`name_1`, `field.name0`), as messages of joint states are exported.

    Raises RecordingError where the names change from row to row.
    """
    found: dict[str, dict[int, str]] = {}
    for column in log.columns:
        match = re.fullmatch(r"(?P<prefix>.*?)name[._\[]?(?P<k>\d+)\]?", column)
        if match:
            found.setdefault(match["prefix"], {})[int(match["k"])] = column
    renamed: dict[str, str] = {}
    for prefix, columns in found.items():
        for k, column in columns.items():  # k: of the joint
            names = log.frame[column].dropna().unique()
            if len(names) > 1:
                raise RecordingError(
                    f"{log.path}: column {column}: joints are named in another order from row to row; give the bag "
                    f"itself"
                )
            for what in ("position", "effort", "velocity"):
                for shape in (
                    f"{prefix}{what}{k}",
                    f"{prefix}{what}_{k}",
                    f"{prefix}{what}[{k}]",
                    f"{prefix}{what}.{k}",
                ):
                    if shape in log.columns and len(names):
                        renamed[shape] = f"{names[0]}/{what}"
            if f"{prefix}q{k}" in log.columns and len(names):  # records name a list of positions so
                renamed[f"{prefix}q{k}"] = f"{names[0]}/position"
    if not renamed:
        return log
    under = tuple(renamed.get(name, name) for name in log.columns)
    return _Log(log.path, under, log.frame.set_axis(list(under), axis=1))


# ---- time ------------------------------------------------------------------------------------------------------------


def _time(log: _Log, mapping: Mapping[str, Meaning]) -> tuple[Array, tuple[str, ...]] | None:
    """Times (N,), s, with the columns that hold them; None where there are none. Raises RecordingError."""
    told = next((name for name in log.columns if name in mapping and mapping[name].name == "time_s"), None)
    if told is not None:
        return _in_seconds(log, told, mapping[told].unit or _time_unit(told)[1]), (told,)
    ends = {name: re.split(r"[^A-Za-z0-9]+", name.strip("%_ ")) for name in log.columns}
    for name, parts in ends.items():
        if parts[-1].lower() in _SECONDS:
            stem = name[: len(name) - len(parts[-1])]
            nano = next((f"{stem}{end}" for end in _NANOSECONDS if f"{stem}{end}" in log.columns), None)
            if nano is not None:
                return log.numbers(name) + 1e-9 * log.numbers(nano), (name, nano)
    ranked = []
    for k, name in enumerate(log.columns):
        base, unit = _time_unit(name)
        word = plain(base)
        if word in _TIMES:
            ranked.append((_TIMES.index(word), k, name, "ms" if word == "ipoc" else unit))
        elif word.endswith(("headerstamp", "timestamp")):
            ranked.append((len(_TIMES), k, name, unit))
        elif words_of(name) & {"time", "timestamp", "stamp", "zeit"} and _goes_on(log.numbers(name)):
            ranked.append((len(_TIMES) + 1, k, name, unit))
    if not ranked:
        frame = next((name for name in log.columns if plain(name) == "frame"), None)
        if not log.rate_hz:
            return None
        frames = np.arange(len(log.frame), dtype=float) if frame is None else log.numbers(frame)
        return frames / log.rate_hz, () if frame is None else (frame,)
    _, _, name, unit = min(ranked)
    return _in_seconds(log, name, unit), (name,)


def _in_seconds(log: _Log, name: str, unit: str) -> Array:
    """Times (N,), s, of a column of numbers or dates, its unit by their size where none is given."""
    values = log.numbers(name)
    if not np.isfinite(values).any():
        dates = _dates(log.frame[name])
        if dates.isna().all():
            raise RecordingError(
                f"{log.path}: column {name}: found {str(log.frame[name].iloc[0])[:40]!r}; a time is needed"
            )
        values = np.where(dates.isna(), np.nan, (dates - dates.min()).dt.total_seconds())
        return np.asarray(values, dtype=float) + dates.min().timestamp()
    if unit:
        return values * _SCALES[unit]
    largest = float(np.nanmax(np.abs(values)))
    if largest < _EPOCHS[0][0] and _counts_milliseconds(values):
        return values * 1e-3
    return values * next((scale for low, high, scale in _EPOCHS if low < largest < high), 1.0)


def _dates(cells: Any) -> Any:
    """Dates of texts: of one form, which is quick, else each by itself; 05.03.2024 has its day first."""
    day_first = bool(re.match(r"\s*\d{1,2}\.\d{1,2}\.\d{4}", str(cells.iloc[0])))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return pd.to_datetime(cells, utc=True, dayfirst=day_first)
        except (ValueError, UserWarning):
            pass
    return pd.to_datetime(cells, errors="coerce", utc=True, format="mixed", dayfirst=day_first)


def _goes_on(values: Array) -> bool:
    """Whether numbers never fall, and rise at times, as a clock's do."""
    steps = np.diff(values)
    return bool(len(steps) and (steps >= 0.0).all() and steps.any())


def _counts_milliseconds(values: Array) -> bool:
    """Whether a clock without a unit counts milliseconds: it goes on evenly in whole numbers for long."""
    known = values[np.isfinite(values)]
    steps = np.diff(known)
    return bool(
        len(known) > 1
        and known[-1] - known[0] >= _COUNTED
        and (known == np.round(known)).all()
        and np.mean(steps == np.median(steps)) > 0.9
        and np.median(steps) >= 1.0
    )


def _time_unit(name: str) -> tuple[str, str]:
    match = _TIME_UNIT.match(name.strip().lower())
    return (match["name"], match["unit"]) if match and match["name"] else (name, "")


def _step_s(time_s: Array) -> float:
    steps = np.diff(time_s[np.isfinite(time_s)])
    forward = steps[steps > 0.0]
    return float(np.median(forward)) if len(forward) else np.inf


def _continued(time_s: Array) -> tuple[Array, int]:
    """Times whose parts, where they begin anew as each episode's do, follow each other; and how often they do."""
    steps = np.diff(time_s)
    back = np.flatnonzero(steps < -1.0)
    if not len(back):
        return time_s, 0
    shift = np.zeros(len(time_s))
    for k in back:
        shift[k + 1 :] += time_s[k] - time_s[k + 1] + 1.0
    return time_s + shift, len(back)


# ---- columns ---------------------------------------------------------------------------------------------------------


def _joint_columns(log: _Log, robot: Robot, mapping: Mapping[str, Meaning]) -> list[str]:
    meant = recognise(log.columns, robot, mapping)
    if meant.faults:
        raise RecordingError(f"{log.path}: {'; '.join(meant.faults)}")
    wanted = [f"q{k + 1}" for k in range(robot.n_joints)]
    return [meant.columns[name].name for name in wanted] if all(name in meant.columns for name in wanted) else []


def _columns_of_interest(log: _Log, robot: Robot, mapping: Mapping[str, Meaning]) -> list[str]:
    time = _time(log, mapping)
    joints = _joint_columns(log, robot, mapping)
    triples = [name for triple in _triples(log, mapping, set(joints)).values() for name in triple]
    conditions = [name for name in _condition_columns(log, joints).values() if name]
    label = _label_column(log)
    conditions += own_pose_columns(log.columns) or ()
    return [*(() if time is None else time[1]), *joints, *triples, *conditions, *(() if label is None else (label,))]


def _joints(log: _Log, time_s: Array, robot: Robot, mapping: Mapping[str, Meaning]) -> JointSeries | None:
    names = _joint_columns(log, robot, mapping)
    if not names:
        return None
    values = np.column_stack([log.numbers(name) for name in names])
    known = np.isfinite(values).all(axis=1)
    conditions = {key: log.numbers(column)[known] for key, column in _condition_columns(log, names).items()}
    kept_s, values, *further = in_order(time_s[known], values[known], *conditions.values())
    unit = "rad" if all(_RADIANS.search(name) and not split_unit(name)[1] for name in names) else ""
    return JointSeries(str(log.path), kept_s, tuple(names), values, unit, dict(zip(conditions, further, strict=True)))


def _condition_columns(log: _Log, joints: Sequence[str]) -> dict[str, str]:
    """Columns of torque and temperature of each joint, by their name in a series, such as "effort q1"."""
    out: dict[str, str] = {}
    for key, words in (("effort", {"effort", "torque"}), ("temperature", {"temperature", "temperatures", "temp"})):
        of_kind = [
            n
            for n in log.columns
            if words_of(n) & words and not words_of(n) & {"target", "desired", "command", "tcp", "control"}
        ]
        numbered = sorted((int(m[1]), name) for name in of_kind if (m := re.search(r"(\d+)\]?$", name)))
        for k, joint in enumerate(joints):
            stem = re.sub(r"position|pos$", "", joint)
            same = [name for name in of_kind if re.sub("|".join(words), "", name) == stem]
            if len(same) == 1:
                out[f"{key} {joint}"] = same[0]
            elif len(numbered) == len(joints):
                out[f"{key} {joint}"] = numbered[k][1]
    return out


def _triples(log: _Log, mapping: Mapping[str, Meaning], joints: set[str]) -> dict[str, tuple[str, str, str]]:
    """Columns x, y, z of each point, by what stands before them."""
    told = {meant.name: column for column, meant in mapping.items() if meant.name in ("x", "y", "z")}
    if len(told) == 3 and all(column in log.columns for column in told.values()):
        return {"": (told["x"], told["y"], told["z"])}
    found: dict[str, dict[str, str]] = {}
    for name in log.columns:
        base, _ = split_unit(name)
        match = re.fullmatch(r"(?P<before>.*?)(?:^|[^A-Za-z0-9]|(?<=[a-z]))T?(?P<axis>[xyzXYZ])", base.strip())
        if match and name not in joints and not words_of(match["before"]) & _NOT_PLACES:
            found.setdefault(match["before"].strip("/._ "), {}).setdefault(match["axis"].lower(), name)
    whole = {key: (axes["x"], axes["y"], axes["z"]) for key, axes in found.items() if len(axes) == 3}
    markers = marker_columns([name for name in log.columns if name not in joints])
    return whole | {key: columns for key, columns in markers.items() if columns not in whole.values()}


def _label_column(log: _Log) -> str | None:
    """Column that names the point of each row; None where there is none."""
    return next((name for name in log.columns if plain(name) in _LABELS), None)


def _points(log: _Log, time_s: Array, mapping: Mapping[str, Meaning], joints: set[str]) -> tuple[PointSeries, ...]:
    labels = _label_column(log)
    out = []
    triples = _triples(log, mapping, joints)
    own_columns = own_pose_columns([name for name in log.columns if name[-1:].isdigit()])
    if own_columns is not None:
        triples[f"tcp {own_columns[0]}"] = own_columns
    for key, triple in triples.items():
        xyz = np.column_stack([log.numbers(name) for name in triple])
        known = np.isfinite(xyz).all(axis=1)
        units = {mapping[n].unit if n in mapping else split_unit(n)[1] for n in triple}
        unit = units.pop() if len(units) == 1 else ""
        named = np.full(len(xyz), key, dtype=object) if labels is None else log.frame[labels].astype(str).to_numpy()
        for label in dict.fromkeys(named[known]):
            rows = known & (named == label)
            kept_s, kept = in_order(time_s[rows], xyz[rows])
            own = is_own_pose(key)
            out.append(
                PointSeries(
                    key if labels is not None else str(label),
                    str(label) if labels is not None else "",
                    kept_s,
                    kept,
                    unit,
                    own,
                )
            )
    return tuple(out)


def describe(path: Path) -> tuple[bool, bool]:
    """Whether a log has joints and points by the names of its columns, without a robot. Raises DatasetError."""
    if is_always_log(path):
        return _described(_parquet(path)[0] if path.suffix.lower() not in JSON_LINES else _json_lines(path))
    return describe_table(head_of(path))


def describe_table(table: UserTable) -> tuple[bool, bool]:
    """Whether a table has joints and points by the names of its columns, without a robot. Raises DatasetError."""
    return _described(_log_of(table))


def _described(log: _Log) -> tuple[bool, bool]:
    positions = [name for name in log.columns if is_position(name)]
    meant = recognise(log.columns, None, {})
    named = [n for n in positions if n.startswith(_STATE) or n.lower().endswith(("/position", "joint"))]
    named += [n for n in positions if split_unit(n)[1] in ("deg", "rad") and not words_of(n) & _TURNS]
    return ("q1" in meant.columns or bool(meant.faults) or len(named) > 1, bool(_triples(log, {}, set())))


__all__ = ["DatasetError", "describe", "describe_table", "has_time", "is_log", "read_table_log"]
