"""Joints and points by time, as they were recorded: the one form that every log is brought to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calib.array_types import Array, BoolArray
from calib.dataset_import.column_words import is_own
from calib.errors import DatasetError
from calib.text_files.records import table_file

BAGS = (".bag", ".mcap", ".db3")
PARQUET = ".parquet"
_HELD = 5.0  # times as many rows with one value as are usual


@dataclass(frozen=True)
class JointSeries:
    """Joint values by time, with efforts where they were recorded; columns have the log's names."""

    source: str  # topic or file
    time_s: Array  # (N,) ascending
    names: tuple[str, ...]
    values: Array  # (N, k) in the log's units, which names or points have to tell; NaN where one was not recorded
    efforts: Mapping[str, Array] = field(default_factory=dict)  # (N,) by joint

    def __len__(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True)
class PointSeries:
    """Positions of one point by time."""

    source: str  # topic, or what stands before x, y, z in a table's columns
    label: str  # frame, marker or target; "" where the source has one point only
    time_s: Array  # (N,) ascending
    xyz: Array  # (N, 3) in the log's unit
    unit: str = ""  # "" where the points' spread has to tell

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def name(self) -> str:
        """Source and label, as the user names them behind the file's `#`."""
        return ":".join(part for part in (self.source, self.label) if part)

    @property
    def is_controllers_own(self) -> bool:
        """Whether it is named as a pose that the controller computes or is commanded, which measures nothing."""
        return is_own(f"{self.source} {self.label}")


@dataclass(frozen=True)
class Recording:
    """What a log holds: joints, points, and a line for what was not read."""

    joints: tuple[JointSeries, ...] = ()
    points: tuple[PointSeries, ...] = ()
    others: tuple[str, ...] = ()  # topics that hold neither, with their types
    notes: tuple[str, ...] = ()
    unit_is_unknown: bool = False  # of the joints, whatever their size: LeRobot's states may be normalised


def recording_file(path: Path) -> tuple[Path, str]:
    """File or folder of a recording and the topic named behind it, such as `run.bag#/tracker/point`; "" for none."""
    file, _, topic = str(path).partition("#")
    is_named = topic and Path(file).exists() and not path.exists() and not table_file(path)[1]
    return (Path(file), topic) if is_named else (path, "")


def in_order(time_s: Array, *values: Array) -> tuple[Array, ...]:
    """Times and values in ascending order of time, a time that comes twice once, rows without a time left out."""
    known = np.flatnonzero(np.isfinite(time_s))
    _, first = np.unique(time_s[known], return_index=True)
    rows = known[first]
    return (time_s[rows], *(each[rows] for each in values))


def lost_rows(xyz: Array) -> BoolArray:
    """Rows (N,) that an instrument wrote while it had lost its target: zeros, or the last value held for long.

    A value that stands there for a few rows is one of a log that is faster than the instrument, or of few digits.
    """
    starts = np.flatnonzero(np.r_[True, (np.diff(xyz, axis=0) != 0.0).any(axis=1)])
    lengths = np.diff(np.r_[starts, len(xyz)])
    held = lengths > np.maximum(_HELD, _HELD * np.quantile(lengths, 0.9)) if len(lengths) > 1 else np.zeros(1, bool)
    lost = np.repeat(held, lengths)
    lost[starts] = False  # the first was measured
    return np.asarray(lost | (xyz == 0.0).all(axis=1))


class RecordingError(DatasetError):
    """Error: a recording cannot be read, or holds no joints, points or stops."""
