"""Recordings of an arm that stops at poses, in the forms that logs have, written by other libraries and read back."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mcap_ros2.writer
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import rosbags.rosbag1
import rosbags.rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from calib import calibrate
from calib.dataset.files.folder import load_dataset
from calib.dataset_import.user_files import BOTH, JOINTS, POINTS, look_through
from calib.frames import apply, best_fit_transform
from calib.kinematics.chain import target_points
from calib.statistics import rms, rms_length
from inspector.cli.parser import main
from tests.support.recorded_run import NAMES, Run, recorded_run, robot_toml, tool_mm

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
SHUFFLED = (4, 0, 5, 2, 1, 3)
DETECTIONS = {  # as apriltag_ros, whose poses stand in the detections
    "apriltag_ros/msg/AprilTagDetection": "int32[] id\nfloat64[] size\ngeometry_msgs/PoseWithCovarianceStamped pose",
    "apriltag_ros/msg/AprilTagDetectionArray": "std_msgs/Header header\napriltag_ros/AprilTagDetection[] detections",
}


@pytest.fixture(scope="module")
def run() -> Run:
    return recorded_run(np.random.default_rng(5), 18, joint_hz=30.0, point_hz=40.0)


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


def stamped_point(store: Any, t: float, p: np.ndarray) -> tuple[str, Any]:
    return "geometry_msgs/msg/PointStamped", store.types["geometry_msgs/msg/PointStamped"](
        header(store, t), point(store, p)
    )


def stamped_pose(store: Any, t: float, p: np.ndarray) -> tuple[str, Any]:
    return "geometry_msgs/msg/PoseStamped", store.types["geometry_msgs/msg/PoseStamped"](
        header(store, t), pose(store, p)
    )


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


def ros1_bag(shape: Shape) -> Callable[[Run, Path], list[str]]:
    def write(run: Run, folder: Path) -> list[str]:
        store = store_with_detections(True)
        with rosbags.rosbag1.Writer(folder / "run.bag") as bag:
            made: dict[str, Any] = {}
            for t, topic, kind, message in messages(run, store, shape):
                if topic not in made:
                    made[topic] = bag.add_connection(topic, kind, typestore=store)
                bag.write(made[topic], round(t * 1e9), store.serialize_ros1(message, kind))
        return ["--joints", str(folder / "run.bag")]

    return write


def ros2_bag(shape: Shape, storage: str) -> Callable[[Run, Path], list[str]]:
    def write(run: Run, folder: Path) -> list[str]:
        store = store_with_detections(False)
        plugin = rosbags.rosbag2.StoragePlugin.MCAP if storage == "mcap" else rosbags.rosbag2.StoragePlugin.SQLITE3
        with rosbags.rosbag2.Writer(folder / "run", version=9, storage_plugin=plugin) as bag:
            made: dict[str, Any] = {}
            for t, topic, kind, message in messages(run, store, shape):
                if topic not in made:
                    made[topic] = bag.add_connection(topic, kind, typestore=store)
                bag.write(made[topic], round(t * 1e9), store.serialize_cdr(message, kind))
        return ["--joints", str(folder / "run")]

    return write


def mcap_of_ros2(run: Run, folder: Path) -> list[str]:
    """By mcap-ros2-support, from its own message texts."""
    head = "builtin_interfaces/Time stamp\nstring frame_id\n"
    line = "=" * 80
    parts = f"{line}\nMSG: std_msgs/Header\n{head}{line}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    joints = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    axes = f"{line}\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"
    places = f"std_msgs/Header header\ngeometry_msgs/Point point\n{parts}{axes}"
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
    return ["--joints", str(path)]


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


RTDE = ("target_q", "actual_q", "joint_temperatures", "actual_TCP_pose")


def rtde_columns(run: Run) -> list[np.ndarray]:
    others = np.full((6, len(run.q)), 31.5), np.zeros((6, len(run.q)))
    return [run.joint_s - run.joint_s[0] + 4321.0, *(run.q + 1e-5).T, *run.q.T, *others[0], *others[1]]


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


def json_records(run: Run, folder: Path) -> list[str]:
    rows = together(run, [run.joint_s, *run.q.T], list(run.xyz_mm.T))
    path = folder / "log.json"
    path.write_text(json.dumps([{"timestamp": r[0], "joints": r[1:7], "tracker": r[7:]} for r in rows]))
    return ["--joints", str(path)]


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


FORMS: dict[str, Callable[[Run, Path], list[str]]] = {
    "ROS 1 bag, PointStamped": ros1_bag(stamped_point),
    "ROS 1 bag, detections of tags": ros1_bag(detections),
    "rosbag2 mcap, tf": ros2_bag(tf, "mcap"),
    "rosbag2 sqlite3, detections of tags": ros2_bag(detections, "sqlite3"),
    "mcap by mcap-ros2-support": mcap_of_ros2,
    "joint states in degrees": lambda run, folder: mcap_of_ros2(replace(run, q=np.degrees(run.q)), folder),
    "RTDE and a tracker, clocks of their own": two_csvs(
        ["timestamp", *(f"{name}_{k}" for name in RTDE for k in range(6))], rtde_columns,
        ["time", "x_mm", "y_mm", "z_mm"], lambda run: [run.point_s, *run.xyz_mm.T],
    ),
    "PlotJuggler": plotjuggler,
    "JSON records": json_records,
    "LeRobot": lerobot,
    "parquet": flat_parquet,
    "single points": single_points,
    "a table of points without times": rows_of_poses,
}  # fmt: skip


@pytest.mark.thorough
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
    stops = [int(np.argmin(np.abs(run.stops_q - q).max(axis=1))) for q in made.poses.q]
    assert len(set(stops)) == len(stops) >= 17
    assert np.abs(made.poses.q - run.stops_q[stops]).max() < 2e-5  # of 50 joint states a stop with 2e-5 rad each
    off = made.points.xyz_mm - run.stops_mm[stops][made.points.pose]
    assert rms(off) < 0.025  # a mean of some 60 points of 0.05 mm, 6 of which tell as much as one
    assert made.poses.approach is None or (made.poses.approach == run.sides[stops]).all()
    assert made.poses.time_s is not None
    assert (np.diff(made.poses.time_s) > 0.0).all()


# ---- what is told, what is refused -----------------------------------------------------------------------------------


def imported(folder: Path, given: Sequence[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Exit code, output and errors of `import`, with the robot of the run."""
    (folder / "robot.toml").write_text(robot_toml())
    code = main(["import", str(folder / "made"), "--robot", str(folder / "robot.toml"), *given])
    out = capsys.readouterr()
    return code, out.out, out.err


def joints_csv(run: Run, folder: Path, name: str = "joints.csv") -> Path:
    rows = np.column_stack([run.joint_s, run.q]).tolist()
    return write_csv(folder / name, ["time_s", *(f"q{k}_rad" for k in range(1, 7))], rows)


def points_csv(run: Run, folder: Path) -> Path:
    rows = np.column_stack([run.point_s, run.xyz_mm]).tolist()
    return write_csv(folder / "points.csv", ["time_s", "x_mm", "y_mm", "z_mm"], rows)


@pytest.mark.thorough
def test_from_the_bag_to_the_cause(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The arm's own zeros are found from a bag whose points are late by 0.35 s, and nothing else is named."""
    run = recorded_run(np.random.default_rng(8), 40)
    given = ros2_bag(stamped_point, "mcap")(run, tmp_path)
    code, out, _ = imported(tmp_path, given, capsys)
    assert code == 0
    assert "the arm stands 40 times" in out
    assert "its clock is 0.350 s ahead of the joints'" in out
    assert "not read: /camera/image/compressed (sensor_msgs/msg/CompressedImage, " in out
    assert "other joints are left out: gripper_finger_joint" in out
    assert main(["diagnose", str(tmp_path / "made"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] == "adequate"
    dataset = load_dataset(tmp_path / "made")
    fitted = calibrate(dataset).robot
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (300, 6))
    mine, true = target_points(fitted, q), tool_mm(q)
    assert (
        rms_length(
            apply(best_fit_transform(target_points(dataset.robot, q), true), target_points(dataset.robot, q)) - true
        )
        > 1.0
    )
    assert (
        rms_length(apply(best_fit_transform(mine, true), mine) - true) < 0.03
    )  # means of 0.01 mm, 40 stops, 26 parameters


def test_a_clock_of_its_own_is_found_over_the_whole_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = recorded_run(np.random.default_rng(3), 20, offset_s=-81234.567)
    code, out, _ = imported(
        tmp_path, ["--joints", str(joints_csv(run, tmp_path)), "--points", str(points_csv(run, tmp_path))], capsys
    )
    assert code == 0
    assert "its clock is 81234.567 s behind the joints'" in out


def test_joints_that_turn_by_a_few_degrees_are_no_radians(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = recorded_run(np.random.default_rng(5), 18, reach=0.04)
    code, out, _ = imported(tmp_path, mcap_of_ros2(replace(run, q=np.degrees(run.q)), tmp_path), capsys)
    assert code == 0
    assert "angles are taken for deg, their largest being 5." in out


def test_a_stop_of_one_reading_weighs_less_and_the_first_counts_where_no_joint_turns_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = recorded_run(np.random.default_rng(7), 16, offset_s=0.0, forwards=True)
    of_sixth = np.flatnonzero(np.linalg.norm(run.xyz_mm - run.stops_mm[5], axis=1) < 1.0)
    rare = replace(
        run,
        **{
            key: np.delete(getattr(run, key), np.delete(of_sixth, len(of_sixth) // 2), axis=0)
            for key in ("point_s", "xyz_mm")
        },
    )
    code, _, _ = imported(
        tmp_path, ["--joints", str(joints_csv(run, tmp_path)), "--points", str(points_csv(rare, tmp_path))], capsys
    )
    assert code == 0
    made = load_dataset(tmp_path / "made")
    assert made.points is not None
    assert made.points.counts_as is not None
    assert made.poses.approach is not None
    assert made.poses.approach.tolist() == run.sides.tolist()
    few, others = made.points.counts_as[5], np.delete(made.points.counts_as, 5)
    assert few < 0.25
    assert 0.7 < others.min() < others.max() < 1.4
    assert not made.declares_noise


@pytest.mark.thorough
def test_only_the_robots_joints_decide_what_stands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A gripper that opens while the arm stands changes nothing; another topic of joints is named."""
    run = recorded_run(np.random.default_rng(3), 20, offset_s=0.0)
    columns = [run.joint_s, *run.q.T, 0.04 * np.sin(40.0 * run.joint_s)]
    rows = together(run, columns, list(run.xyz_mm.T))
    names = ["time_s", *NAMES, "finger_joint", "x_mm", "y_mm", "z_mm"]
    code, out, _ = imported(tmp_path, ["--joints", str(write_csv(tmp_path / "log.csv", names, rows))], capsys)
    assert code == 0
    assert "the arm stands 20 times" in out
    assert "clocks of joints and points agree to 0.000 s" in out


@pytest.mark.thorough
def test_a_driver_that_writes_motor_currents_is_left_out_by_a_mapping(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ros2_bag(stamped_point, "sqlite3")(run, tmp_path)
    code, _, _ = imported(tmp_path, [*given, "--map", "torque*_nm=ignore"], capsys)
    assert code == 0
    assert not any(name.startswith("torque") for name in load_dataset(tmp_path / "made").poses.extra.names)


def bag_of(
    run: Run, folder: Path, shape: Shape, keep: Callable[[str], bool], rename: dict[str, str] | None = None
) -> Path:
    """A rosbag2 with some of the topics, some under another name."""
    store = store_with_detections(False)
    with rosbags.rosbag2.Writer(folder / "part", version=9) as bag:
        made: dict[str, Any] = {}
        for t, topic, kind, message in messages(run, store, shape):
            name = (rename or {}).get(topic, topic)
            if keep(topic):
                if name not in made:
                    made[name] = bag.add_connection(name, kind, typestore=store)
                bag.write(made[name], round(t * 1e9), store.serialize_cdr(message, kind))
    return folder / "part"


def no_joint_states(run: Run, folder: Path) -> list[str]:
    return ["--joints", str(bag_of(run, folder, stamped_point, lambda topic: topic != "/joint_states"))]


def no_points(run: Run, folder: Path) -> list[str]:
    return ["--joints", str(bag_of(run, folder, stamped_point, lambda topic: topic != "/tracker/target"))]


def own_poses_only(run: Run, folder: Path) -> list[str]:
    renamed = {"/tracker/target": "/tcp_pose_broadcaster/pose"}
    return ["--joints", str(bag_of(run, folder, stamped_pose, lambda _: True, renamed))]


def no_stillness(run: Run, folder: Path) -> list[str]:
    t = np.arange(0.0, 120.0, 0.02)
    q = np.sin(np.outer(t, [0.5, 0.61, 0.73, 0.87, 0.93, 1.07]) + np.arange(6))
    rows = np.column_stack([t, q, q[:, :3] * 500.0]).tolist()
    names = ["time_s", *(f"q{k}_rad" for k in range(1, 7)), "x_mm", "y_mm", "z_mm"]
    return ["--joints", str(write_csv(folder / "log.csv", names, rows))]


def no_motion(run: Run, folder: Path) -> list[str]:
    t = np.arange(0.0, 60.0, 0.02)
    q = np.random.default_rng(0).normal(0.3, 1e-4, (len(t), 9))
    names = ["time_s", *(f"q{k}_rad" for k in range(1, 7)), "x_mm", "y_mm", "z_mm"]
    return ["--joints", str(write_csv(folder / "log.csv", names, np.column_stack([t, q]).tolist()))]


def other_joints(run: Run, folder: Path) -> list[str]:
    names = {name: f"left_arm_{'abcdef'[k]}" for k, name in enumerate(NAMES)}
    rows = [{"time": t, **dict(zip(names.values(), q, strict=True))} for t, q in zip(run.joint_s, run.q, strict=True)]
    (folder / "joints.json").write_text(json.dumps(rows))
    return ["--joints", str(folder / "joints.json")]


def damaged(run: Run, folder: Path) -> list[str]:
    path = Path(ros1_bag(stamped_point)(run, folder)[1])
    path.write_bytes(path.read_bytes()[:5000])
    return ["--joints", str(path)]


def another_run(run: Run, folder: Path) -> list[str]:
    other = recorded_run(np.random.default_rng(77), 12)
    return ["--joints", str(joints_csv(run, folder)), "--points", str(points_csv(other, folder))]


def motions_that_repeat(run: Run, folder: Path) -> list[str]:
    alike = recorded_run(np.random.default_rng(4), 24, regular=True)
    return ["--joints", str(joints_csv(alike, folder)), "--points", str(points_csv(alike, folder))]


def two_sources(run: Run, folder: Path) -> list[str]:
    names = ["time_s", *(f"q{k}_rad" for k in range(1, 7)), *(f"{s}_{a}_mm" for s in ("smr", "hand") for a in "xyz")]
    rows = together(run, [run.joint_s, *run.q.T], [*run.xyz_mm.T, *(run.xyz_mm.T + 30.0)])
    return ["--joints", str(write_csv(folder / "log.csv", names, rows))]


def normalised(run: Run, folder: Path) -> list[str]:
    low, high = run.q.min(axis=0), run.q.max(axis=0)
    scaled = 200.0 * (run.q - low) / (high - low) - 100.0
    rows = np.array(together(run, [run.joint_s, *scaled.T], list(run.xyz_mm.T)))
    table = {
        "observation.state": pa.array(rows[:, 1:7].tolist()),
        "tracker": pa.array(rows[:, 7:].tolist()),
        "timestamp": rows[:, 0],
    }
    pq.write_table(pa.table(table), folder / "episode.parquet")
    return ["--joints", str(folder / "episode.parquet")]


def no_time(run: Run, folder: Path) -> list[str]:
    pq.write_table(pa.table({f"q{k + 1}_rad": run.q[:, k] for k in range(6)}), folder / "log.parquet")
    return ["--joints", str(folder / "log.parquet")]


REFUSED: dict[str, tuple[Callable[[Run, Path], list[str]], tuple[str, ...]]] = {
    "no joint states": (no_joint_states, ("holds no joint states", "/tracker/target", "shoulder_pan_joint")),
    "no points": (no_points, ("holds no measured points", "/camera/image/compressed (sensor_msgs/msg/CompressedImage")),
    "the controller's own poses": (own_poses_only, ("only poses that are named as the controller's own", "--points")),
    "no stillness": (no_stillness, ("does not stand still", "let the arm stop")),
    "no motion": (no_motion, ("no joint moves in these 59.98 s",)),
    "other joints": (other_joints, ("6 joints are needed", "shoulder_lift_joint")),
    "damaged": (damaged, ("run.bag: cannot be read as a bag of ROS",)),
    "another run": (another_run, ("its motion is not that of",)),
    "motions that repeat": (motions_that_repeat, ("is ambiguous", "begin with a motion that comes once")),
    "two sources": (two_sources, ("several sources of points, smr, hand", "log.csv#smr")),
    "normalised states": (normalised, ("observation.state_q1", "is not told", "--map")),
    "no time": (no_time, ("no column of time", "q1_rad")),
}


SLOW = ("the controller's own poses", "damaged", "no joint states", "no motion")


@pytest.mark.parametrize("case", [pytest.param(c, marks=pytest.mark.thorough if c in SLOW else []) for c in REFUSED])
def test_a_recording_that_cannot_be_used_is_refused_in_one_sentence(
    case: str, run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make, says = REFUSED[case]
    code, out, err = imported(tmp_path, make(run, tmp_path), capsys)
    assert code == 2
    assert not out
    errors = [line for line in err.splitlines() if not line.startswith("inspector: warning: ")]
    assert len(errors) == 1
    for words in says:
        assert words in errors[0]
    assert "internal error" not in err
    assert not (tmp_path / "made").exists()


@pytest.mark.thorough
def test_a_damaged_bag_is_read_or_told_in_one_line(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(0)
    for make, name in ((ros1_bag(stamped_point), "run.bag"), (mcap_of_ros2, "run.mcap")):
        make(run, tmp_path)
        whole = bytearray((tmp_path / name).read_bytes())
        for _ in range(6):
            content = bytearray(whole)
            for at in rng.integers(0, len(content), 40):
                content[at] = rng.integers(256)
            (tmp_path / name).write_bytes(content)
            code, _, err = imported(tmp_path, ["--joints", str(tmp_path / name), "--dry-run"], capsys)
            assert code in (0, 1)
            assert "internal error" not in err


@pytest.mark.thorough
def test_what_was_named_is_taken(run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of two reflectors one is named, and a pose of the controller, where it is asked for, with a doubt."""
    log = two_sources(run, tmp_path)[1]
    code, _, _ = imported(tmp_path, ["--joints", log, "--points", f"{log}#hand"], capsys)
    assert code == 0
    made = load_dataset(tmp_path / "made")
    assert made.points is not None
    stops = [int(np.argmin(np.abs(run.stops_q - q).max(axis=1))) for q in made.poses.q]
    assert np.abs(made.points.xyz_mm - 30.0 - run.stops_mm[stops]).max() < 0.1
    (tmp_path / "bag").mkdir()
    bag = own_poses_only(run, tmp_path / "bag")[1]
    code, _, err = imported(
        tmp_path / "bag", ["--joints", bag, "--points", f"{bag}#/tcp_pose_broadcaster/pose"], capsys
    )
    assert code == 0
    assert "named as a pose that the controller computes" in err


def test_a_table_of_poses_with_times_stays_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.5, 1.5, (60, 6))
    rows = np.column_stack([np.arange(60) * 12.0, q, np.zeros((60, 3))])
    rows[:, 7:] = tool_mm(q)
    names = ["time_s", *(f"q{k}_rad" for k in range(1, 7)), "x_mm", "y_mm", "z_mm"]
    code, out, _ = imported(tmp_path, ["--joints", str(write_csv(tmp_path / "t.csv", names, rows.tolist()))], capsys)
    assert code == 0
    assert "stands" not in out
    assert len(load_dataset(tmp_path / "made").poses) == 60
    rows[:, 0] /= 100.0  # as a simulation numbers its poses
    table = str(write_csv(tmp_path / "t.csv", names, rows.tolist()))
    (tmp_path / "fast").mkdir()
    code, _, err = imported(tmp_path / "fast", ["--joints", table], capsys)
    assert code == 2
    assert "where its rows are poses, say so by --map" in err
    code, _, _ = imported(tmp_path / "fast", ["--joints", table, "--map", "time_s=ignore"], capsys)
    assert code == 0
    assert len(load_dataset(tmp_path / "fast" / "made").poses) == 60


def test_recordings_are_known_in_a_folder(run: Run, tmp_path: Path) -> None:
    ros2_bag(stamped_point, "sqlite3")(run, tmp_path)
    (tmp_path / "other").mkdir()
    flat_parquet(run, tmp_path / "other")
    lerobot(run, tmp_path)
    kinds = {file.path.name: file.kind for file in look_through(tmp_path).files}
    assert kinds == {"run": BOTH, "lerobot": BOTH, "joints.parquet": JOINTS, "points.parquet": POINTS}
