"""Bags of ROS as recordings, by the extra `logs`: rosbags, no ROS.

rosbags reads ROS 1 bags, rosbag2 folders and their parts. Types come from the definitions in the file, else from those
of ROS. Messages of joint and point topics are read as numbers, all others skipped. What visitors bring is read in the
bounded process that has all their files.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.errors import visible
from calib.extras.logs.series import BAGS, JointSeries, PointSeries, Recording, RecordingError, in_order

MOST_SAMPLES = 4_000_000  # of one topic: two hours at 500 Hz
LEAST_SPREAD = 1e-3  # of the largest extent, in a second direction, of a point that an arm moves
_DEPTH = 5  # of the message parts that are looked through for a position
_JOINT_TYPE = "sensor_msgs/msg/JointState"
_NOT_LOOKED_INTO = ("sensor_msgs/", "rcl_interfaces/", "rosgraph_msgs/", "diagnostic_msgs/", "trajectory_msgs/",
                    "nav_msgs/msg/Path", "nav_msgs/msg/OccupancyGrid", "control_msgs/", "std_msgs/", "moveit_msgs/",
                    "actionlib_msgs/", "action_msgs/", "stereo_msgs/", "shape_msgs/", "octomap_msgs/")  # fmt: skip
_LABELS = ("child_frame_id", "marker_name", "id", "marker_index", "fiducial_id", "tag_id", "object_id", "name",
           "class_id", "tracking_id", "index", "rigid_body_name", "segment_name", "subject_name")  # fmt: skip
_INSIDE = ("pose", "position", "transform", "translation", "point", "center", "bbox", "results")  # where positions are
_DELETED = 2  # action of a visualization_msgs/Marker that adds nothing from here on


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a .bag, .mcap or .db3, a folder of rosbag2, or one of the parts of a bag alone."""
    if not path.is_dir():
        return path.suffix.lower() in BAGS and path.is_file()
    return (path / "metadata.yaml").is_file() or {f.suffix.lower() in BAGS for f in path.iterdir()} == {True}


def kinds_in_bag(path: Path) -> tuple[bool, bool]:
    """Whether a bag has joint states, and whether it may have measured points. Raises RecordingError."""
    with _opened(path) as bag:
        kinds = {each.msgtype for each in bag.connections}
    return _JOINT_TYPE in kinds, any(map(_may_have_points, kinds))


def read_bag(path: Path) -> Recording:
    """Joints and points of a bag; topics of cameras and of types without positions are not read.

    Raises RecordingError where the bag cannot be read.
    """
    with _opened(path) as bag:
        chosen = [each for each in bag.connections if each.msgtype == _JOINT_TYPE or _may_have_points(each.msgtype)]
        joints, points = series_of(
            (each.topic, time_ns * 1e-9, bag.deserialize(raw, each.msgtype))
            for each, time_ns, raw in (bag.messages(connections=chosen) if chosen else ())  # of none it reads all
        )
        read = {each.source for each in joints} | {each.source for each in points}
        others = tuple(
            f"{visible(topic)} ({visible(info.msgtype or '')}, {info.msgcount})"
            for topic, info in bag.topics.items()
            if topic not in read
        )
    return Recording(tuple(joints), tuple(each for each in points if _moves(each.xyz)), others)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A reader of a bag. Raises RecordingError where it cannot be opened, or fails at what it holds."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ModuleNotFoundError:
        raise RecordingError(
            f"{path}: a bag is read with rosbags, which is not installed: "
            "pip install 'robot-calibration-inspector[logs]', or export the topics as CSV"
        ) from None
    files = [path]
    if path.is_dir() and not (path / "metadata.yaml").is_file():  # the parts of a split bag
        files = sorted(file for file in path.iterdir() if file.suffix.lower() in BAGS)
    try:
        with AnyReader(files, default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
            yield bag
    except MemoryError:
        raise
    except Exception as error:  # whatever a damaged file leads the library to
        raise RecordingError(
            f"{path}: cannot be read as a bag of ROS ({' '.join(str(error).split())[:300] or type(error).__name__}); "
            "record or convert it again (an .mcap that was cut off: `mcap recover`)"
        ) from None


def _may_have_points(kind: str) -> bool:
    """Whether messages of a type are looked into for positions."""
    return not kind.startswith(_NOT_LOOKED_INTO)


def series_of(messages: Iterable[tuple[str, float, Any]]) -> tuple[list[JointSeries], list[PointSeries]]:
    """Joints by topic, and points by topic and label.

    messages: topic, time of the log in s, and message, of which each
    """
    joints: defaultdict[str, defaultdict[tuple[str, ...], list[list[float]]]] = defaultdict(lambda: defaultdict(list))
    points: defaultdict[tuple[str, str, str], list[list[float]]] = defaultdict(list)
    counts = Counter[str]()
    for topic, log_s, message in messages:
        counts[topic] += 1
        if counts[topic] > MOST_SAMPLES:
            raise ValueError(f"{topic} has more than {MOST_SAMPLES / 1e6:g} million messages; cut the bag")
        names, values = _joint_values(message)
        if names:
            joints[topic][names].append([log_s, _stamp_s(message), *values])
            continue
        for label, frame, stamp_s, xyz in positions(message):
            points[topic, label, frame].append([log_s, stamp_s, *xyz])
    frames = Counter((topic, label) for topic, label, _ in points)
    return [_joints(topic, of_topic) for topic, of_topic in joints.items()], [
        # seen from several frames, as by two cameras, a marker is several points
        PointSeries(topic, f"{frame}/{label}".strip("/") if frames[topic, label] > 1 else label, *_by_time(rows))
        for (topic, label, frame), rows in points.items()
    ]


def _by_time(rows: list[list[float]]) -> tuple[Array, Array]:
    """Times (N,) and rows (N, d) of numbers, by the time of their headers, or where one has none of their log."""
    found = np.array(rows)
    time_s, values = in_order(found[:, 1] if np.isfinite(found[:, 1]).all() else found[:, 0], found[:, 2:])
    return time_s, values


def _joints(topic: str, sets: dict[tuple[str, ...], list[list[float]]]) -> JointSeries:
    """Joints of a topic: sets of joints that come in messages of their own are put beside each other."""
    time_s: Array | None = None
    joints: dict[str, Array] = {}
    efforts: dict[str, Array] = {}
    for names in sorted(sets, key=lambda names: (-len(names), -len(sets[names]))):
        own_s, rows = _by_time(sets[names])
        time_s = own_s if time_s is None else time_s
        columns = [np.interp(time_s, own_s, column, left=np.nan, right=np.nan) for column in rows.T]
        for name, column, effort in zip(names, columns, columns[len(names) :], strict=False):
            joints.setdefault(name, column)
            if np.isfinite(effort).any() and np.ptp(effort) > 0.0:
                efforts.setdefault(name, effort)
    assert time_s is not None
    return JointSeries(topic, time_s, tuple(joints), np.column_stack(list(joints.values())), efforts)


def _joint_values(message: Any) -> tuple[tuple[str, ...], list[float]]:
    """Names of a message's joints in alphabetical order, with their values and then efforts; empty for others."""
    names, values, efforts = getattr(message, "name", ()), _numbers(message, "position"), _numbers(message, "effort")
    if not isinstance(names, list) or len(values) != len(names):
        return (), []
    order = sorted(range(len(names)), key=names.__getitem__)  # drivers change the order between messages
    of_joints = efforts if len(efforts) == len(names) else [math.nan] * len(names)
    return tuple(str(names[k]) for k in order), [column[k] for column in (values, of_joints) for k in order]


def _numbers(message: Any, name: str) -> list[float]:
    """Numbers of a message's list; [] where it has none of that name."""
    values = getattr(message, name, ())
    is_list = isinstance(values, (list, np.ndarray)) and np.asarray(values).dtype.kind in "fi"
    return [float(each) for each in values] if is_list else []


def _stamp_s(message: Any) -> float:
    """Time, s, of a message's header; NaN where it has none or it was not set."""
    stamp = getattr(getattr(message, "header", message), "stamp", None)
    whole = getattr(stamp, "sec", 0) + 1e-9 * getattr(stamp, "nanosec", 0)
    return float(whole) if whole > 0.0 else math.nan


def positions(message: Any) -> Iterator[tuple[str, str, float, tuple[float, float, float]]]:
    """Positions in a message with label, frame and time, s: of itself, or of each item of its list."""
    items, frame = [(message, "")], _frame(message)
    if _position(message) is None:
        parts = vars(message)
        lists = (v for v in parts.values() if isinstance(v, list) and v and _position(v[0]) is not None)
        listed = next(lists, [])
        told = (v for k, v in parts.items() if k.endswith(("ids", "names")) and len(v) == len(listed))
        items = [(item, str(label)) for item, label in zip(listed, next(told, range(len(listed))), strict=True)]
    for item, place in items:
        xyz, own_s = _position(item), _stamp_s(item)
        if xyz is not None and getattr(item, "action", 0) < _DELETED:
            own = own_s if math.isfinite(own_s) else _stamp_s(message)
            yield _label(item, place), _frame(item) or frame, own, xyz


def _frame(part: Any) -> str:
    """Frame in which the positions of a message are; "" where it names none."""
    return str(getattr(getattr(part, "header", None), "frame_id", "") or "")


def _label(item: Any, place: str) -> str:
    """Name of a point: its frame, its identifier with its namespace, or its place in the list."""
    for name in _LABELS:
        value = getattr(item, name, None)
        if isinstance(value, (list, np.ndarray)):
            value = "-".join(str(each) for each in value)
        if value is not None and str(value):
            space = str(getattr(item, "ns", "") or getattr(item, "family", "") or "")
            return f"{space}/{value}" if space else str(value)
    return place


def _position(part: Any, depth: int = 0) -> tuple[float, float, float] | None:
    """Position of the first pose, transform or point within a message; None where there is none."""
    axes: list[Any] = [getattr(part, axis, getattr(part, f"{axis}_trans", None)) for axis in "xyz"]
    if all(isinstance(value, (int, float)) for value in axes):
        x, y, z = map(float, axes)
        return None if hasattr(part, "w") or not math.isfinite(x + y + z) else (x, y, z)
    for inner in (getattr(part, name, None) for name in _INSIDE if depth < _DEPTH):
        of_list = inner[0] if isinstance(inner, list) and inner else inner
        if hasattr(of_list, "__dict__") and (found := _position(of_list, depth + 1)) is not None:
            return found
    return None


def _moves(xyz: Array) -> bool:
    """Whether a position moves in two directions at least: neither a fixed frame nor one link's place in the next."""
    if len(xyz) < 3:
        return False
    extents = np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)
    radii = np.linalg.norm(xyz, axis=1)
    is_turned_only = float(np.ptp(radii)) <= 1e-6 * float(radii.max(initial=0.0))  # about the parent's origin
    return bool(extents[0] > 0.0 and extents[1] > LEAST_SPREAD * extents[0] and not is_turned_only)
