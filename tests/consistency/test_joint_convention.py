"""Conventions of joint columns that sheets of four-axis arms have, recovered by another code's kinematics."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.consistency.joint_convention import joint_convention
from calib.dataset_import.reading import moving_joints
from calib.text_files.user_table import load_table
from tests.support.arms import elementary_points, perturbed
from tests.support.wrong_sheets import ARMS


def test_a_scaras_screw_and_its_last_angle_from_the_base_are_found() -> None:
    rng = np.random.default_rng(3)
    arm = ARMS["scara"]
    q = rng.uniform([-2.0, -2.0, 0.0, -3.0], [2.0, 2.0, 200.0, 3.0], (20, 4))
    points = elementary_points(perturbed(arm, rng, mm=0.1, rad=1e-4), q) + rng.normal(0.0, 0.03, (20, 3))
    screwed = q.copy()
    screwed[:, 2] -= 20.0 / (2.0 * np.pi) * q[:, 3]
    (found,) = joint_convention(arm, screwed, points).readings
    assert np.abs(found.of(screwed) - q)[:, 2].max() < 0.2
    from_base = q.copy()
    from_base[:, 3] += q[:, 0] + q[:, 1]
    (found,) = joint_convention(arm, from_base, points).readings
    assert np.abs(found.of(from_base) - q).max() < 1e-12


def test_columns_of_joints_that_stand_still_or_follow_others_are_none_of_the_arm(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    q = rng.uniform(-90.0, 90.0, (12, 4)).round(3)
    six = np.column_stack([q[:, :3], np.zeros(12), 90.0 - q[:, 1] - q[:, 2], q[:, 3]])
    path = tmp_path / "palletiser.csv"
    path.write_text("\n".join(["J1,J2,J3,J4,J5,J6", *(",".join(map(repr, row)) for row in six.tolist())]))
    assert moving_joints(load_table(path, print), ARMS["scara"]) == ["J1", "J2", "J3", "J6"]
