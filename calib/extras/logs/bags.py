"""Bags of ROS as recordings, by the extra `logs`: rosbags, no ROS.

The files are read in a bounded process, as the library builds code from the message definitions in the file.
"""

from __future__ import annotations

import base64
from collections import defaultdict
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.bounded_process import ProcessFailed, ProcessLimits, ask
from calib.errors import visible
from calib.extras.logs.bag_process import JOINT_TYPE, may_have_points
from calib.extras.logs.series import BAGS, JointSeries, PointSeries, Recording, RecordingError, in_order

_READER = "calib.extras.logs.bag_process:read"
_LIMITS = ProcessLimits(seconds=900.0, memory_bytes=4 * 1024**3, answer_bytes=1024**3)
_MOST_RAD = 4.0 * np.pi  # that a joint turns
LEAST_SPREAD = 1e-3  # of the largest extent, in a second direction, of a point that an arm moves


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a .bag, .mcap or .db3, a folder of rosbag2, or one of the parts of a bag alone."""
    if not path.is_dir():
        return path.suffix.lower() in BAGS and path.is_file()
    return (path / "metadata.yaml").is_file() or {f.suffix.lower() in BAGS for f in path.iterdir()} == {True}


def kinds_in_bag(path: Path) -> tuple[bool, bool]:
    """Whether a bag has joint states, and whether it may have measured points. Raises RecordingError."""
    kinds = {str(topic["type"]) for topic in _asked(path, only_topics=True)["topics"]}
    return JOINT_TYPE in kinds, any(map(may_have_points, kinds))


def read_bag(path: Path) -> Recording:
    """Joints and points of a bag; topics of cameras and of types without positions are not read.

    Raises RecordingError where the bag cannot be read.
    """
    answer = _asked(path, only_topics=False)
    sets: defaultdict[str, list[tuple[list[str], Array, Array]]] = defaultdict(list)
    for each in answer["joints"]:
        sets[each["topic"]].append((each["names"], *_rows(each)))
    points = [PointSeries(str(each["topic"]), str(each["label"]), *_rows(each)) for each in answer["points"]]
    read = {*sets, *(each.source for each in points)}
    others = tuple(
        f"{visible(each['topic'])} ({visible(each['type'])}, {each['count']})"
        for each in answer["topics"]
        if each["topic"] not in read
    )
    joints = tuple(_joints(topic, of_topic) for topic, of_topic in sets.items())
    return Recording(joints, tuple(each for each in points if _moves(each.xyz)), others)


def _asked(path: Path, *, only_topics: bool) -> Mapping[str, Any]:
    if not path.exists():
        raise RecordingError(f"{path}: no such file; name a bag")
    if find_spec("rosbags") is None:
        raise RecordingError(
            f"{path}: a bag is read with rosbags, which is not installed: "
            "pip install 'robot-calibration-inspector[logs]', or export the topics as CSV"
        )
    try:
        answer = ask(_READER, {"path": str(path.resolve()), "only_topics": only_topics}, _LIMITS)
    except ProcessFailed as error:
        raise RecordingError(f"{path}: {error}; cut the bag to the topics of joints and points") from None
    if "failed" in answer:
        raise RecordingError(
            f"{path}: cannot be read as a bag of ROS ({answer['failed']}); record or convert it again "
            "(an .mcap that was cut off: `mcap recover`)"
        )
    return dict(answer)


def _rows(answer: Mapping[str, Any]) -> tuple[Array, Array]:
    """Times (N,) and rows (N, d) of numbers, by the time of their headers, or where one has none of their log."""
    rows = answer["rows"]
    found = np.frombuffer(base64.b64decode(rows["data"]), dtype="<f8").reshape(rows["shape"])
    time_s, values = in_order(found[:, 1] if np.isfinite(found[:, 1]).all() else found[:, 0], found[:, 2:])
    return time_s, values


def _joints(topic: str, sets: list[tuple[list[str], Array, Array]]) -> JointSeries:
    """Joints of a topic: sets of joints that come in messages of their own are put beside each other."""
    sets.sort(key=lambda found: (-len(found[0]), -len(found[1])))
    time_s = sets[0][1]
    joints: dict[str, Array] = {}
    efforts: dict[str, Array] = {}
    for names, own_s, rows in sets:
        columns = (np.interp(time_s, own_s, column, left=np.nan, right=np.nan) for column in rows.T)
        for k, (name, column) in enumerate(zip((*names, *names), columns, strict=True)):
            if k < len(names):
                joints.setdefault(name, column)
            elif np.isfinite(column).any() and np.ptp(column) > 0.0:
                efforts.setdefault(f"effort {name}", column)
    values = np.column_stack(list(joints.values()))
    unit = "rad" if np.nanmax(np.abs(values), initial=0.0) <= _MOST_RAD else ""  # some drivers write degrees
    return JointSeries(topic, time_s, tuple(joints), values, unit, efforts)


def _moves(xyz: Array) -> bool:
    """Whether a position moves in two directions at least: neither a fixed frame nor one link's place in the next."""
    if len(xyz) < 3:
        return False
    extents = np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)
    radii = np.linalg.norm(xyz, axis=1)
    is_turned_only = float(np.ptp(radii)) <= 1e-6 * float(radii.max(initial=0.0))  # about the parent's origin
    return bool(extents[0] > 0.0 and extents[1] > LEAST_SPREAD * extents[0] and not is_turned_only)
