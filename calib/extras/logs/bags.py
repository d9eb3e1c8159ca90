"""Bags of ROS and MCAP files as recordings, by the extra `logs`: rosbags and mcap, no ROS.

The files are read in a bounded process, as both libraries build code from the message definitions in the file.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.bounded_process import ProcessFailed, ProcessLimits, ask
from calib.errors import visible
from calib.extras.logs.bag_process import may_have_points
from calib.extras.logs.series import BAGS, JointSeries, PointSeries, Recording, RecordingError, in_order

_READER = "calib.extras.logs.bag_process:read"
_LIMITS = ProcessLimits(seconds=900.0, memory_bytes=4 * 1024**3, answer_bytes=1024**3)
_LISTING = ProcessLimits(seconds=60.0, memory_bytes=2 * 1024**3, answer_bytes=16 * 1024**2)
_METADATA = "metadata.yaml"
_OWN_WORDS = ("tcp", "ee", "eef", "end_effector", "endeffector", "cartesian", "flange", "target_pose", "goal",
              "desired",
              "command", "cmd", "setpoint", "reference", "tool0", "fk", "odom")  # fmt: skip
LEAST_SPREAD = 1e-3  # of the largest extent, in a second direction, of a point that an arm moves


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a .bag, .mcap or .db3, a folder of rosbag2, or one of the parts of a bag alone."""
    if not path.is_dir():
        return path.suffix.lower() in BAGS and path.is_file()
    return (path / _METADATA).is_file() or {f.suffix.lower() in BAGS for f in path.iterdir()} == {True}


def bag_topics(path: Path) -> list[tuple[str, str, int]]:
    """Topics of a bag with their types and counts of messages. Raises RecordingError."""
    return _topics(_asked(path, {"only_topics": True}, _LISTING))


def kinds_of_topics(topics: Sequence[tuple[str, str, int]]) -> tuple[bool, bool]:
    """Whether topics have joint states, and whether they may have measured points."""
    return any("JointState" in kind for _, kind, _ in topics), any(may_have_points(kind) for _, kind, _ in topics)


def read_bag(path: Path) -> Recording:
    """Joints and points of a bag; topics of cameras and of types without positions are not read.

    Raises RecordingError where the bag cannot be read.
    """
    answer = _asked(path, {"only_topics": False}, _LIMITS)
    topics = _topics(answer)
    joints = _joints(answer["joints"])
    points = tuple(_points(each) for each in answer["points"])
    read = {each.source for each in joints} | {each.source for each in points}
    others = tuple(f"{visible(topic)} ({visible(kind)}, {count})" for topic, kind, count in topics if topic not in read)
    return Recording(joints, tuple(each for each in points if _moves(each.xyz)), others)


def is_own_pose(name: str) -> bool:
    """Whether a topic or column group is named as a pose that the controller computes or is commanded."""
    words = name.lower().replace("-", "_")
    parts = set(words.replace("/", "_").replace(".", "_").replace(" ", "_").split("_"))
    return any(word in parts or ("_" in word and word in words) for word in _OWN_WORDS)


def _topics(answer: Mapping[str, Any]) -> list[tuple[str, str, int]]:
    return [(str(each["topic"]), str(each["type"]), int(each["count"])) for each in answer["topics"]]


def _asked(path: Path, request: Mapping[str, Any], limits: ProcessLimits) -> Mapping[str, Any]:
    if not path.exists():
        raise RecordingError(f"{path}: no such file; name a bag")
    missing = [name for name in ("rosbags", "mcap") if find_spec(name) is None]
    if missing:
        raise RecordingError(
            f"{path}: a bag is read with {' and '.join(missing)}, which is not installed: "
            "pip install 'robot-calibration-inspector[logs]', or export the topics as CSV"
        )
    try:
        answer = ask(_READER, {"path": str(path.resolve()), **request}, limits)
    except ProcessFailed as error:
        raise RecordingError(f"{path}: {error}; cut the bag to the topics of joints and points") from None
    if "failed" in answer:
        raise RecordingError(f"{path}: cannot be read as a bag ({answer['failed']}); record or convert it again")
    return dict(answer)


def unpacked(rows: Mapping[str, Any]) -> Array:
    """Rows of numbers from their JSON form."""
    return np.frombuffer(base64.b64decode(rows["data"]), dtype="<f8").reshape(rows["shape"]).astype(float)


def _time_s(rows: Array) -> Array:
    """Times (N,) of messages: of their headers, unless some have none, then those at which they were recorded."""
    return rows[:, 1] if np.isfinite(rows[:, 1]).all() else rows[:, 0]


def _joints(answers: list[Mapping[str, Any]]) -> tuple[JointSeries, ...]:
    """Joints of each topic: sets of joints that come in messages of their own are put beside each other."""
    by_topic: dict[str, list[tuple[tuple[str, ...], Array]]] = {}
    for each in answers:
        by_topic.setdefault(each["topic"], []).append((tuple(each["names"]), unpacked(each["rows"])))
    out = []
    for topic, sets in by_topic.items():
        sets.sort(key=lambda found: (-len(found[0]), -len(found[1])))
        names, rows = sets[0]
        time_s, values = in_order(_time_s(rows), rows[:, 2:])
        positions, efforts = values[:, : len(names)], values[:, len(names) :]
        columns = dict(zip(names, positions.T, strict=True))
        of_efforts = dict(zip(names, efforts.T, strict=True))
        for further, rows in sets[1:]:
            other_s, others = in_order(_time_s(rows), rows[:, 2:])
            for k, name in enumerate(further):
                if name not in columns and len(other_s) > 1:
                    columns[name] = np.interp(time_s, other_s, others[:, k], left=np.nan, right=np.nan)
        conditions = {f"effort {name}": v for name, v in of_efforts.items() if np.isfinite(v).any() and np.ptp(v) > 0.0}
        out.append(
            JointSeries(topic, time_s, tuple(columns), np.column_stack(list(columns.values())), "rad", conditions)
        )
    return tuple(out)


def _points(answer: Mapping[str, Any]) -> PointSeries:
    rows = unpacked(answer["rows"])
    time_s, xyz = in_order(_time_s(rows), rows[:, 2:])
    topic, label = str(answer["topic"]), str(answer["label"])
    return PointSeries(topic, label, time_s, xyz, "", is_own_pose(topic) or is_own_pose(label))


def _moves(xyz: Array) -> bool:
    """Whether a position moves in two directions at least: neither a fixed frame nor one link's place in the next."""
    if len(xyz) < 3:
        return False
    away = xyz - xyz.mean(axis=0)
    extents = np.linalg.svd(away, compute_uv=False)
    radii = np.linalg.norm(xyz, axis=1)
    is_turned_only = float(np.ptp(radii)) <= 1e-6 * float(radii.max(initial=0.0))  # about the parent's origin
    return bool(extents[0] > 0.0 and extents[1] > LEAST_SPREAD * extents[0] and not is_turned_only)
