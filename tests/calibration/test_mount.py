"""The scanner's place on the flange, with sigmas that hold for the true and for the fitted arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, frames
from calib.calibration.mount import mounts
from calib.dataset.files.robot_toml import builtin_robot
from calib.simulation.simulate import Tolerances, simulate_dataset


@pytest.mark.parametrize(("length_mm", "angle_deg"), [(0.0, 0.0), (0.5, 0.25)])
def test_a_mount_is_where_its_covariance_says(length_mm: float, angle_deg: float) -> None:
    squared = []
    for seed in range(4):
        robot = replace(builtin_robot("rb5"), carries_scanner=True)
        made = simulate_dataset(robot, rng=seed, tolerances=Tolerances(length_mm, angle_deg), poses=40)
        fit = calibrate(made.dataset)
        (mount,) = mounts(fit)
        true = made.truth.scanners[mount.setup]
        turn = frames.rotvec_from_rotation(mount.flange_T_scanner[:3, :3] @ true[:3, :3].T)
        error = np.concatenate([mount.xyz_mm - true[:3, 3], turn])
        squared.append(error @ np.linalg.solve(mount.covariance, error))
        with_table = np.sqrt(np.diag(mount.covariance_with_table))
        assert with_table[:3].max() < 0.05
        assert fit.links_fixed_to_table == (length_mm == 0)
    assert np.mean(squared) < 12  # 6 is expected, less where links are better than their tolerances
    assert length_mm or np.mean(squared) > 2
    (told,) = fit.to_dict()["mounts"]
    np.testing.assert_allclose(told["sigma_mm"], np.sqrt(np.diag(mount.covariance))[:3])
    assert f"scanner on the flange  {mount.xyz_mm[0]:.1f}"[:26] in fit.summary().replace("−", "-")


def test_a_scanner_in_the_room_has_no_mount() -> None:
    made = simulate_dataset("rb5", rng=0, poses=40)
    assert mounts(calibrate(made.dataset)) == ()
