"""A tool that robot.toml has elsewhere weighs something: its mass is asked for, and sigmas allow for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate
from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.catalogue import effects_named
from calib.present.fit.calibration import calibration_warnings
from calib.simulation.simulate import simulate_dataset

SOFT = "joint_compliance"


@pytest.mark.parametrize("seed", [0, 1])
def test_a_compliance_is_within_its_sigma_of_that_with_the_mass(seed: int) -> None:
    plain = builtin_robot("rb5")
    tool = replace(plain.tool, d_mm=plain.tool.d_mm + 154.0, mass_kg=2.5, com_mm=(0.0, 0.0, 100.0))
    heavy = simulate_dataset(
        replace(plain, tool=tool), rng=np.random.default_rng(seed), effects=[(SOFT, 8.0)], poses=60
    ).dataset
    untold = replace(plain, tool=replace(plain.tool, mass_kg=None, com_mm=None))
    light = replace(heavy, robot=untold, poses=replace(heavy.poses, payload_kg=None))
    known, found = (calibrate(one, effects=effects_named(one, [SOFT])) for one in (heavy, light))
    asked = [line for line in calibration_warnings(found) if "set it as mass_kg under [tool]" in line]
    assert len(asked) == 1
    assert not any("set it as mass_kg" in line for line in calibration_warnings(known))
    for name, (value, sigma) in found.fit.by_name.items():
        if name.startswith(SOFT):
            assert (
                abs(value - known.fit.by_name[name][0]) < 2.0 * sigma
            )  # 15 sigmas of a fit that takes it as weightless
    assert found.fit.by_name[f"{SOFT}.J2.c_rad_per_nm"][1] > 10.0 * known.fit.by_name[f"{SOFT}.J2.c_rad_per_nm"][1]
