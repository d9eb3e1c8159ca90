"""How many poses a fit takes: at the number that the refusal names it runs, with one pose less it does not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, check
from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.catalogue import family_of
from calib.errors import FitError
from calib.identifiability.structural import fewest_poses
from calib.options import RESIDUAL_KINDS, FitOptions
from calib.present.over_time.checks import item_sentence
from calib.simulation.simulate import simulate_dataset
from calib.validation.acceptance import TooFewPoses


def measured(robot: str, poses: int, setups: int = 1) -> Dataset:
    """Full poses of an arm, the first ones in turn from each setup; none for testing."""
    made = simulate_dataset(robot, rng=0, poses=40, orientation_sigma_rad=1e-4).dataset
    keep = np.flatnonzero(~made.poses.is_test)[:poses]
    chosen = replace(made.poses.select(keep), setup=np.array([f"s{i % setups}" for i in range(poses)]))
    points = made.points.select(np.isin(made.points.pose, keep))
    return replace(made, poses=chosen, points=replace(points, pose=np.searchsorted(keep, points.pose)))


@pytest.mark.slow
@pytest.mark.parametrize("setups", [1, 2])
@pytest.mark.parametrize("residual", RESIDUAL_KINDS)
@pytest.mark.parametrize("robot", ["rb5", "panda"])
def test_both_sides_of_the_limit(robot: str, residual: str, setups: int) -> None:
    needed = fewest_poses(builtin_robot(robot), residual=residual, setups=setups)
    with pytest.raises(FitError, match=f"measure at least {needed} different poses"):
        calibrate(measured(robot, needed - 1, setups), FitOptions(residual))
    fit = calibrate(measured(robot, needed, setups), FitOptions(residual)).fit
    assert fit.converged
    assert fit.degrees_of_freedom >= 1


@pytest.mark.slow
@pytest.mark.parametrize("residual", ["position", "distance", "pose"])
def test_the_check_says_the_same(residual: str) -> None:
    needed = fewest_poses(builtin_robot("rb5"), residual=residual)
    few = check(measured("rb5", needed - 1), options=FitOptions(residual))
    assert not few.passed
    (fit,) = few.items
    assert isinstance(fit.evidence, TooFewPoses)
    assert (fit.evidence.poses, fit.evidence.needed) == (needed - 1, needed)


def test_poses_without_a_point_are_not_counted_by_the_check() -> None:
    """As where the jig was not found in their scans."""
    dataset = measured("rb5", 12)
    part = check(dataset.with_points(dataset.points.select(np.arange(6))))
    assert not part.passed
    assert re.match(r"not tried: 6 different training poses are measured", item_sentence(part.items[0]))


def test_effects_that_ask_for_more_are_counted() -> None:
    dataset = measured("rb5", 16)
    with pytest.raises(FitError, match=r"42 equations, arm and effects have 42 knowable.* at least 17 "):
        calibrate(dataset, effects=family_of(dataset, "axis_wobble").members)
