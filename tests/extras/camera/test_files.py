"""Boards, lenses and marker poses in the forms that people and other programs write them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import load_dataset, write_dataset
from calib.errors import CalibError
from calib.extras.camera.board import board_of
from calib.extras.camera.importing.intrinsics import load_lens
from calib.extras.camera.importing.marker_poses import load_marker_poses
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
        ("- 1\n", "holds no lens"),
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
        ("charuco:8x6:30", "found 1 sizes"), ("charuco:8x6:22:30", "does not fit"), ("chess:8x6:30", "no kind"),
        ("charuco:8:30:22", "numbers of squares"), ("apriltag:6x6:40:0", "gap"), ("checkerboard:9x6:x", "no size"),
        ("charuco:1x6:30:22", "along a side"),
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


@pytest.mark.parametrize("form", ["pose", "transform", "easy_handeye", "easy_handeye2", "csv", "rvec.csv", "opencv"])
def test_marker_poses_of_other_programs_are_read(tmp_path, form):
    position, rotation = _ros(POSE, TURN)
    path, unit = tmp_path / f"poses{'.csv' if 'csv' in form else '.yaml'}", None
    if form == "pose":
        one = f"header: {{frame_id: camera}}\npose:\n  position: {position}\n  orientation: {rotation}\n"
        path.write_text(one + "---\n" + one)
    elif form == "transform":
        one = f"header: {{frame_id: camera}}\ntransform:\n  translation: {position}\n  rotation: {rotation}\n"
        path.write_text(one + "---\n" + one)
    elif form == "easy_handeye":
        other = "{translation: {x: 9, y: 9, z: 9}, rotation: {x: 0, y: 0, z: 0, w: 1}}"
        path.write_text(f"- robot: {other}\n  optical: {{translation: {position}, rotation: {rotation}}}\n" * 2)
    elif form == "easy_handeye2":
        other = "{translation: {x: 9, y: 9, z: 9}, rotation: {x: 0, y: 0, z: 0, w: 1}}"
        one = f"- robot: {other}\n  tracking: {{translation: {position}, rotation: {rotation}}}\n"
        path.write_text("samples:\n" + one * 2)
    elif form == "csv":
        row = ",".join(map(repr, [*(1000 * POSE).tolist(), *TURN.as_quat().tolist()]))
        path.write_text(f"pose,x_mm,y_mm,z_mm,qx,qy,qz,qw\na,{row}\nb,{row}\n")
    elif form == "rvec.csv":
        row, unit = ",".join(map(repr, [*POSE.tolist(), *TURN.as_rotvec().tolist()])), "m"
        path.write_text(f"tx,ty,tz,rx,ry,rz\n{row}\n{row}\n")
    else:
        unit = "m"
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        storage.write("rvecs", np.array([TURN.as_rotvec()] * 2))
        storage.write("tvecs", np.array([POSE] * 2))
        storage.release()
    found = load_marker_poses(path, unit)
    assert found.camera_T_marker.shape == (2, 4, 4)
    assert found.camera_T_marker[1, :3, 3] == pytest.approx(1000 * POSE)
    assert np.abs(found.camera_T_marker[0, :3, :3] - TURN.as_matrix()).max() < 1e-9
    assert found.names == (("a", "b") if form == "csv" else None)


@pytest.mark.parametrize(
    "header",
    [
        "tvec_x_m,tvec_y_m,tvec_z_m,rvec_x,rvec_y,rvec_z", "x_m,y_m,z_m,rotx,roty,rotz", "tx_m,ty_m,tz_m,rx,ry,rz",
    ],
)  # fmt: skip
def test_the_place_of_a_marker_is_not_taken_for_its_turn(tmp_path, header):
    path = tmp_path / "poses.csv"
    path.write_text(f"{header}\n{','.join(map(repr, [*POSE.tolist(), *TURN.as_rotvec().tolist()]))}\n")
    (found,) = load_marker_poses(path).camera_T_marker
    assert found[:3, 3] == pytest.approx(1000 * POSE)
    assert np.abs(found[:3, :3] - TURN.as_matrix()).max() < 1e-9


def test_lengths_without_a_unit_are_asked_for(tmp_path):
    path = tmp_path / "poses.json"
    path.write_text(json.dumps({"rvecs": [[0, 0, 1]], "tvecs": [[0, 0, 1]]}))
    with pytest.raises(CalibError, match="--length-unit"):
        load_marker_poses(path)


@pytest.mark.parametrize("name", ["a.yaml", "a.launch.py", "a.json"])
def test_a_transform_is_written_for_ros_in_metres(tmp_path, name):
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = TURN.as_matrix(), 1000 * POSE
    text = transform_text(tmp_path / name, [StaticTransform("tool0", "camera", transform, np.eye(6) * 1e-4)])
    if name.endswith("yaml"):
        import yaml

        document = yaml.safe_load(text)
        turn = [document["transform"]["rotation"][key] for key in "xyzw"]
        assert [document["transform"]["translation"][key] for key in "xyz"] == pytest.approx(POSE)
        assert np.abs(Rotation.from_quat(turn).as_matrix() - TURN.as_matrix()).max() < 1e-9
        assert document["header"]["frame_id"] == "tool0"
        assert np.array(document["covariance"]).reshape(6, 6)[0, 0] == pytest.approx(1e-10)
    elif name.endswith(".py"):
        compile(text, name, "exec")
        assert '"--frame-id", "tool0"' in text
    elif name.endswith("json"):
        assert json.loads(text)[0]["translation_m"] == pytest.approx(POSE)
    assert "0.1" in text
    assert "camera" in text


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


@pytest.mark.parametrize("suffix", [".yaml", ".xml", ".json"])
@pytest.mark.parametrize("distortion", [np.zeros((1, 5)), np.zeros((5, 1)), np.zeros((0, 0))])
def test_a_lens_file_without_distortion_is_read(suffix, distortion, tmp_path):
    path = _write_lens(tmp_path / f"lens{suffix}", distortion)
    assert load_lens(path).numbers == (*NUMBERS[:4], *[0.0] * 8)


@pytest.mark.parametrize(
    "told", ["{rows: 1, cols: 5, data: [0.0, 0.0, 0, 0, 0]}", "{rows: 0, cols: 0, data: []}", "[]", "0", "null"]
)
def test_a_camera_info_without_distortion_is_read(told, tmp_path):
    path = tmp_path / "lens.yaml"
    path.write_text(ROS.partition("distortion_coefficients")[0] + f"distortion_coefficients: {told}\n")
    assert load_lens(path).numbers == (*NUMBERS[:4], *[0.0] * 8)
