"""Times of a table's rows, by the names of its columns and by how their numbers go on."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.dataset_import.column_words import is_called
from calib.dataset_import.columns import Meaning
from calib.extras.logs.series import RecordingError
from calib.lazy_modules import pd
from calib.text_files.column_names import plain

_SLOWEST_S = 0.5  # between two rows of a log; a pose a row takes longer, as the arm has to get there
_TIMES = ("time", "timestamp", "t", "stamp", "times", "zeit", "zeitstempel", "rosbagtimestamp", "headerstamp",
          "robottime", "elapsedtime", "logtime", "clock", "fieldheaderstamp", "uptime", "temps", "tiempo",
          "tempo", "duration", "ipoc", "时间", "时间戳")  # fmt: skip
_UNIT = re.compile(r"(?P<name>.+?)(?:[\s_.]*[\[(]\s*|[\s_.]+)(?P<unit>ns|us|µs|ms|s|sec|seconds|nanosec|min)\s*[\])]?")
_SCALES = {"ns": 1e-9, "nanosec": 1e-9, "us": 1e-6, "µs": 1e-6, "ms": 1e-3, "min": 60.0}
_EPOCHS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))  # clocks that count from 1970, by the least that they show
_NANO = ("nanosec", "nsec", "nsecs")
_EPOCH = 1e8  # seconds, from which a clock counts from 1970
_COUNTED = 2000  # whole units of a clock that steps evenly, from which they are milliseconds


@dataclass(frozen=True)
class Log:
    """A table by its columns."""

    path: Path
    frame: Any  # pandas.DataFrame
    rate_hz: float = 0.0  # of the rows, where the file tells it

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(map(str, self.frame.columns))

    def numbers(self, name: str) -> Array:
        """Numbers (N,) of a column, of dates the seconds since 1970; NaN where a cell holds none."""
        column = self.frame[name]
        if pd.api.types.is_datetime64_any_dtype(column):
            return np.asarray((column - pd.Timestamp(0, tz=column.dt.tz)).dt.total_seconds(), dtype=float)
        return np.asarray(pd.to_numeric(column, errors="coerce"), dtype=float)


def has_fast_rows(log: Log, mapping: Mapping[str, Meaning]) -> bool:
    """Whether a table has times that come faster than an arm's poses, and that are not mapped to `ignore`."""
    try:
        time = time_of(log, mapping)
    except RecordingError:
        return False
    if time is None or any(name in mapping and mapping[name].name == "ignore" for name in time[1]):
        return False
    steps = np.diff(time[0][np.isfinite(time[0])])
    return bool((steps > 0.0).any() and np.median(steps[steps > 0.0]) <= _SLOWEST_S)


def seconds_of(log: Log, mapping: Mapping[str, Meaning]) -> tuple[Array, tuple[str, ...]] | None:
    """Times (N,), s, that go on where the log's begin anew, as each episode's do, and notes."""
    time = time_of(log, mapping)
    if time is None:
        return None
    time_s, _ = time
    steps = np.diff(time_s, prepend=time_s[:1])
    resets = steps < -1.0
    told = f"{log.path}: its time begins anew {resets.sum()} times; the parts are read one behind the other"
    return time_s + np.cumsum(np.where(resets, 1.0 - steps, 0.0)), (told,) if resets.any() else ()


def time_of(log: Log, mapping: Mapping[str, Meaning]) -> tuple[Array, tuple[str, ...]] | None:
    """Times (N,), s, with the columns that hold them; None where there are none. Raises RecordingError."""
    mapped = [name for name in log.columns if name in mapping and mapping[name].name == "time_s"]
    for name in () if mapped else log.columns:
        before = name.removesuffix("s").removesuffix("sec")
        beside = [f"{before}{end}" for end in _NANO if before != name and f"{before}{end}" in log.columns]
        if beside:
            return log.numbers(name) + 1e-9 * log.numbers(beside[0]), (name, beside[0])
    name = (mapped or sorted(log.columns, key=lambda each: _rank(log, each)))[0]
    if mapped or np.isfinite(_rank(log, name)):
        return _in_seconds(log, name), (name,)
    if not log.rate_hz:
        return None
    frame = next((name for name in log.columns if plain(name) == "frame"), None)
    frames = np.arange(len(log.frame), dtype=float) if frame is None else log.numbers(frame)
    return frames / log.rate_hz, () if frame is None else (frame,)


def _rank(log: Log, name: str) -> float:
    """How unlikely a column is the time of the rows, by its name; inf where it is none."""
    word = plain(_split(name)[0])
    if word in _TIMES:
        return _TIMES.index(word)
    if word.endswith(("headerstamp", "timestamp")):
        return len(_TIMES)
    if is_called(name, "time"):
        steps = np.diff(log.numbers(name))
        if len(steps) and (steps >= 0.0).all() and steps.any():  # as a clock goes on
            return len(_TIMES) + 1
    return np.inf


def _split(name: str) -> tuple[str, str]:
    """A column's name without its unit of time, and the unit, "" for none."""
    match = _UNIT.fullmatch(name.strip().lower())
    return (match["name"], match["unit"]) if match else (name, "ms" if plain(name) == "ipoc" else "")


def _in_seconds(log: Log, name: str) -> Array:
    """Times (N,), s, of a column of numbers or dates, its unit by their size where none is given.

    A clock without a unit that goes on evenly in whole numbers for long counts milliseconds.
    """
    values, unit = log.numbers(name), _split(name)[1]
    known = values[np.isfinite(values)]
    if not len(known):
        cells = log.frame[name].astype(str)
        day_first = bool(re.match(r"\s*\d{1,2}\.\d{1,2}\.\d{4}", cells.iloc[0]))  # 05.03.2024
        dates = pd.to_datetime(cells, errors="coerce", utc=True, format="mixed", dayfirst=day_first)
        if dates.isna().all():
            raise RecordingError(f"{log.path}: column {name}: found {cells.iloc[0][:40]!r}; a time is needed")
        return Log(log.path, dates.to_frame(name)).numbers(name)
    if unit:
        return values * _SCALES.get(unit, 1.0)
    steps = np.diff(known)
    is_even = known.max() < _EPOCH and steps.sum() >= _COUNTED and np.mean(steps == np.median(steps)) > 0.9
    is_counted = is_even and (known == np.round(known)).all()
    return values * (1e-3 if is_counted else next((scale for least, scale in _EPOCHS if known.max() > least), 1.0))
