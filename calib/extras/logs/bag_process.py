"""Reading of bags in a process of its own: messages of joint and point topics as numbers, all others skipped.

rosbags reads ROS 1 bags, rosbag2 folders and their parts. Types come from the definitions in the file, else from those
of ROS.
"""

from __future__ import annotations

import base64
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

MOST_SAMPLES = 4_000_000  # of one topic: two hours at 500 Hz
_DEPTH = 5  # of the message parts that are looked through for a position
JOINT_TYPE = "sensor_msgs/msg/JointState"
_NOT_LOOKED_INTO = ("sensor_msgs/", "rcl_interfaces/", "rosgraph_msgs/", "diagnostic_msgs/", "trajectory_msgs/",
                    "nav_msgs/msg/Path", "nav_msgs/msg/OccupancyGrid", "control_msgs/", "std_msgs/", "moveit_msgs/",
                    "actionlib_msgs/", "action_msgs/", "stereo_msgs/", "shape_msgs/", "octomap_msgs/")  # fmt: skip
_LABELS = ("child_frame_id", "marker_name", "id", "marker_index", "fiducial_id", "tag_id", "object_id", "name",
           "class_id", "tracking_id", "index", "rigid_body_name", "segment_name", "subject_name")  # fmt: skip
_INSIDE = ("pose", "position", "transform", "translation", "point", "center", "bbox", "results")  # where positions are
_ANGLES = ("q", "actual_q", "measured_joint_position", "joint_position", "joint_positions", "joint_angles")
"""Lists of joint values without names, as messages of makers have them: they are named q01, q02 ..."""
_FEW_TRIED = 20  # messages of a topic whose type is not known, before it is skipped as one without positions
DELETED = 2  # action of a visualization_msgs/Marker that adds nothing from here on


def prepare() -> None:
    """Import the library before the limits of the process hold."""
    import rosbags.highlevel
    import rosbags.typesys  # noqa: F401


def read(request: Mapping[str, Any]) -> dict[str, Any]:
    """Topics of a bag, and with `only_topics` unset the numbers of joint and point topics, arrays as base64.

    Request: path, only_topics.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    path = Path(request["path"])
    files = [path]
    if path.is_dir() and not (path / "metadata.yaml").is_file():  # the parts of a split bag
        files = sorted(file for file in path.iterdir() if file.suffix.lower() in (".bag", ".db3", ".mcap"))
    try:
        with AnyReader(files, default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
            topics = [
                {"topic": t, "type": info.msgtype or "", "count": info.msgcount} for t, info in bag.topics.items()
            ]
            chosen = [each for each in bag.connections if each.msgtype == JOINT_TYPE or may_have_points(each.msgtype)]
            if request["only_topics"] or not chosen:  # of none the reader would read all
                return {"topics": topics, "joints": [], "points": []}
            messages = (
                (each.topic, time_ns * 1e-9, bag.deserialize(raw, each.msgtype))
                for each, time_ns, raw in bag.messages(connections=chosen)
            )
            return {"topics": topics} | series_of(messages)
    except MemoryError:
        raise
    except Exception as error:  # whatever a damaged file leads the library to
        return {"failed": " ".join(str(error).split())[:300] or type(error).__name__}


def may_have_points(kind: str) -> bool:
    """Whether messages of a type are looked into for positions."""
    return not kind.startswith(_NOT_LOOKED_INTO)


def series_of(messages: Iterable[tuple[str, float, Any]]) -> dict[str, Any]:
    """Numbers of joints by topic and set of joints, and of points by topic and label.

    messages: topic, time of the log in s, and message, of which each
    """
    joints: defaultdict[tuple[str, tuple[str, ...]], list[list[float]]] = defaultdict(list)
    points: defaultdict[tuple[str, str, str], list[list[float]]] = defaultdict(list)
    counts, without, with_points = Counter[str](), Counter[str](), set[str]()
    for topic, log_s, message in messages:
        if without[topic] >= _FEW_TRIED:
            continue
        counts[topic] += 1
        if counts[topic] > MOST_SAMPLES:
            raise ValueError(f"{topic} has more than {MOST_SAMPLES / 1e6:g} million messages; cut the bag")
        names, values = _joint_values(message)
        if names:
            joints[topic, names].append([log_s, _stamp_s(message), *values])
            continue
        found = list(positions(message))
        with_points |= {topic} if found else set()
        without[topic] += topic not in with_points
        for label, frame, stamp_s, xyz in found:
            points[topic, label, frame].append([log_s, stamp_s, *xyz])
    frames = Counter((topic, label) for topic, label, _ in points)
    return {
        "joints": [{"topic": t, "names": names, "rows": _packed(rows)} for (t, names), rows in joints.items()],
        "points": [  # seen from several frames, as by two cameras, a marker is several points
            {"topic": t, "label": f"{frame}/{at}".strip("/") if frames[t, at] > 1 else at, "rows": _packed(rows)}
            for (t, at, frame), rows in points.items()
        ],
    }


def _packed(rows: list[list[float]]) -> dict[str, Any]:
    """Rows of numbers as JSON: shape and base64 of their doubles."""
    array = np.asarray(rows, dtype="<f8")
    return {"shape": list(array.shape), "data": base64.b64encode(array.tobytes()).decode("ascii")}


def _joint_values(message: Any) -> tuple[tuple[str, ...], list[float]]:
    """Names of a message's joints in alphabetical order, with their values and then efforts; empty for others."""
    names: Sequence[str] = getattr(message, "name", ())
    values, efforts = _numbers(message, "position"), _numbers(message, "effort")
    if not isinstance(names, list) or not values:
        values = next((found for key in _ANGLES if len(found := _numbers(message, key)) > 3), [])
        names = [f"q{k + 1:02}" for k in range(len(values))]
    if len(values) != len(names):
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
        if xyz is not None and getattr(item, "action", 0) < DELETED:
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
    x, y, z = (getattr(part, axis, getattr(part, f"{axis}_trans", None)) for axis in "xyz")
    if isinstance(x, (int, float)) and isinstance(y, (int, float)) and isinstance(z, (int, float)):
        is_place = not hasattr(part, "w") and all(map(math.isfinite, (x, y, z)))
        return (float(x), float(y), float(z)) if is_place else None
    for inner in (getattr(part, name, None) for name in _INSIDE if depth < _DEPTH):
        of_list = inner[0] if isinstance(inner, list) and inner else inner
        if of_list is not None and not isinstance(of_list, (str, int, float, list, np.ndarray)):
            found = _position(of_list, depth + 1)
            if found is not None:
                return found
    return None
