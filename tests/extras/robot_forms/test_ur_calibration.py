"""UR controllers' calibrations, compared with the controller's own table in extended precision."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.extras.robot_forms.ur_calibration import MODELS, nominal_rows
from calib.kinematics.robot import FixedFrame
from calib.robot_formats.chain.five_parameters import frames_at_zero
from calib.robot_formats.chain.serial_chain import RobotFileError
from calib.robot_formats.robot_file import ReadOptions, read_robot
from tests.support.robot_texts import DELTAS, FAR_DELTAS, UR10_CONF, conf_of
from tests.support.standard_dh import exactly, joints_at_random, standard, tips


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_ur_calibration_is_the_controllers_arm_with_small_numbers(tmp_path: Path, number: int) -> None:
    deltas = [DELTAS, *FAR_DELTAS][number]
    path = tmp_path / "calibration.conf"
    path.write_text(conf_of(deltas))
    found = read_robot(path, ReadOptions(model="ur10"))
    added = np.column_stack([deltas[f"delta_{key}"] for key in ("theta", "a", "d", "alpha")])
    rows = nominal_rows("ur10") + added * [1, 1e3, 1e3, 1]
    q = joints_at_random(1000, 6)
    theirs = np.array([exactly(rows, values) for values in q])
    assert np.abs(tips(found.robot, q) - theirs)[:, :3, 3].max() < 1e-9
    assert np.abs(tips(found.robot, q) - theirs)[:, :3, :3].max() < 1e-12
    nominal = [standard(nominal_rows("ur10")[:k], np.zeros(k)) for k in range(1, 7)]
    frames = frames_at_zero(found.robot)[1:-1]
    assert max(np.linalg.norm(a[:3, 3] - b[:3, 3]) for a, b in zip(frames[:5], nominal[:5], strict=True)) < 5.0
    assert np.abs(found.robot.table[:, [0, 2]]).max() < 700.0
    assert f"d of {np.abs(rows[:, 2]).max() / 1e3:.4g} m" in found.summary
    assert found.robot.base == FixedFrame()


def test_a_ur_calibration_needs_its_arms_model(tmp_path: Path) -> None:
    path = tmp_path / "calibration.conf"
    path.write_text(conf_of(FAR_DELTAS[0]))
    with pytest.raises(RobotFileError, match="give --model, one of ur3, ur5"):
        read_robot(path)
    with pytest.raises(RobotFileError, match="--model kuka is not known"):
        read_robot(path, ReadOptions(model="kuka"))
    with pytest.raises(RobotFileError, match="read as of a ur5, a joint is 178 mm from its nominal place"):
        read_robot(path, ReadOptions(model="ur5"))
    assert len(MODELS) == 11


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("0.00065609212979853, ", "", "line 6: delta_d: found .* a list of six numbers"),
        ("0.00065609212979853", "nan", "line 6: delta_d"),
        ("delta_a = ", "delta_b = ", r"section \[mounting\] has no delta_a"),
        ("delta_alpha", "delta_a", "line 7: delta_a stands there twice"),
        ("[mounting]", "[mouting]", "has no delta_theta, delta_a, delta_d, delta_alpha"),
    ],
)
def test_a_damaged_calibration_is_told_with_its_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = tmp_path / "calibration.conf"
    path.write_text(UR10_CONF.replace(old, new, 1))
    with pytest.raises(RobotFileError, match=said):
        read_robot(path, ReadOptions(model="ur10"))
