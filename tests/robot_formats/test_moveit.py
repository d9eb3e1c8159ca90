"""Base, tip and limits of an arm from MoveIt's files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.robot_formats.chain.serial_chain import RobotFileError
from calib.robot_formats.robot_file import ReadOptions, RobotFile, read_robot
from tests.support.chains import shoulder_arm

SRDF = """<robot name="arm">
<group name="arm"><chain base_link="base_link" tip_link="tool0"/></group>
<group name="upper"><joint name="lift"/><joint name="elbow"/></group>
<group name="hand"><link name="nowhere"/></group>
<group name="both"><group name="arm"/></group>
</robot>"""
LIMITS = """joint_limits:
  pan:
    has_position_limits: true
    min_position: !degrees -100.0
    max_position: 1.5
  lift: {has_velocity_limits: true, max_velocity: 2.0}
  slide:
    max_position: 0.25
  elbow:
    has_position_limits: false
    max_position: 0.1
  other: {max_position: 1}
"""


def found(folder: Path, srdf: str | None = None, limits: str | None = None) -> RobotFile:
    (folder / "arm.urdf").write_text(shoulder_arm())
    (folder / "moveit.srdf").write_text(SRDF)
    (folder / "limits.yaml").write_text(limits or LIMITS)
    named = None if srdf is None else f"{folder / 'moveit.srdf'}{srdf}"
    return read_robot(
        folder / "arm.urdf",
        ReadOptions(
            None if srdf is not None else "tool0", srdf=named, joint_limits=folder / "limits.yaml" if limits else None
        ),
    )


def test_a_group_tells_base_and_tip(tmp_path: Path) -> None:
    arm = found(tmp_path, "#arm")
    assert arm.chain is not None
    assert (arm.chain.base, arm.chain.tip) == ("base_link", "tool0")
    assert arm.notes[0] == "base and tip are those of the group arm of moveit.srdf"
    assert [joint.name for joint in found(tmp_path, "#upper").robot.joints] == ["lift", "elbow"]
    for wrong in ("", "#hand", "#both"):
        with pytest.raises(RobotFileError, match=r"moveit\.srdf: line 1: .*--srdf FILE#GROUP \(arm, upper\)"):
            found(tmp_path, wrong)


def test_an_srdf_beside_its_urdf_is_found_where_the_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(shoulder_arm())
    (tmp_path / "arm.srdf").write_text("\n".join(line for line in SRDF.splitlines() if "upper" not in line))
    assert read_robot(tmp_path / "arm.urdf", ReadOptions(packages={})).robot.n_joints == 5
    with pytest.raises(RobotFileError, match="several tips"):
        read_robot(tmp_path / "arm.urdf")


def test_limits_replace_those_of_the_urdf(tmp_path: Path) -> None:
    plain = found(tmp_path).robot
    arm = found(tmp_path, limits=LIMITS)
    limits = {joint.name: (joint.min, joint.max) for joint in arm.robot.joints}
    before = {joint.name: (joint.min, joint.max) for joint in plain.joints}
    np.testing.assert_allclose(limits["pan"], [np.radians(-100.0), 1.5])
    assert limits["slide"] == (before["slide"][0], pytest.approx(250.0))
    assert {name: limits[name] for name in ("lift", "elbow", "roll")} == {
        name: before[name] for name in ("lift", "elbow", "roll")
    }
    assert "limits of pan, slide are those of limits.yaml" in arm.notes
    with pytest.raises(RobotFileError, match=r"limits\.yaml: line 1: found none of the arm's joints"):
        found(tmp_path, limits="joint_limits:\n  a:\n    max_position: 1\n")
    with pytest.raises(RobotFileError, match=r"limits\.yaml: line 2: pan is from 2 to"):
        found(tmp_path, limits="joint_limits:\n  pan:\n    min_position: 2\n    max_position: 1\n")
