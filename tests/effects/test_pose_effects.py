"""Effects turn the tool as an independent simulator says: with the effect in the model, full poses fit to the noise."""

from __future__ import annotations

import numpy as np
import pytest

from calib import calibrate
from calib.effects.catalogue import family_of
from calib.options import FitOptions
from calib.simulation.simulate import simulate_dataset


@pytest.mark.slow
@pytest.mark.parametrize(
    "effect",
    ["link_bending", "axis_wobble", "base_compliance", "joint_coupling", "scanner_drift", "tool_sag"],
)
def test_poses_of_an_arm_with_an_effect_are_fitted_to_the_noise(effect: str) -> None:
    dataset = simulate_dataset(
        "rb5",
        rng=4,
        poses=80,
        effects=[(effect, 6.0)],
        orientation_sigma_rad=3e-5,
    ).dataset
    without = calibrate(dataset, FitOptions("pose"))
    with_it = calibrate(dataset, FitOptions("pose"), effects=family_of(dataset, effect).members)
    assert without.fit.reduced_chi > 3.0
    assert 0.8 < with_it.fit.reduced_chi < 1.2
    after = with_it.orientation_errors[1].train
    assert after.rmse_rad < 2.0 * np.sqrt(3.0) * 3e-5
