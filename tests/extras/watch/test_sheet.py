"""A table of check poses that is wrong is no change of the cell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate
from calib.extras.watch.watch import watch
from tests.support.wrong_sheets import simulated, turned, with_joints, with_points


@pytest.mark.slow
def test_a_sheet_of_check_poses_in_another_order_is_no_noise(tmp_path: Path) -> None:
    base = calibrate(simulated("rb5", 5, poses=64))
    new = simulated("rb5", 5, poses=64)
    assert new.points is not None
    some = np.arange(8)
    new = replace(new, poses=new.poses.select(some), points=new.points.select(np.isin(new.points.pose, some)))
    assert watch(base, new).data_problem is None
    order = np.random.default_rng(0).permutation(8)
    seen = watch(base, with_joints(new, new.poses.q[order]))
    assert [(change.what, change.unit) for change in seen.changes] == [("pose_order", "poses")]
    assert seen.verdict == "changed"
    assert "belong to the joints of other rows" in seen.headline
    seen = watch(base, turned(new, 3))
    assert [(change.what, change.joint) for change in seen.changes] == [("joint_sign", 3)]
    assert "negate column q3_deg" in seen.headline
    seen = watch(base, with_points(new, 1e-3))
    assert [change.what for change in seen.changes] == ["units"]
