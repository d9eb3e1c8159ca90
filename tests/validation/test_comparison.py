"""What differs between two calibrations: the truth is MuJoCo's, measured twice from two places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, compare
from calib.errors import FitError
from calib.simulation.simulate import simulate_dataset
from calib.validation.comparison import ALPHA, Comparison
from tests.support.checked_cell import measured_twice


def compared(seed: int, changed: dict[str, float] | None = None, *, other_arm: bool = False) -> Comparison:
    one, other = measured_twice(seed, changed, other_arm=other_arm)
    return compare(calibrate(one), calibrate(other))


@pytest.mark.slow
def test_the_same_arm_from_elsewhere_differs_in_nothing() -> None:
    found = [compared(seed) for seed in range(12)]
    assert sum(c.differs for c in found) <= 1
    assert 0.2 < np.mean([c.p_same for c in found]) < 0.8  # a probability, even over 0 to 1
    calm = next(c for c in found if not c.differs)
    assert calm.headline.startswith("No link parameter differs")
    assert max(abs(p.z) for p in calm.parameters) < 5.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "by"), [("theta3", np.radians(0.02)), ("alpha4", np.radians(0.03)), ("a2", 0.1), ("dTCP", 0.1)]
)
def test_one_change_is_told_from_the_many_parameters_that_it_moves(name: str, by: float) -> None:
    for seed in (100, 101):
        found = compared(seed, {name: by})
        assert len(found.changes) == 1
        change = found.changes[0]
        assert name in (change.name, *change.alike)
        if change.name == name:
            assert abs(change.size - by) < 4.0 * change.sigma
        assert found.p_same < ALPHA < found.p_rest
        assert name in found.headline


def test_the_other_way_round_is_the_opposite() -> None:
    one, other = (calibrate(d) for d in measured_twice(3, {"theta3": np.radians(0.03)}))
    there, back = compare(one, other), compare(other, one)
    assert back.p_same == pytest.approx(there.p_same)
    assert back.rms_mm == pytest.approx(there.rms_mm)
    for a, b in zip(there.parameters, back.parameters, strict=True):
        assert b.difference == pytest.approx(-a.difference)
        assert b.sigma == pytest.approx(a.sigma)
    assert back.changes[0].size == pytest.approx(-there.changes[0].size, rel=0.2)


def test_itself_differs_in_nothing() -> None:
    calibration = calibrate(measured_twice(4)[0])
    same = compare(calibration, calibration, ("monday", "tuesday"))
    assert (same.p_same, same.rms_mm, same.differs) == (1.0, pytest.approx(0.0, abs=1e-9), False)
    assert "monday and tuesday" in same.headline


def test_another_arm_differs_in_many() -> None:
    found = compared(5, other_arm=True)
    assert found.p_rest < ALPHA
    assert "differ in many link parameters" in found.headline
    assert found.rms_mm > 0.5


def test_without_prior_and_with_held_parameters() -> None:
    one, other = measured_twice(6, {"theta3": np.radians(0.05)})
    asked = calibrate(one).options
    for options in (replace(asked, prior=False), replace(asked, fixed=("beta2", "d4"))):
        found = compare(calibrate(one, options), calibrate(other, options))
        assert "theta3" in (found.changes[0].name, *found.changes[0].alike)
        assert all(np.isfinite(p.sigma) for p in found.parameters)


def test_arms_with_other_joints_are_refused() -> None:
    panda = simulate_dataset("panda", rng=0, poses=40).dataset
    with pytest.raises(FitError, match=r"6 joints.*7 joints"):
        compare(calibrate(measured_twice(0)[0]), calibrate(panda))
