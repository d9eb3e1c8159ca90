"""`inspector where`: frames of an arm in every form, and the difference of told poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calib import load_robot
from tests.support.arms import elementary_frames
from tests.support.chains import shoulder_arm
from tests.support.commands import answered, printed, refused

TURN = Rotation.from_euler("xyz", [-90.0, 0.0, -90.0], degrees=True)
FLANGE = Rotation.from_euler("xyz", [12.0, 43.0, -75.0], degrees=True)


def told(path: Path, pendant: np.ndarray) -> Path:
    rpy = ",".join(map(repr, FLANGE.as_euler("xyz", degrees=True).tolist()))
    path.write_text(
        f"what,x,y,z,a,b,c,unit\ntf rpy,0.3,-0.2,0.6,{rpy},m deg\n"
        f"pendant rotation vector,301.5,-200,601,{','.join(map(repr, pendant.tolist()))},mm deg\n"
    )
    return path


def test_two_told_poses_differ_by_the_turn_between_two_names_of_one_flange(tmp_path: Path) -> None:
    found = answered("where", told(tmp_path / "a.csv", (FLANGE * TURN).as_rotvec(degrees=True)))["difference"]
    assert found["as_told"]
    np.testing.assert_allclose(found["shift_mm"], [1.5, 0.0, 1.0], atol=1e-9)
    turned = Rotation.from_euler("xyz", found["quarter_turn_rpy_deg"], degrees=True)
    assert (turned.inv() * TURN).magnitude() < 1e-9
    # Numbers that are said to be a rotation vector, and are turns about fixed axes.
    path = told(tmp_path / "b.csv", (FLANGE * TURN).as_euler("xyz", degrees=True))
    other = answered("where", path)["difference"]
    assert not other["as_told"]
    np.testing.assert_allclose(other["rotation_vector_deg"], found["rotation_vector_deg"], atol=1e-6)
    assert "the arm's own calibration is in one of both" in printed("where", path)
    # Without a turn by quarters nothing is read otherwise.
    found = answered("where", told(tmp_path / "c.csv", np.array([20.0, -50.0, 33.0])))["difference"]
    assert found["as_told"]
    assert found["from_quarter_turn_deg"] > 1.0


def test_frames_of_a_table_are_those_of_other_kinematics() -> None:
    q_deg = [10.0, -80.0, 70.0, 20.0, 60.0, -15.0]
    document = answered("where", "rb5", f"--joints={','.join(map(str, q_deg))}", "--frame", "J3")
    frames = elementary_frames(load_robot("rb5"), np.radians([q_deg]))[0]
    by_name = {one["frame"]: one for one in document["frames"]}
    np.testing.assert_allclose(by_name["tool"]["matrix"], frames[-1], atol=1e-9)
    third = Rotation.from_matrix(np.array(by_name["J3"]["matrix"])[:3, :3])
    for key, again in {
        "rotation_vector_deg": Rotation.from_rotvec(by_name["J3"]["rotation_vector_deg"], degrees=True),
        "rpy_deg": Rotation.from_euler("xyz", by_name["J3"]["rpy_deg"], degrees=True),
        "abc_deg": Rotation.from_euler("ZYX", by_name["J3"]["abc_deg"], degrees=True),
        "quaternion_wxyz": Rotation.from_quat(np.roll(by_name["J3"]["quaternion_wxyz"], -1)),
    }.items():
        assert (third.inv() * again).magnitude() < 1e-7, key


def test_the_links_of_a_urdf_are_named_and_a_wrong_frame_is_answered_with_them(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(shoulder_arm())
    robot = load_robot(path, tip="tool0")
    joints = f"--joints={','.join(['0'] * robot.n_joints)}"
    document = answered("where", path, joints, "--tip", "tool0")
    assert [document["frames"][k]["frame"] for k in (0, -1)] == ["world", "tool0"]
    assert document["frames"][0]["xyz_mm"] == [0.0, 0.0, 0.0]
    assert "there is no such frame; there are world, " in refused(
        "where", path, joints, "--tip", "tool0", "--frame", "toll0"
    )
    assert "has 2 numbers" in refused("where", path, "--joints=1,2", "--tip", "tool0")
