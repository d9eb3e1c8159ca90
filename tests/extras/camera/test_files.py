"""Boards, lenses and marker poses in the forms that people and other programs write them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from calib import load_dataset, write_dataset
from calib.errors import CalibError
from calib.extras.camera.board import board_of
from calib.extras.camera.importing.intrinsics import load_lens
from calib.extras.camera.importing.pose_files import marker_poses
from calib.extras.camera.observed import camera_of
from calib.extras.camera.static_transform import StaticTransform, transform_text
from tests.extras.camera.camera_dataset import simulated_dataset, true_lens
from tests.support.camera_scene import MATRIX, SIZE_PX, Scene

ROS = """image_width: 1280
image_height: 960
camera_name: cam
camera_matrix: {rows: 3, cols: 3, data: [1150.0, 0.0, 630.0, 0.0, 1146.0, 492.0, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.11, 0.07, 0.0008, -0.0005, 0.01]}
"""
NUMBERS = (1150.0, 1146.0, 630.0, 492.0, -0.11, 0.07, 0.0008, -0.0005, 0.01)
BOARD = board_of("charuco:8x6:30:22")


def _write_lens(path: Path, distortion: np.ndarray) -> Path:
    """A lens as OpenCV's FileStorage writes it."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", SIZE_PX[0]), ("image_height", SIZE_PX[1]), ("camera_matrix", MATRIX)):
        storage.write(name, value)
    storage.write("distortion_coefficients", distortion)
    storage.release()
    return path


@pytest.mark.parametrize("suffix", [".yaml", ".yml", ".xml", ".json", "message.yaml"])
def test_lenses_of_ros_and_opencv_are_read(tmp_path, suffix):
    path = tmp_path / f"lens{suffix}"
    if suffix == ".yaml":
        path.write_text(ROS)
    elif suffix == "message.yaml":
        k = MATRIX.ravel().tolist()
        path.write_text(json.dumps({"height": 960, "width": 1280, "k": k, "d": list(NUMBERS[4:])}))
    else:
        _write_lens(path, np.array([NUMBERS[4:]]))
    lens = load_lens(path)
    assert (lens.width_px, lens.height_px) == (1280, 960)
    assert lens.numbers[:9] == pytest.approx(NUMBERS)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (ROS.replace("plumb_bob", "equidistant"), "distortion_model 'equidistant'"),
        (ROS.replace("1150.0", "1.15"), "are no lens of 1280 x 960 pixels"),
        ("image_width: 3\n", "no camera matrix"),
        ("a: &x [1]\nb: *x\n", "aliases"),
    ],
)
def test_a_file_that_is_no_lens_is_refused(tmp_path, text, says):
    path = tmp_path / "lens.yaml"
    path.write_text(text)
    with pytest.raises(CalibError, match="lens") as refused:
        load_lens(path)
    assert says in str(refused.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("charuco:8x6:30", "found 1 sizes"), ("charuco:8x6:22:30", "does not fit"), ("chess:8x6:30", "not written so"),
        ("charuco:8:30:22", "numbers of squares"), ("apriltag:6x6:40:0", "gap"), ("charuco:1x6:30:22", "along a side"),
    ],
)  # fmt: skip
def test_a_board_that_cannot_be_is_refused(text, says):
    with pytest.raises(CalibError, match="--board") as refused:
        board_of(text)
    assert says in str(refused.value)


def test_boards_lie_about_their_middle():
    for text, corners in (("charuco:8x6:30:22", 35), ("checkerboard:9x6:25", 40), ("apriltag:4x3:40:12", 48)):
        board = board_of(text)
        assert board.corners_mm.shape == (corners, 3)
        assert np.abs(board.corners_mm.mean(axis=0)).max() < 1e-9


POSE = np.array([0.1, -0.05, 0.4])
TURN = Rotation.from_euler("xyz", [170, 10, 30], degrees=True)


def _ros(shift, turn) -> str:
    x, y, z = shift.tolist()
    qx, qy, qz, qw = turn.as_quat().tolist()
    position = f"{{x: {x}, y: {y}, z: {z}}}"
    return position, f"{{x: {qx}, y: {qy}, z: {qz}, w: {qw}}}"


def _listed(form: str, position: str, rotation: str) -> str:
    """Two samples of one kind, with another pose in each where it is the arm's."""
    other = "robot: {translation: {x: 9, y: 9, z: 9}, rotation: {x: 0, y: 0, z: 0, w: 1}}"
    if form == "pose":
        return f"header: {{frame_id: camera}}\npose: {{position: {position}, orientation: {rotation}}}\n---\n" * 2
    one = f"{{translation: {position}, rotation: {rotation}}}"
    if form == "transform":
        return f"header: {{frame_id: camera}}\ntransform: {one}\n---\n" * 2
    name, above = ("optical", "") if form == "easy_handeye" else ("tracking", "samples:\n")
    return above + f"- {other}\n  {name}: {one}\n" * 2


@pytest.mark.parametrize("form", ["pose", "transform", "easy_handeye", "easy_handeye2", "opencv"])
def test_marker_poses_of_other_programs_are_read(tmp_path, form):
    path = tmp_path / "poses.yaml"
    if form == "opencv":
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        storage.write("rvecs", np.array([TURN.as_rotvec()] * 2))
        storage.write("tvecs", np.array([1000 * POSE] * 2))
        storage.release()
    else:
        path.write_text(_listed(form, *_ros(POSE, TURN)))
    (found,) = (read := marker_poses(path)).readings
    assert found.base_T_flange.shape == (2, 4, 4)
    assert found.base_T_flange[1, :3, 3] == pytest.approx(1000 * POSE)
    assert np.abs(found.base_T_flange[0, :3, :3] - TURN.as_matrix()).max() < 1e-9
    assert read.names == ()


@pytest.mark.parametrize(
    ("header", "vector"),
    [
        ("pose,x_mm,y_mm,z_mm,qx,qy,qz,qw", False), ("tx,ty,tz,rx,ry,rz", True), ("x,y,z,rotx,roty,rotz", True),
        ("tvec_x_m,tvec_y_m,tvec_z_m,rvec_x,rvec_y,rvec_z", True), ("", True), ("", False),
    ],
)  # fmt: skip
def test_a_table_of_marker_poses_is_read_in_every_way_in_which_it_may_be_meant(tmp_path, header, vector):
    path = tmp_path / "poses.csv"
    turn = TURN.as_rotvec() if vector else TURN.as_quat()
    places = (1000 if "mm" in header else 1) * (POSE + np.array([[0.0], [0.1]]))
    rows = [("a," if "pose" in header else "") + ",".join(map(repr, [*at, *turn.tolist()])) for at in places.tolist()]
    path.write_text("\n".join(filter(None, [header, *rows])))
    found = marker_poses(path)
    true = np.eye(4)
    true[:3, :3], true[:3, 3] = TURN.as_matrix(), 1000 * POSE
    assert min(np.abs(one.base_T_flange[0] - true).max() for one in found.readings) < 1e-9
    assert (["a", "a"] in found.names) == ("pose" in header)


def test_a_document_without_a_marker_names_what_it_has(tmp_path):
    path = tmp_path / "poses.yaml"
    path.write_text("things: [1, 2]\nmore: 3\n")
    with pytest.raises(CalibError, match="found things, more"):
        marker_poses(path)


def test_a_transform_is_written_for_ros_in_metres(tmp_path):
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = TURN.as_matrix(), 1000 * POSE
    text = transform_text(tmp_path / "a.yaml", [StaticTransform("tool0", "camera", transform, np.eye(6) * 1e-4)])
    document = yaml.safe_load(text)
    turn = [document["transform"]["rotation"][key] for key in "xyzw"]
    assert [document["transform"]["translation"][key] for key in "xyz"] == pytest.approx(POSE)
    assert np.abs(Rotation.from_quat(turn).as_matrix() - TURN.as_matrix()).max() < 1e-9
    assert document["header"]["frame_id"] == "tool0"
    assert np.array(document["covariance"]).reshape(6, 6)[0, 0] == pytest.approx(1e-10)


def test_a_frame_name_that_breaks_a_file_is_refused():
    with pytest.raises(CalibError, match="no name of a frame"):
        StaticTransform('tool0" x="', "camera", np.eye(4), np.eye(6))


@pytest.mark.parametrize("number", [*range(2, 12), None])
def test_a_lens_with_a_zero_is_kept(number, tmp_path):
    """A rectified image has no distortion, and its principal point may lie on the image's rim."""
    rng = np.random.default_rng(3)
    made = simulated_dataset(Scene.draw(rng, on_flange=True, poses=6), BOARD, rng, sigma_px=0.1, lens=true_lens())
    numbers = np.array(true_lens().numbers)
    numbers[slice(4, None) if number is None else number] = 0.0
    lens = replace(true_lens(), numbers=tuple(numbers.tolist()))
    views = replace(camera_of(made), lens=lens)
    write_dataset(replace(made, attachments={"camera": views}), tmp_path / "cell")
    assert camera_of(load_dataset(tmp_path / "cell")).lens == lens


@pytest.mark.parametrize(
    "told", ["{rows: 1, cols: 5, data: [0.0, 0.0, 0, 0, 0]}", "{rows: 0, cols: 0, data: []}", "[]", "0", "null"]
)
def test_a_camera_info_without_distortion_is_read(told, tmp_path):
    path = tmp_path / "lens.yaml"
    path.write_text(ROS.partition("distortion_coefficients")[0] + f"distortion_coefficients: {told}\n")
    assert load_lens(path).numbers == (*NUMBERS[:4], *[0.0] * 8)
