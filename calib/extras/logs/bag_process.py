"""Reading of bags in a process of its own: messages of joint and point topics as numbers, all others skipped.

rosbags reads ROS 1 bags and rosbag2 folders (sqlite3, mcap), and the messages of a lone .mcap whose container mcap
reads, whatever its profile; messages in JSON are read as they are. Types come from the definitions in the file, else
from those of ROS.
"""

from __future__ import annotations

import base64
import json
import math
import struct
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

MOST_SAMPLES = 4_000_000  # of one topic: two hours at 500 Hz
_DEPTH = 5  # of the message parts that are looked through for a position
_JOINT_TYPES = ("sensor_msgs/msg/JointState",)
_NOT_LOOKED_INTO = ("sensor_msgs/", "rcl_interfaces/", "rosgraph_msgs/", "diagnostic_msgs/", "trajectory_msgs/",
                    "nav_msgs/msg/Path", "nav_msgs/msg/OccupancyGrid", "control_msgs/", "std_msgs/", "moveit_msgs/",
                    "actionlib_msgs/", "action_msgs/", "stereo_msgs/", "shape_msgs/", "octomap_msgs/")  # fmt: skip
_LABELS = ("child_frame_id", "marker_name", "id", "marker_index", "fiducial_id", "tag_id", "object_id", "name",
           "class_id", "tracking_id", "index", "rigid_body_name", "segment_name", "subject_name")  # fmt: skip
_LISTS = ("transforms", "markers", "detections", "poses", "points", "fiducials", "tags", "bodies", "rigid_bodies",
          "rigidbodies", "objects", "subjects")  # fmt: skip
_IDENTIFIERS = ("marker_ids", "ids", "tag_ids", "names")  # of the items of a list, in a list beside it
_ANGLES = ("q", "actual_q", "measured_joint_position", "joint_position", "joint_positions", "joint_angles")
"""Lists of joint values without names, as messages of makers have them: they are named q1, q2 ..."""
_FEW_TRIED = 20  # messages of a topic whose type is not known, before it is skipped as one without positions
DELETED = 2  # action of a visualization_msgs/Marker that adds nothing from here on

Decoded = tuple[str, float, Any]  # topic, time of the log in s, message


def prepare() -> None:
    """Import the libraries before the limits of the process hold."""
    import mcap.reader  # noqa: F401
    import rosbags.highlevel
    import rosbags.typesys  # noqa: F401


def read(request: Mapping[str, Any]) -> dict[str, Any]:
    """Topics of a bag, and with `only_topics` unset the numbers of joint and point topics, arrays as base64.

    Request: path, only_topics.
    """
    try:
        with _opened(Path(request["path"])) as bag:
            topics = [{"topic": t, "type": kind, "count": count} for t, kind, count in bag.topics]
            if request["only_topics"]:
                return {"topics": topics}
            read_topics = {t for t, kind, _ in bag.topics if kind in _JOINT_TYPES or may_have_points(kind)}
            return {"topics": topics} | _series(bag.messages(read_topics), {t: kind for t, kind, _ in bag.topics})
    except MemoryError:
        raise
    except Exception as error:  # whatever a damaged file leads the libraries to
        return {"failed": " ".join(str(error).split())[:300] or type(error).__name__}


def may_have_points(kind: str) -> bool:
    """Whether messages of a type are looked into for positions."""
    return not kind.startswith(_NOT_LOOKED_INTO)


# ---- containers ------------------------------------------------------------------------------------------------------


class _RosBag:
    """ROS 1 bags, rosbag2 folder or lone .db3, by rosbags."""

    def __init__(self, paths: list[Path]) -> None:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        self._reader = AnyReader(paths, default_typestore=get_typestore(Stores.ROS2_HUMBLE))

    def __enter__(self) -> _RosBag:
        self._reader.open()
        return self

    def __exit__(self, *_: object) -> None:
        self._reader.close()

    @property
    def topics(self) -> list[tuple[str, str, int]]:
        counts: dict[tuple[str, str], int] = {}
        for connection in self._reader.connections:
            key = (connection.topic, connection.msgtype)
            counts[key] = counts.get(key, 0) + connection.msgcount
        return [(topic, kind, count) for (topic, kind), count in counts.items()]

    def messages(self, topics: set[str]) -> Iterator[Decoded]:
        chosen = [each for each in self._reader.connections if each.topic in topics]
        if not chosen:  # which the reader would take for all
            return
        for connection, time_ns, raw in self._reader.messages(connections=chosen):
            yield connection.topic, time_ns * 1e-9, self._reader.deserialize(raw, connection.msgtype)


class _Mcap:
    """Lone .mcap of any profile: messages in CDR or ROS 1 form, and in JSON."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> _Mcap:
        from mcap.exceptions import McapError
        from mcap.reader import NonSeekingReader, make_reader

        self._stream = self._path.open("rb")
        self._reader = make_reader(self._stream)
        self.is_cut = False
        try:
            summary = self._reader.get_summary()
        except McapError:
            summary = None
        if summary is None or not summary.channels:  # the recording ended without its index: read all there is
            self._stream.seek(0)
            channels: dict[int, tuple[Any, Any, int]] = {}
            try:
                for schema, channel, _ in NonSeekingReader(self._stream).iter_messages(log_time_order=False):
                    channels[channel.id] = (schema, channel, channels.get(channel.id, (None, None, 0))[2] + 1)
            except (McapError, EOFError, struct.error):
                if not channels:
                    raise
                self.is_cut = True
            self._stream.seek(0)
            self._reader = NonSeekingReader(self._stream)
            self._channels = list(channels.values())
        else:
            counts = summary.statistics.channel_message_counts if summary.statistics else {}
            self._channels = [
                (summary.schemas.get(channel.schema_id), channel, counts.get(channel.id, 0))
                for channel in summary.channels.values()
            ]
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    @property
    def topics(self) -> list[tuple[str, str, int]]:
        return [(channel.topic, _full_type(schema), count) for schema, channel, count in self._channels]

    def messages(self, topics: set[str]) -> Iterator[Decoded]:
        from mcap.exceptions import McapError

        if not topics:
            return
        decoders: dict[int, Callable[[bytes], Any] | None] = {}
        try:
            for schema, channel, message in self._reader.iter_messages(topics=list(topics), log_time_order=False):
                if channel.id not in decoders:
                    decoders[channel.id] = _decoder(schema, channel)
                decode = decoders[channel.id]
                if decode is not None:
                    yield channel.topic, message.log_time * 1e-9, decode(message.data)
        except (McapError, EOFError, struct.error):
            if not self.is_cut:
                raise


def _opened(path: Path) -> _RosBag | _Mcap:
    files = [path]
    if path.is_dir() and not (path / "metadata.yaml").is_file():  # the parts of a split bag
        files = sorted(file for file in path.iterdir() if file.suffix.lower() in (".bag", ".db3", ".mcap"))
    if len(files) == 1 and files[0].suffix.lower() == ".mcap" and files[0].is_file():
        return _Mcap(files[0])
    return _RosBag(files)


def _full_type(schema: Any) -> str:
    """Type's name in ROS 2's form; Foxglove's own names as they are."""
    name = "" if schema is None else str(schema.name)
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


def _decoder(schema: Any, channel: Any) -> Callable[[bytes], Any] | None:
    """Function from a message's bytes to the message; None for an encoding that is not read (protobuf, flatbuffer)."""
    if channel.message_encoding == "json":
        return lambda data: _Record(json.loads(data))
    if schema is None or channel.message_encoding not in ("cdr", "ros1"):
        return None
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    kind = _full_type(schema)
    text = schema.data.decode("utf-8", "replace")
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_idl(text) if "idl" in schema.encoding else get_types_from_msg(text, kind))
    if channel.message_encoding == "ros1":
        return lambda data: store.deserialize_ros1(data, kind)
    return lambda data: store.deserialize_cdr(data, kind)


class _Record:
    """JSON object with its keys as attributes, as decoded messages have them."""

    def __init__(self, record: Any) -> None:
        for key, value in (record if isinstance(record, dict) else {}).items():
            setattr(self, str(key), _wrapped(value))


def _wrapped(value: Any) -> Any:
    if isinstance(value, dict):
        return _Record(value)
    return [_wrapped(each) for each in value] if isinstance(value, list) else value


# ---- messages --------------------------------------------------------------------------------------------------------


def _series(messages: Iterable[Decoded], kinds: Mapping[str, str]) -> dict[str, Any]:
    """Numbers of joints by topic and set of joints, and of points by topic and label."""
    joints: dict[tuple[str, tuple[str, ...]], list[list[float]]] = {}
    points: dict[tuple[str, str, str], list[list[float]]] = {}
    without: dict[str, int] = {}
    counts: dict[str, int] = {}
    for topic, log_s, message in messages:
        if without.get(topic, 0) >= _FEW_TRIED:
            continue
        counts[topic] = counts.get(topic, 0) + 1
        if counts[topic] > MOST_SAMPLES:
            raise ValueError(f"{topic} has more than {MOST_SAMPLES / 1e6:g} million messages; cut the bag")
        if kinds.get(topic) in _JOINT_TYPES or _is_joint_state(message):
            names = [str(name) for name in message.name]
            values, effort = _floats(message.position), _floats(getattr(message, "effort", ()))
            if not names or len(values) != len(names):
                continue
            order = sorted(range(len(names)), key=names.__getitem__)  # drivers change the order between messages
            key = (topic, tuple(names[k] for k in order))
            efforts = [effort[k] for k in order] if len(effort) == len(names) else [math.nan] * len(names)
            row = [log_s, _stamp_s(message), *(values[k] for k in order), *efforts]
            joints.setdefault(key, []).append(row)
            continue
        angles = _angles(message)
        if angles:
            row = [log_s, _stamp_s(message), *angles, *[math.nan] * len(angles)]
            joints.setdefault((topic, tuple(f"q{k + 1:02}" for k in range(len(angles)))), []).append(row)
            continue
        found = list(_positions(message))
        if not found and (topic not in {t for t, _, _ in points}):
            without[topic] = without.get(topic, 0) + 1
        for label, frame, stamp_s, xyz in found:
            points.setdefault((topic, label, frame), []).append([log_s, stamp_s, *xyz])
    frames = Counter((topic, label) for topic, label, _ in points)
    by_label = {  # seen from several frames, as by two cameras, a marker is several points
        (topic, f"{frame}/{label}".strip("/") if frames[topic, label] > 1 else label): rows
        for (topic, label, frame), rows in points.items()
    }
    return {
        "joints": [{"topic": t, "names": names, "rows": packed(rows)} for (t, names), rows in joints.items()],
        "points": [{"topic": t, "label": label, "rows": packed(rows)} for (t, label), rows in by_label.items()],
    }


def _is_joint_state(message: Any) -> bool:
    name = getattr(message, "name", None)
    return isinstance(name, list) and hasattr(message, "position") and all(isinstance(each, str) for each in name)


def _angles(message: Any) -> list[float]:
    """Joint values of a message that names no joints; [] where it has none."""
    for name in _ANGLES:
        values = getattr(message, name, None)
        if isinstance(values, (list, np.ndarray)) and len(values) > 3 and np.asarray(values).dtype.kind in "fi":
            return _floats(values)
    return []


def packed(rows: list[list[float]]) -> dict[str, Any]:
    """Rows of numbers as JSON: shape and base64 of their doubles."""
    array = np.asarray(rows, dtype="<f8")
    return {"shape": list(array.shape), "data": base64.b64encode(array.tobytes()).decode("ascii")}


def _floats(values: Any) -> list[float]:
    return [float(each) for each in values]


def _stamp_s(message: Any) -> float:
    """Time, s, of a message's header; NaN where it has none or it was not set."""
    stamp = getattr(getattr(message, "header", message), "stamp", None)
    if stamp is None:
        stamp = getattr(message, "timestamp", None)
    if stamp is None:
        return math.nan
    sec = getattr(stamp, "sec", getattr(stamp, "secs", math.nan))
    nsec = getattr(stamp, "nanosec", getattr(stamp, "nsecs", getattr(stamp, "nsec", 0)))
    try:
        whole = float(sec) + 1e-9 * float(nsec)
    except (TypeError, ValueError):
        return math.nan
    return whole if whole > 0.0 else math.nan


def _positions(message: Any) -> Iterator[tuple[str, str, float, tuple[float, float, float]]]:
    """Positions in a message with label, frame and time, s: of itself, or of each item of its list."""
    stamp, frame = _stamp_s(message), _frame(message)
    xyz = _position(message, 0)
    if xyz is not None:
        if getattr(message, "action", 0) < DELETED:
            yield _label(message, None), frame, stamp, xyz
        return
    for name in _LISTS:
        items = getattr(message, name, None)
        items = items if isinstance(items, list) else []
        told = (getattr(message, key, None) for key in _IDENTIFIERS)
        beside = next((ids for ids in told if isinstance(ids, (list, np.ndarray)) and len(ids) == len(items)), None)
        for k, item in enumerate(items):
            xyz = _position(item, 0)
            if xyz is not None and getattr(item, "action", 0) < DELETED:
                own = _stamp_s(item)
                label = _label(item, k) if beside is None else str(beside[k])
                yield label, _frame(item) or frame, own if math.isfinite(own) else stamp, xyz


def _frame(part: Any) -> str:
    """Frame in which the positions of a message are; "" where it names none."""
    return str(getattr(getattr(part, "header", None), "frame_id", "") or "")


def _label(item: Any, number: int | None) -> str:
    """Name of a point: its frame, its identifier with its namespace, or its place in the list."""
    for name in _LABELS:
        value = getattr(item, name, None)
        if isinstance(value, (list, np.ndarray)):
            value = "-".join(str(each) for each in value)
        if value is not None and str(value):
            space = str(getattr(item, "ns", "") or getattr(item, "family", "") or "")
            return f"{space}/{value}" if space else str(value)
    return "" if number is None else str(number)


def _position(part: Any, depth: int) -> tuple[float, float, float] | None:
    """Position of the first pose, transform or point within a message; None where there is none."""
    if depth > _DEPTH:
        return None
    x, y, z = (getattr(part, axis, getattr(part, f"{axis}_trans", None)) for axis in "xyz")
    if x is not None and y is not None and z is not None and not hasattr(part, "w"):
        try:
            xyz = (float(x), float(y), float(z))
        except (TypeError, ValueError):
            return None
        return xyz if all(map(math.isfinite, xyz)) else None
    for name in ("pose", "position", "transform", "translation", "point", "center", "bbox", "results"):
        inner = getattr(part, name, None)
        if isinstance(inner, list):
            inner = inner[0] if inner else None
        if inner is not None and not isinstance(inner, (str, int, float, np.ndarray)):
            found = _position(inner, depth + 1)
            if found is not None:
                return found
    return None
