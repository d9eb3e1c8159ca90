"""Cartesian poses of the flange in place of joints: every maker's way of writing them, and the camera's place."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import load_dataset
from inspector.cli.parser import main
from tests.extras.camera.marker_poses import write_marker_poses
from tests.support.camera_scene import Scene, transform

R = Rotation
FORMS = {  # header, numbers of the attitude, mm in a unit of length
    "kuka": ("X,Y,Z,A,B,C", lambda r: r.as_euler("ZYX", degrees=True), 1.0),
    "staubli": ("x,y,z,rx,ry,rz", lambda r: r.as_euler("XYZ", degrees=True), 1.0),
    "kawasaki": ("x,y,z,o,a,t", lambda r: r.as_euler("ZYZ", degrees=True), 1.0),
    "ur": (",".join(f"actual_TCP_pose_{k}" for k in range(6)), lambda r: r.as_rotvec(), 1e3),
    "abb": ("x,y,z,q1,q2,q3,q4", lambda r: np.roll(r.as_quat(), 1, axis=1), 1.0),
    "ros": ("tool_x,tool_y,tool_z,tool_qx,tool_qy,tool_qz,tool_qw", lambda r: r.as_quat(), 1e3),
    "no header": ("", lambda r: r.as_euler("xyz", degrees=True), 1.0),
    "no header, quaternions": ("", lambda r: r.as_quat(), 1e3),
}


@pytest.fixture(scope="module")
def cells(tmp_path_factory):
    made = []
    for on_flange in (True, False):
        rng = np.random.default_rng(6)
        scene = Scene.draw(rng, on_flange=on_flange, poses=14, link_mm=0.1, link_deg=0.01)
        path = tmp_path_factory.mktemp("cell") / "marker.csv"
        made.append((scene, write_marker_poses(scene, path, rng, sigma_mm=0.1, sigma_deg=0.02)))
    return made


def _write(path, header, columns):
    path.write_text("\n".join(filter(None, [header, *(",".join(map(repr, row)) for row in columns.tolist())])) + "\n")
    return path


def _camera_error_mm(out, scene, capsys) -> tuple[float, float]:
    capsys.readouterr()
    assert main(["calibrate", str(out), "--json"]) == 0
    (place,) = json.loads(capsys.readouterr().out)["hand_eye"]
    error = np.array(place["parent_T_camera"])[:3, 3] - scene.parent_T_camera[:3, 3]
    return float(np.linalg.norm(error)), float(np.linalg.norm(place["sigma_mm"]))


@pytest.mark.parametrize("form", FORMS)
def test_the_way_of_writing_attitudes_is_found_from_what_the_camera_saw(cells, tmp_path, capsys, form):
    scene, marker = cells[list(FORMS).index(form) % 2]
    header, attitude, unit_mm = FORMS[form]
    poses = scene.flanges()
    numbers = np.column_stack([poses[:, :3, 3] / unit_mm, attitude(R.from_matrix(poses[:, :3, :3]))])
    path = _write(tmp_path / "poses.csv", header, numbers)
    out = tmp_path / "out"
    # a table with a header may stand in place of joint values, with or without a robot; one without is named
    given = ["--joints" if header else "--flange-poses", str(path), *(["--robot", "rb5"] if form == "kuka" else [])]
    assert main(["import", str(out), *given, "--marker-poses", str(marker)]) == 0
    said = capsys.readouterr()
    assert f"the camera is {'on the flange' if scene.on_flange else 'in the room'}" in said.out
    assert ("nothing of its links" in said.err) == (form == "kuka")
    off_mm, sigma_mm = _camera_error_mm(out, scene, capsys)
    assert off_mm < 3.0 * sigma_mm < 2.5


@pytest.mark.parametrize(("tool", "mount"), [("easy_handeye", 0), ("easy_handeye", 1), ("moveit", 1), ("opencv", 0)])
def test_samples_of_hand_eye_tools_hold_both_poses(cells, tmp_path, capsys, tool, mount):
    scene, _ = cells[mount]
    flange, marker = scene.flanges(), scene.camera_T_board

    def message(pose):
        turn = R.from_matrix(pose[:3, :3]).as_quat().tolist()
        shift = dict(zip("xyz", (pose[:3, 3] / 1e3).tolist(), strict=True))
        return {"translation": shift, "rotation": dict(zip("xyzw", turn, strict=True))}

    def matrix(pose):
        scaled = pose.copy()
        scaled[:3, 3] /= 1e3
        return scaled.ravel().tolist()

    more = []
    if tool == "easy_handeye":  # which inverts the arm's poses where the camera stands in the room
        robot = flange if scene.on_flange else np.linalg.inv(flange)
        samples = [{"robot": message(a), "optical": message(b)} for a, b in zip(robot, marker, strict=True)]
        more = [] if scene.on_flange else ["--mount", "room"]
    elif tool == "moveit":
        pairs = zip(flange, marker, strict=True)
        samples = [{"effector_wrt_world": matrix(a), "object_wrt_sensor": matrix(b)} for a, b in pairs]
    else:
        samples = {
            "R_gripper2base": flange[:, :3, :3].tolist(), "t_gripper2base": flange[:, :3, 3].tolist(),
            "R_target2cam": marker[:, :3, :3].tolist(), "t_target2cam": marker[:, :3, 3].tolist(),
        }  # fmt: skip
    path = tmp_path / "samples.json"
    path.write_text(json.dumps(samples))
    assert main(["import", str(tmp_path / "out"), "--marker-poses", str(path), *more]) == 0
    assert ("give --mount room if it does" in capsys.readouterr().err) == (tool == "easy_handeye" and not more)
    assert _camera_error_mm(tmp_path / "out", scene, capsys)[0] < 0.5


@pytest.mark.thorough
def test_poses_of_the_flange_have_no_links_to_correct(cells, tmp_path, capsys):
    scene, marker = cells[0]
    poses = scene.flanges()
    turned = R.from_matrix(poses[:, :3, :3]).as_rotvec()
    path = _write(
        tmp_path / "poses.csv", "x_mm,y_mm,z_mm,rx_rad,ry_rad,rz_rad", np.column_stack([poses[:, :3, 3], turned])
    )
    out = tmp_path / "out"
    assert main(["import", str(out), "--flange-poses", str(path), "--marker-poses", str(marker)]) == 0
    assert main(["check", str(out)]) == 0
    assert "passed" in capsys.readouterr().out
    for words in (["redundancy", str(out)], ["calibrate", str(out), "--out", str(tmp_path / "robot.toml")]):
        assert main(words) == 2
        assert "needs the arm's links" in capsys.readouterr().err
    assert main(["diagnose", str(out), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["missing"] == []
    assert {"joint_compliance", "backlash"} <= {one["effect"] for one in document["untestable"]}


def test_noisy_poses_with_a_mount_that_is_given_are_no_question_of_their_attitudes(tmp_path, capsys):
    """With columns named qx ... qw it was: "name the columns rvec_x ... or qw, qx, qy, qz"."""
    rng = np.random.default_rng(8)
    scene = Scene.draw(rng, on_flange=True, poses=30)
    turns, shifts_mm = (
        R.from_rotvec(0.02 * rng.normal(size=(30, 3))),
        [500.0, 0.0, 400.0] + 15.0 * rng.normal(size=(30, 3)),
    )
    poses = np.array([transform(turn, at) for turn, at in zip(turns, shifts_mm, strict=True)])
    board = poses[0] @ scene.parent_T_camera @ scene.camera_T_board[0]
    scene = replace(scene, camera_T_board=np.linalg.inv(poses @ scene.parent_T_camera) @ board)
    marker = write_marker_poses(scene, tmp_path / "marker.csv", rng, sigma_mm=8.0, sigma_deg=1.0)
    numbers = np.column_stack([poses[:, :3, 3], turns.as_quat()])
    path = _write(tmp_path / "poses.csv", "x_mm,y_mm,z_mm,qx,qy,qz,qw", numbers)
    given = ["--flange-poses", str(path), "--marker-poses", str(marker), "--mount", "flange"]
    assert main(["import", str(tmp_path / "out"), *given]) == 0
    assert not load_dataset(tmp_path / "out").poses.is_test.any()  # both places are nearest by all poses
    off_mm, sigma_mm = _camera_error_mm(tmp_path / "out", scene, capsys)
    assert off_mm < 3.0 * sigma_mm
    assert main(["diagnose", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert not any(words in told for words in ("do not use it", "error rose", "--out robot.toml"))  # of an arm's table


def test_attitudes_that_agree_with_nothing_are_refused(cells, tmp_path, capsys):
    scene, marker = cells[1]
    poses = scene.flanges()[::-1]  # images and poses of different runs
    numbers = np.column_stack([poses[:, :3, 3], R.from_matrix(poses[:, :3, :3]).as_euler("xyz", degrees=True)])
    path = _write(tmp_path / "poses.csv", "", numbers)
    assert main(["import", str(tmp_path / "out"), "--flange-poses", str(path), "--marker-poses", str(marker)]) == 2
    assert "of one run" in capsys.readouterr().err
    assert main(["import", str(tmp_path / "out"), "--marker-poses", str(marker)]) == 2
    assert "--flange-poses FILE" in capsys.readouterr().err
    path = _write(tmp_path / "short.csv", "x,y", numbers[:, :2])
    assert main(["import", str(tmp_path / "out"), "--flange-poses", str(path), "--marker-poses", str(marker)]) == 2
    assert "poses of the flange are x, y, z with" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
