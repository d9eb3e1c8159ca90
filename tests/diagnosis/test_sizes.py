"""What is said has a size that can be: values beyond nature, what shows at the tool, test poses that are off."""

from __future__ import annotations

import pytest

from calib import diagnose
from calib.dataset.dataset import Dataset
from calib.effects.catalogue import effects_for
from calib.effects.effect import NaturalBound, Parameter, exceeded_bound
from calib.simulation.simulate import simulate_dataset
from tests.support.changed import with_poses
from tests.support.fit_cases import rich_dataset


def simulated(effects: list[tuple[str, float]], seed: int = 3) -> Dataset:
    return simulate_dataset("rb5", rng=seed, effects=effects, conditions=True, poses=64).dataset


def test_every_family_has_bounds_far_above_its_usual_size() -> None:
    for family in effects_for(rich_dataset()):
        for member in family.members[:1]:
            for parameter in member.parameters:
                bound = exceeded_bound(member, parameter, 1e6 * parameter.scale, 0.0)
                if not getattr(member, "bounds", ()):  # scanner_drift: how far depends on how long it was measured
                    continue
                assert bound is not None, (family.name, parameter)
                assert bound.unit == parameter.unit
                assert bound.size > 2.0 * parameter.scale
                assert exceeded_bound(member, parameter, -1e6 * parameter.scale, 0.0) == bound
                assert exceeded_bound(member, parameter, 1.1 * bound.size, 0.1 * bound.size) is None


def test_a_users_effect_has_the_bounds_of_its_class_alone() -> None:
    class Own:
        name = "joint_compliance"
        parameters = (Parameter("c", "rad/Nm", 1.0),)

        def apply(self, state, *, c):
            return state

    class Bounded(Own):
        bounds = (NaturalBound(2.0, "rad/Nm", "rubber"),)

    assert exceeded_bound(Own(), Own.parameters[0], 1e9, 0.0) is None
    assert exceeded_bound(Bounded(), Own.parameters[0], 3.0, 0.1) == Bounded.bounds[0]
    assert exceeded_bound(Bounded(), Own.parameters[0], 3.0, 0.6) is None


@pytest.mark.slow
def test_a_value_beyond_nature_carries_a_doubt() -> None:
    """Lengths that grow with a temperature far more than aluminium does: something else warms with the arm."""
    dataset = simulated([("thermal_growth", 0.5)])
    temperature_c = dataset.poses.temperature_c
    faint = temperature_c.mean() + 0.1 * (temperature_c - temperature_c.mean())
    found = diagnose(with_poses(dataset, temperature_c=faint))
    assert found.named == ("thermal_growth",)
    assert "Implausible: thermal_growth.kappa_per_k is" in found.summary()
    assert "grows most, by 23e-6/K" in found.summary()
