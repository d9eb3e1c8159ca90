"""Recordings of an arm that stops at poses, in the forms that logs have, written by other libraries and read back."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import mcap.writer
import mcap_ros2.writer
import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import rosbags.rosbag1
import rosbags.rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from calib.dataset.files.folder import load_dataset
from inspector.cli.parser import main
from tests.support.recorded_run import NAMES, Run, recorded_run, robot_toml

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
SHUFFLED = (4, 0, 5, 2, 1, 3)
DETECTIONS = {  # as apriltag_ros, whose poses stand in the detections
    "apriltag_ros/msg/AprilTagDetection": "int32[] id\nfloat64[] size\ngeometry_msgs/PoseWithCovarianceStamped pose",
    "apriltag_ros/msg/AprilTagDetectionArray": "std_msgs/Header header\napriltag_ros/AprilTagDetection[] detections",
}


@pytest.fixture(scope="module")
def run() -> Run:
    return recorded_run(np.random.default_rng(5), 20)


# ---- messages --------------------------------------------------------------------------------------------------------


def header(store: Any, t: float, frame: str = "tracker", k: int = 0) -> Any:
    ns = round(t * 1e9)
    stamp = store.types["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)
    kind = store.types["std_msgs/msg/Header"]
    return kind(k, stamp, frame) if "seq" in kind.__dataclass_fields__ else kind(stamp, frame)


def joint_state(store: Any, t: float, q: np.ndarray, effort: np.ndarray, order: Sequence[int], k: int = 0) -> Any:
    """A joint state with the joints in some order and a gripper's finger among them."""
    names = ["gripper_finger_joint", *(NAMES[i] for i in order)]
    position = np.array([0.01 * (k % 3), *q[list(order)]])
    efforts = np.array([0.0, *effort[list(order)]])
    return store.types["sensor_msgs/msg/JointState"](header(store, t, "", k), names, position, np.zeros(7), efforts)


def point(store: Any, p: np.ndarray) -> Any:
    return store.types["geometry_msgs/msg/Point"](*map(float, p))


def pose(store: Any, p: np.ndarray) -> Any:
    turn = store.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    return store.types["geometry_msgs/msg/Pose"](point(store, p), turn)


def transform(store: Any, t: float, p: np.ndarray, child: str, frame: str = "tracker") -> Any:
    vector = store.types["geometry_msgs/msg/Vector3"](*map(float, p))
    turn = store.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    inner = store.types["geometry_msgs/msg/Transform"](vector, turn)
    return store.types["geometry_msgs/msg/TransformStamped"](header(store, t, frame), child, inner)


def marker(store: Any, t: float, p: np.ndarray, number: int) -> Any:
    kind = store.types["visualization_msgs/msg/Marker"]
    zero: dict[str, Any] = {
        "header": header(store, t), "ns": "smr", "id": number, "type": 2, "action": 0, "pose": pose(store, p),
        "scale": store.types["geometry_msgs/msg/Vector3"](0.01, 0.01, 0.01),
        "color": store.types["std_msgs/msg/ColorRGBA"](1.0, 0.0, 0.0, 1.0),
        "lifetime": store.types["builtin_interfaces/msg/Duration"](0, 0), "frame_locked": False, "points": [],
        "colors": [], "text": "", "mesh_resource": "", "mesh_use_embedded_materials": False,
    }  # fmt: skip
    if "texture" in kind.__dataclass_fields__:
        image = store.types["sensor_msgs/msg/CompressedImage"](header(store, t), "", np.zeros(0, np.uint8))
        zero |= {"texture_resource": "", "texture": image, "uv_coordinates": []}
        zero["mesh_file"] = store.types["visualization_msgs/msg/MeshFile"]("", np.zeros(0, np.uint8))
    return kind(**{each.name: zero[each.name] for each in fields(kind) if each.name in zero})


def stamped_point(store: Any, t: float, p: np.ndarray) -> tuple[str, Any]:
    return "geometry_msgs/msg/PointStamped", store.types["geometry_msgs/msg/PointStamped"](
        header(store, t), point(store, p)
    )


def stamped_pose(store: Any, t: float, p: np.ndarray) -> tuple[str, Any]:
    return "geometry_msgs/msg/PoseStamped", store.types["geometry_msgs/msg/PoseStamped"](
        header(store, t), pose(store, p)
    )


def stamped_transform(store: Any, t: float, p: np.ndarray) -> tuple[str, Any]:
    return "geometry_msgs/msg/TransformStamped", transform(store, t, p, "smr")


def tf(store: Any, t: float, p: np.ndarray) -> tuple[str, Any]:
    """The reflector among links of the robot, the controller's own tool and a fixed frame."""
    turned = np.array([0.0, 0.0, 0.425])
    own = p @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) + 0.3
    frames = [
        transform(store, t, turned, "forearm_link", "upper_arm_link"),
        transform(store, t, own, "tool0_controller", "base"),
        transform(store, t, p, "smr"),
        transform(store, t, np.ones(3), "world", "map"),
    ]
    return "tf2_msgs/msg/TFMessage", store.types["tf2_msgs/msg/TFMessage"](frames)


def single_marker(store: Any, t: float, p: np.ndarray) -> tuple[str, Any]:
    return "visualization_msgs/msg/Marker", marker(store, t, p, 3)


def markers(store: Any, t: float, p: np.ndarray) -> tuple[str, Any]:
    """The moving marker and one on the wall."""
    both = [marker(store, t, np.array([3.0, 2.0, 1.0]) + 1e-4 * (p % 0.1), 1), marker(store, t, p, 3)]
    return "visualization_msgs/msg/MarkerArray", store.types["visualization_msgs/msg/MarkerArray"](both)


def detections(store: Any, t: float, p: np.ndarray) -> tuple[str, Any]:
    kind = store.types["apriltag_ros/msg/AprilTagDetection"]
    with_covariance = store.types["geometry_msgs/msg/PoseWithCovariance"](pose(store, p), np.zeros(36))
    stamped = store.types["geometry_msgs/msg/PoseWithCovarianceStamped"](header(store, t), with_covariance)
    found = kind(np.array([7], np.int32), np.array([0.05]), stamped)
    name = "apriltag_ros/msg/AprilTagDetectionArray"
    return name, store.types[name](header(store, t), [found])


def store_with_detections(ros1: bool) -> Any:
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    types: dict[str, Any] = {}
    for name, text in DETECTIONS.items():
        types |= get_types_from_msg(text, name)
    store.register(types)
    return store


Shape = Callable[[Any, float, np.ndarray], tuple[str, Any]]


def messages(run: Run, store: Any, shape: Shape) -> list[tuple[float, str, str, Any]]:
    """Time of arrival, topic, type and message, in the order of arrival, with a camera's images among them."""
    rng = np.random.default_rng(2)
    out: list[tuple[float, str, str, Any]] = []
    kind = "sensor_msgs/msg/JointState"
    for k, (t, q, effort) in enumerate(zip(run.joint_s, run.q, run.effort_nm, strict=True)):
        order = SHUFFLED if k % 2 else tuple(range(6))
        out.append((t + 0.004, "/joint_states", kind, joint_state(store, t, q, effort, order, k)))
    for t, p in zip(run.point_s, run.xyz_mm, strict=True):
        out.append((t - run.offset_s + rng.uniform(0.01, 0.03), "/tracker/target", *shape(store, t, p / 1000.0)))
    camera = "sensor_msgs/msg/CompressedImage"
    for t in run.joint_s[::200]:
        image = store.types[camera](header(store, t), "jpeg", np.zeros(2000, np.uint8))
        out.append((t, "/camera/image/compressed", camera, image))
    return sorted(out, key=lambda each: each[0])


# ---- forms -----------------------------------------------------------------------------------------------------------


def ros1_bag(shape: Shape, compression: Any = None) -> Callable[[Run, Path], list[str]]:
    def write(run: Run, folder: Path) -> list[str]:
        store = store_with_detections(True)
        writer = rosbags.rosbag1.Writer(folder / "run.bag")
        if compression:
            writer.set_compression(compression)
        with writer as bag:
            made: dict[str, Any] = {}
            for t, topic, kind, message in messages(run, store, shape):
                if topic not in made:
                    made[topic] = bag.add_connection(topic, kind, typestore=store)
                bag.write(made[topic], round(t * 1e9), store.serialize_ros1(message, kind))
        return ["--joints", str(folder / "run.bag")]

    return write


def ros2_bag(shape: Shape, storage: str, *, lone: bool = False) -> Callable[[Run, Path], list[str]]:
    def write(run: Run, folder: Path) -> list[str]:
        store = store_with_detections(False)
        plugin = rosbags.rosbag2.StoragePlugin.MCAP if storage == "mcap" else rosbags.rosbag2.StoragePlugin.SQLITE3
        with rosbags.rosbag2.Writer(folder / "run", version=9, storage_plugin=plugin) as bag:
            made: dict[str, Any] = {}
            for t, topic, kind, message in messages(run, store, shape):
                if topic not in made:
                    made[topic] = bag.add_connection(topic, kind, typestore=store)
                bag.write(made[topic], round(t * 1e9), store.serialize_cdr(message, kind))
        if not lone:
            return ["--joints", str(folder / "run")]
        (found,) = (folder / "run").glob("*.db3") if storage != "mcap" else (folder / "run").glob("*.mcap")
        return ["--joints", str(found.rename(folder / found.name))]

    return write


def mcap_of_ros2(cut: bool = False) -> Callable[[Run, Path], list[str]]:
    """By mcap-ros2-support, from its own message texts."""
    head = "builtin_interfaces/Time stamp\nstring frame_id\n"
    line = "=" * 80
    parts = f"{line}\nMSG: std_msgs/Header\n{head}{line}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    joints = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    axes = f"{line}\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"
    places = f"std_msgs/Header header\ngeometry_msgs/Point point\n{parts}{axes}"

    def write(run: Run, folder: Path) -> list[str]:
        path = folder / "run.mcap"
        with path.open("wb") as stream:
            writer = mcap_ros2.writer.Writer(stream)
            of_joints = writer.register_msgdef("sensor_msgs/msg/JointState", joints + parts)
            of_points = writer.register_msgdef("geometry_msgs/msg/PointStamped", places)
            rows = [(t, True, q) for t, q in zip(run.joint_s, run.q, strict=True)]
            rows += [(t, False, p) for t, p in zip(run.point_s, run.xyz_mm / 1000.0, strict=True)]
            for t, is_joint, values in sorted(rows, key=lambda row: row[0]):
                ns = round(t * 1e9)
                stamp = {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": ""}
                if is_joint:
                    content = {
                        "header": stamp,
                        "name": list(NAMES),
                        "position": values.tolist(),
                        "velocity": [],
                        "effort": [],
                    }
                    writer.write_message("/joint_states", of_joints, content, ns, ns)
                else:
                    content = {"header": stamp, "point": dict(zip("xyz", values.tolist(), strict=True))}
                    writer.write_message("/smr", of_points, content, ns, ns)
            writer.finish()
        if cut:  # as after a loss of power
            path.write_bytes(path.read_bytes()[: int(0.9 * path.stat().st_size)])
        return ["--joints", str(path)]

    return write


def mcap_of_json(run: Run, folder: Path) -> list[str]:
    with (folder / "run.mcap").open("wb") as stream:
        writer = mcap.writer.Writer(stream)
        writer.start()
        ids = {}
        for topic, name in (("/joint_states", "JointState"), ("/marker", "foxglove.PoseInFrame")):
            schema = writer.register_schema(name, "jsonschema", b'{"type": "object"}')
            ids[topic] = writer.register_channel(topic, "json", schema)
        for t, q in zip(run.joint_s, run.q, strict=True):
            data = {"name": list(NAMES), "position": q.tolist()}
            writer.add_message(ids["/joint_states"], round(t * 1e9), json.dumps(data).encode(), round(t * 1e9))
        for t, p in zip(run.point_s, run.xyz_mm / 1000.0, strict=True):
            stamp = {"sec": int(t), "nsec": round((t % 1.0) * 1e9)}
            pose_now = {
                "position": dict(zip("xyz", p.tolist(), strict=True)),
                "orientation": {"x": 0, "y": 0, "z": 0, "w": 1},
            }
            data = {"timestamp": stamp, "frame_id": "tracker", "pose": pose_now}
            writer.add_message(ids["/marker"], round(t * 1e9), json.dumps(data).encode(), round(t * 1e9))
        writer.finish()
    return ["--joints", str(folder / "run.mcap")]


def mcap_of_ros1(run: Run, folder: Path) -> list[str]:
    with (folder / "run.mcap").open("wb") as stream:
        writer = mcap.writer.Writer(stream)
        writer.start(profile="ros1")
        ids: dict[str, int] = {}
        for t, topic, kind, message in messages(run, ROS1, stamped_pose):
            if topic not in ids:
                text, _ = ROS1.generate_msgdef(kind)
                schema = writer.register_schema(kind.replace("/msg/", "/"), "ros1msg", text.encode())
                ids[topic] = writer.register_channel(topic, "ros1", schema)
            writer.add_message(ids[topic], round(t * 1e9), bytes(ROS1.serialize_ros1(message, kind)), round(t * 1e9))
        writer.finish()
    return ["--joints", str(folder / "run.mcap")]


def write_csv(path: Path, names: Sequence[str], rows: Sequence[Sequence[Any]], separator: str = ",") -> Path:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, delimiter=separator)
        writer.writerow(names)
        for row in rows:
            cells = [
                cell if isinstance(cell, str) else repr(float(cell)) if isinstance(cell, float) else str(cell)
                for cell in row
            ]
            writer.writerow([cell.replace(".", ",") if separator == ";" else cell for cell in cells])
    return path


def together(run: Run, joint: Sequence[np.ndarray], places: Sequence[np.ndarray]) -> list[list[Any]]:
    """Rows of one table by the joints' clock, points interpolated to them; both as lists of columns."""
    at = run.point_s - run.offset_s
    shown = [np.interp(run.joint_s, at, column) for column in places]
    return [[float(column[i]) for column in (*joint, *shown)] for i in range(len(run.joint_s))]


def two_csvs(
    joint_names: Sequence[str], joint_columns: Callable[[Run], list[np.ndarray]], point_names: Sequence[str],
    point_columns: Callable[[Run], list[np.ndarray]], separator: str = ",",
) -> Callable[[Run, Path], list[str]]:  # fmt: skip
    def write(run: Run, folder: Path) -> list[str]:
        joints = write_csv(folder / "joints.csv", joint_names, np.column_stack(joint_columns(run)).tolist(), separator)
        points = write_csv(folder / "points.csv", point_names, np.column_stack(point_columns(run)).tolist(), separator)
        return ["--joints", str(joints), "--points", str(points)]

    return write


def one_csv(
    names: Sequence[str], columns: Callable[[Run], tuple[list[np.ndarray], list[np.ndarray]]], separator: str = ","
) -> Callable[[Run, Path], list[str]]:
    def write(run: Run, folder: Path) -> list[str]:
        path = write_csv(folder / "log.csv", names, together(run, *columns(run)), separator)
        return ["--joints", str(path)]

    return write


RTDE = [*(f"target_q_{k}" for k in range(6)), *(f"actual_q_{k}" for k in range(6)),
        *(f"actual_qd_{k}" for k in range(6)),
        *(f"actual_current_{k}" for k in range(6)), *(f"joint_temperatures_{k}" for k in range(6)),
        *(f"actual_TCP_pose_{k}" for k in range(6)), "runtime_state", "robot_mode"]  # fmt: skip


def rtde_columns(run: Run) -> list[np.ndarray]:
    n = len(run.q)
    return [run.joint_s - run.joint_s[0] + 4321.0, *(run.q + 1e-5).T, *run.q.T, *np.gradient(run.q, axis=0).T,
            *(0.1 * run.effort_nm).T,
            *np.full((6, n), 31.5), *np.zeros((6, n)), np.ones(n), np.full(n, 7)]  # fmt: skip


def plotjuggler(run: Run, folder: Path) -> list[str]:
    """Rows of joints and of points follow each other by time, with the other's cells empty."""
    names = [
        "__time",
        *(f"/joint_states/{NAMES[k]}/{what}" for k in SHUFFLED for what in ("effort", "position", "velocity")),
    ]
    names += [f"/tracker/point/{axis}" for axis in "xyz"]
    rows: list[list[Any]] = []
    for t, q, effort in zip(run.joint_s, run.q, run.effort_nm, strict=True):
        rows.append([t, *(cell for k in SHUFFLED for cell in (effort[k], q[k], 0.0)), "", "", ""])
    rows += [[t, *[""] * 18, *(p / 1000.0)] for t, p in zip(run.point_s, run.xyz_mm, strict=True)]
    rows.sort(key=lambda row: float(row[0]))
    return ["--joints", str(write_csv(folder / "plot.csv", names, rows))]


def rostopic_echo(run: Run, folder: Path) -> list[str]:
    names = [
        "%time",
        "field.header.seq",
        "field.header.stamp",
        "field.header.frame_id",
        *(f"field.name{k}" for k in range(6)),
        *(f"field.position{k}" for k in range(6)),
    ]
    rows = [
        [round(t * 1e9) + 3_000_000, k, round(t * 1e9), "", *(NAMES[i] for i in SHUFFLED), *(q[i] for i in SHUFFLED)]
        for k, (t, q) in enumerate(zip(run.joint_s, run.q, strict=True))
    ]
    joints = write_csv(folder / "joints.csv", names, rows)
    points = [
        [round(t * 1e9), k, round(t * 1e9), "tracker", *(p / 1000.0)]
        for k, (t, p) in enumerate(zip(run.point_s, run.xyz_mm, strict=True))
    ]
    names = [
        "%time",
        "field.header.seq",
        "field.header.stamp",
        "field.header.frame_id",
        *(f"field.point.{axis}" for axis in "xyz"),
    ]
    return ["--joints", str(joints), "--points", str(write_csv(folder / "points.csv", names, points))]


def json_records(run: Run, folder: Path) -> list[str]:
    rows = together(run, [run.joint_s, *run.q.T], list(run.xyz_mm.T))
    path = folder / "log.json"
    path.write_text(json.dumps([{"timestamp": r[0], "joints": r[1:7], "tracker": r[7:]} for r in rows]))
    return ["--joints", str(path)]


def json_lines(run: Run, folder: Path) -> list[str]:
    """As `ros2 topic echo` piped through a converter writes messages, a file a topic."""

    def stamp(t: float) -> dict[str, Any]:
        ns = round(t * 1e9)
        return {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": "x"}

    with (folder / "joints.jsonl").open("w") as stream:
        for t, q in zip(run.joint_s, run.q, strict=True):
            record = {"header": stamp(t), "name": [NAMES[i] for i in SHUFFLED], "position": [q[i] for i in SHUFFLED]}
            stream.write(json.dumps(record) + "\n")
    with (folder / "points.jsonl").open("w") as stream:
        for t, p in zip(run.point_s, run.xyz_mm / 1000.0, strict=True):
            stream.write(json.dumps({"header": stamp(t), "point": dict(zip("xyz", p.tolist(), strict=True))}) + "\n")
    return ["--joints", str(folder / "joints.jsonl"), "--points", str(folder / "points.jsonl")]


def lerobot(run: Run, folder: Path) -> list[str]:
    """A folder of LeRobot with three episodes, degrees, whose points stand in a vector of their own."""
    rows = np.array(together(run, [run.joint_s, *np.degrees(run.q).T], list(run.xyz_mm.T)))
    data = folder / "lerobot" / "data" / "chunk-000"
    data.mkdir(parents=True)
    (folder / "lerobot" / "meta").mkdir()
    features = {"observation.state": {"dtype": "float32", "shape": [6], "names": [f"{name}.pos" for name in NAMES]}}
    (folder / "lerobot" / "meta" / "info.json").write_text(json.dumps({"fps": 50, "features": features}))
    for k, part in enumerate(np.array_split(rows, 3)):
        n = len(part)
        table = pa.table({
            "observation.state": pa.array(part[:, 1:7].tolist(), pa.list_(pa.float64())),
            "action": pa.array(part[:, 1:7].tolist(), pa.list_(pa.float64())),
            "observation.tracker": pa.array(part[:, 7:].tolist(), pa.list_(pa.float64(), 3)),
            "timestamp": part[:, 0] - part[0, 0], "frame_index": np.arange(n), "episode_index": np.full(n, k),
            "task": ["calibrate"] * n,
        })  # fmt: skip
        pq.write_table(table, data / f"episode_{k:06d}.parquet")
    return ["--joints", str(folder / "lerobot")]


def flat_parquet(run: Run, folder: Path) -> list[str]:
    times = pa.array((run.joint_s * 1e9).astype("int64"), pa.timestamp("ns"))
    pq.write_table(
        pa.table({"timestamp": times, **{f"{n}_rad": run.q[:, k] for k, n in enumerate(NAMES)}}),
        folder / "joints.parquet",
    )
    places = {f"{axis}_mm": run.xyz_mm[:, k] for k, axis in enumerate("xyz")}
    pq.write_table(pa.table({"time_ns": (run.point_s * 1e9).astype("int64"), **places}), folder / "points.parquet")
    return ["--joints", str(folder / "joints.parquet"), "--points", str(folder / "points.parquet")]


def sheets(run: Run, folder: Path) -> list[str]:
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, header_row, rows in (
        (
            "Joints",
            ["Time [s]", *(f"A{k} [deg]" for k in range(1, 7))],
            np.column_stack([run.joint_s - run.joint_s[0], np.degrees(run.q)]),
        ),
        (
            "Tracker",
            ["Time [s]", "X [mm]", "Y [mm]", "Z [mm]"],
            np.column_stack([run.point_s - run.joint_s[0], run.xyz_mm]),
        ),
    ):
        sheet = book.create_sheet(name)
        sheet.append(header_row)
        for row in rows.tolist():
            sheet.append(row)
    book.save(folder / "log.xlsx")
    return ["--joints", str(folder / "log.xlsx#Joints"), "--points", str(folder / "log.xlsx#Tracker")]


def dates(run: Run, folder: Path) -> list[str]:
    joints = [
        [datetime.fromtimestamp(t, UTC).isoformat(), *np.degrees(q)] for t, q in zip(run.joint_s, run.q, strict=True)
    ]
    points = [[datetime.fromtimestamp(t, UTC).isoformat(), *p] for t, p in zip(run.point_s, run.xyz_mm, strict=True)]
    of_joints = write_csv(folder / "j.csv", ["timestamp", *(f"axis{k} [deg]" for k in range(1, 7))], joints)
    of_points = write_csv(folder / "p.csv", ["timestamp", "x [mm]", "y [mm]", "z [mm]"], points)
    return ["--joints", str(of_joints), "--points", str(of_points)]


def single_points(run: Run, folder: Path) -> list[str]:
    """A tracker that writes one point a stop when its key is pressed."""
    ends = [np.flatnonzero(np.abs(run.q - q).max(axis=1) < 1e-3)[-20] for q in run.stops_q]
    times = run.joint_s[ends]
    rng = np.random.default_rng(0)
    points = np.column_stack([times, run.stops_mm + rng.normal(0.0, 0.01, run.stops_mm.shape)])
    joints = write_csv(
        folder / "joints.csv",
        ["time_s", *(f"q{k}_rad" for k in range(1, 7))],
        np.column_stack([run.joint_s, run.q]).tolist(),
    )
    return [
        "--joints",
        str(joints),
        "--points",
        str(write_csv(folder / "p.csv", ["time_s", "x_mm", "y_mm", "z_mm"], points.tolist())),
    ]


def rows_of_poses(run: Run, folder: Path) -> list[str]:
    """A bag of joints, and a table of one point a stop without any time."""
    ros2_bag(stamped_point, "sqlite3")(run, folder)
    path = write_csv(folder / "points.csv", ["x_mm", "y_mm", "z_mm"], run.stops_mm.tolist())
    return ["--joints", str(folder / "run"), "--points", str(path)]


DEG, MM = (lambda run: list(np.degrees(run.q).T)), (lambda run: list(run.xyz_mm.T))
FORMS: dict[str, Callable[[Run, Path], list[str]]] = {
    "ROS 1 bag, PointStamped": ros1_bag(stamped_point),
    "ROS 1 bag, lz4, PoseStamped": ros1_bag(stamped_pose, rosbags.rosbag1.Writer.CompressionFormat.LZ4),
    "ROS 1 bag, detections of tags": ros1_bag(detections),
    "rosbag2 sqlite3, TransformStamped": ros2_bag(stamped_transform, "sqlite3"),
    "rosbag2 sqlite3, tf": ros2_bag(tf, "sqlite3"),
    "rosbag2 mcap, Marker": ros2_bag(single_marker, "mcap"),
    "rosbag2 mcap, MarkerArray": ros2_bag(markers, "mcap"),
    "rosbag2 sqlite3, detections of tags": ros2_bag(detections, "sqlite3"),
    "lone db3, PointStamped": ros2_bag(stamped_point, "sqlite3", lone=True),
    "lone mcap, PoseStamped": ros2_bag(stamped_pose, "mcap", lone=True),
    "mcap by mcap-ros2-support": mcap_of_ros2(),
    "mcap cut off": mcap_of_ros2(cut=True),
    "mcap of JSON": mcap_of_json,
    "mcap of ROS 1": mcap_of_ros1,
    "RTDE and a tracker, clocks of their own": two_csvs(
        ["timestamp", *RTDE], rtde_columns, ["time", "x_mm", "y_mm", "z_mm"], lambda run: [run.point_s, *run.xyz_mm.T]
    ),
    "RTDE, separated by blanks": two_csvs(
        ["timestamp", *RTDE], rtde_columns,
        ["time", "x_mm", "y_mm", "z_mm"], lambda run: [run.point_s, *run.xyz_mm.T], " ",
    ),
    "RTDE with the tracker's columns": one_csv(
        ["timestamp", *RTDE, "tracker_x", "tracker_y", "tracker_z"], lambda run: (rtde_columns(run), MM(run))
    ),
    "a German controller, ms, decimal commas": two_csvs(
        ["Zeit [ms]", *(f"A{k} [deg]" for k in range(1, 7))],
        lambda run: [1e3 * (run.joint_s - run.joint_s[0]), *DEG(run)],
        ["Zeit [s]", "X [mm]", "Y [mm]", "Z [mm]"], lambda run: [run.point_s - run.point_s[0], *MM(run)], ";",
    ),
    "PlotJuggler": plotjuggler,
    "rostopic echo -p": rostopic_echo,
    "ros2_control in columns": one_csv(
        ["__time", *(f"/joint_states/position[{k}]" for k in range(6)),
         *(f"/joint_states/velocity[{k}]" for k in range(6)),
         "/vrpn/tool_marker/pose/position/x", "/vrpn/tool_marker/pose/position/y", "/vrpn/tool_marker/pose/position/z"],
        lambda run: ([run.joint_s, *run.q.T, *np.gradient(run.q, axis=0).T], list(run.xyz_mm.T / 1000.0)), "\t",
    ),
    "JSON records": json_records,
    "JSON lines": json_lines,
    "LeRobot": lerobot,
    "parquet": flat_parquet,
    "sheets": sheets,
    "dates": dates,
    "single points": single_points,
    "a table of points without times": rows_of_poses,
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_the_stops_of_a_recording_are_its_poses(
    form: str, run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.toml").write_text(robot_toml())
    given = FORMS[form](run, tmp_path)
    code = main(["import", str(tmp_path / "made"), "--robot", str(tmp_path / "robot.toml"), *given, "--json"])
    out = capsys.readouterr()
    assert code == 0, out.err
    made = load_dataset(tmp_path / "made")
    assert made.points is not None
    at_s = np.array([np.flatnonzero(np.abs(run.q - q).max(axis=1) < 1e-3)[0] for q in run.stops_q])
    stops = [int(np.argmin(np.abs(run.stops_q - q).max(axis=1))) for q in made.poses.q]
    assert len(set(stops)) == len(stops) >= (17 if form == "mcap cut off" else 19)
    assert np.abs(made.poses.q - run.stops_q[stops]).max() < 2e-5  # of 60 joint states a stop with 2e-5 rad each
    off = made.points.xyz_mm - run.stops_mm[stops][made.points.pose]
    assert np.sqrt(np.mean(off**2)) < 0.025  # a mean of about 70 points of 0.05 mm, 6 of which tell as much as one
    assert made.poses.approach is None or (made.poses.approach == run.sides[stops]).all()
    assert made.poses.time_s is not None
    assert (np.diff(made.poses.time_s) > 0.0).all()
    assert len(at_s) == 20
