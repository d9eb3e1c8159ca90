"""Links that are as robot.toml has them are held there; links that are off by little are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, diagnose
from calib.dataset.files.robot_toml import builtin_robot
from calib.present.fit.calibration import calibration_document
from calib.simulation.simulate import Tolerances, simulate_dataset


@pytest.mark.parametrize("carries_scanner", [False, True])
def test_an_exact_arm_keeps_its_table(carries_scanner: bool) -> None:
    """Then the fit of the scanner's place alone is left; all links free would raise the test error by half and more."""
    robot = replace(builtin_robot("rb5"), carries_scanner=carries_scanner)
    made = simulate_dataset(robot, rng=3, tolerances=Tolerances(0.0, 0.0), noise_mm=0.05)
    fit = calibrate(made.dataset)
    assert fit.links_fixed_to_table
    assert calibration_document(fit)["links_held"]
    assert "as robot.toml has them" in fit.summary()
    names = robot.parameter_names[:-5]  # not the tool's, where the jig is mounted
    off = [p.scale for p in fit.model.parameters if p.name in names]
    assert max(off) < 1e-3
    assert fit.after.test.rmse_mm < 1.02 * fit.before.test.rmse_mm
    free = calibrate(made.dataset, prior=False)
    assert not free.links_fixed_to_table


@pytest.mark.parametrize("seed", range(2))
def test_an_arm_that_is_off_by_little_is_fitted(seed: int) -> None:
    made = simulate_dataset("rb5", rng=seed, tolerances=Tolerances(0.05, 0.025), noise_mm=0.05)
    fit = calibrate(made.dataset)
    assert not fit.links_fixed_to_table
    assert not calibration_document(fit)["links_held"]
    assert fit.after.train.rmse_mm < fit.before.train.rmse_mm


@pytest.mark.slow
def test_of_an_exact_arm_with_a_hidden_effect_the_effect_alone_is_found() -> None:
    made = simulate_dataset("rb5", rng=0, effects=["joint_compliance"], tolerances=Tolerances(0.0, 0.0))
    assert not calibrate(made.dataset).links_fixed_to_table  # the links follow the effect
    found = diagnose(made.dataset)
    assert found.missing == ("joint_compliance",)
    assert found.calibration.links_fixed_to_table


def test_few_points_decide_nothing() -> None:
    made = simulate_dataset("rb5", rng=1, poses=16, tolerances=Tolerances(0.3, 0.1), noise_mm=0.05)
    assert not calibrate(made.dataset).links_fixed_to_table
    assert np.isfinite(calibrate(made.dataset).sigma_mm)
