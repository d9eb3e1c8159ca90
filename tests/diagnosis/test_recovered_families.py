"""Families of one pose or place, and others, from their exact laws: ranked first, fitted, kept in files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib import corrected_joints, screen
from calib.calibration.result import Calibration
from calib.compensation.target_correction import plain_poses
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.diagnosis.search_space import add_in_turn
from calib.effects.catalogue import catalogue_names, effects_for, effects_named
from calib.effects.effect import full_name
from calib.errors import CalibError
from calib.models.fitted_model import FittedModel
from calib.models.model_file import load_model, save_model
from calib.simulation.simulate import Simulation, simulate_dataset

LATER = catalogue_names()[16:]  # the first sixteen are asked for in test_stepwise
NOISE_MM = 0.05


def simulated(name: str, arm: str, *, seed: int = 0, sigmas: float = 4.0) -> Simulation:
    return simulate_dataset(
        arm,
        rng=np.random.default_rng([51, seed]),
        effects=(name,),
        visible_sigmas=sigmas,
        conditions=True,
        poses=80,
        noise_mm=NOISE_MM,
    )


def by_joint(field: str, parameter: str, factor: float = 1.0) -> Callable[[Any], dict[str, float]]:
    """The true values of `field`, one a joint, by the names of the fitted parameters."""

    def told(true: Any) -> dict[str, float]:
        values = getattr(true, field)
        return {f"{true.name}.J{j + 1}.{parameter}": factor * values[j] for j in np.flatnonzero(values)}

    return told


# What each fitted parameter should be, by the truth; parameters are looked up by how their names begin.
TRUTHS: dict[str, Callable[[Any], dict[str, float]]] = {
    "joint_step": by_joint("offset_rad", "from_"),
    "target_step": lambda t: {f"target_step.{a}_from_": t.shift_mm[k] for k, a in enumerate("xyz")},
    "base_loosening": lambda t: {f"base_loosening.c{a}_from_": t.c_rad_per_nm[k] for k, a in enumerate("xy")},
    "following_error": by_joint("k", "k"),
    "asymmetric_scale": by_joint("k", "k"),
    "high_harmonic": lambda t: {
        f"high_harmonic.J{j + 1}.{part}{t.harmonics[0]:g}_rad": getattr(t, f"{part}_rad")[j, 0]
        for j in np.flatnonzero(t.cos_rad)
        for part in ("sin", "cos")
    },
    "nonlinear_stiffness": by_joint("c_rad_per_nm2", "c2_"),
    "link_torsion": by_joint("c_rad_per_nm", "c_"),
    "bearing_clearance": by_joint("lean_rad", "c_"),
}


@pytest.mark.parametrize(("name", "arm"), [(name, ("rb5", "panda")[k % 2]) for k, name in enumerate(LATER)])
@pytest.mark.thorough
def test_each_is_ranked_first_and_fitted_to_the_noise(name: str, arm: str) -> None:
    simulation = simulated(name, arm)
    dataset = simulation.dataset
    before, after = (step.calibration for step in add_in_turn(dataset, [name]))
    ranked = screen(before, effects_for(dataset)).candidates
    assert ranked[0].name == name, [(c.name, c.log_evidence) for c in ranked[:3]]
    assert after.sigma_mm < 1.2 * NOISE_MM
    # The mean: no fit can tell whether a test pose beside a step was measured before it.
    assert after.after.test.mean_mm < 0.6 * before.after.test.mean_mm
    fitted = after.fit.by_name
    (true,) = simulation.truth.effects
    for begin, value in TRUTHS.get(name, lambda _: {})(true).items():
        found = [of for full, of in fitted.items() if full.startswith(begin)]
        if found:  # a joint that carries next to nothing may be left out
            size, sigma = max(found, key=lambda of: abs(of[0]))
            assert size == pytest.approx(value, abs=4.0 * sigma + 0.02 * abs(value)), begin
    assert any(full.startswith(f"{name}.") for full in fitted)


@pytest.fixture(scope="module")
def slipped() -> tuple[Dataset, Calibration]:
    dataset = simulated("joint_step", "rb5").dataset
    return dataset, add_in_turn(dataset, ["joint_step"])[-1].calibration


@pytest.mark.slow
def test_a_slip_is_saved_with_its_pose_and_read_again(slipped: tuple[Dataset, Calibration], tmp_path: Path) -> None:
    dataset, fitted = slipped
    save_model(fitted, tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    assert isinstance(again, FittedModel)
    assert again.model.added_effects == fitted.model.added_effects
    np.testing.assert_allclose(again.evaluate(dataset).error_mm, fitted.after.error_mm, atol=1e-9)


def test_targets_are_corrected_for_the_arm_as_it_is_after_the_last_pose(
    slipped: tuple[Dataset, Calibration],
) -> None:
    """And not by the conditions of a pose before the slip."""
    dataset, fitted = slipped
    (step,) = fitted.model.added_effects
    names = [p.name for p in fitted.fit.parameters]
    size = fitted.fit.x[names.index(full_name(step, step.parameters[0]))]
    q = dataset.poses.q[:5]
    state = fitted.model.state(fitted.fit.x, plain_poses(q))
    before = fitted.model.state(fitted.fit.x, dataset.poses.select(np.arange(5)))
    joint = getattr(step, "joint")  # noqa: B009
    moved = state.table[:, joint, 3] - before.table[:, joint, 3]
    np.testing.assert_allclose(moved, size, rtol=1e-12)
    told = replace(dataset.poses.select(np.arange(5)), q=q)
    now = corrected_joints(dataset.robot, fitted.model, q, x=fitted.fit.x, conditions=told)
    plain = corrected_joints(dataset.robot, fitted.model, q, x=fitted.fit.x)
    np.testing.assert_allclose(now.q, plain.q, atol=1e-12)
    assert now.changed == ("joint_step",)
    assert "as it is after the last measured pose (joint_step)" in now.summary()


def test_another_dataset_is_of_a_later_day(slipped: tuple[Dataset, Calibration], tmp_path: Path) -> None:
    dataset, _ = slipped
    write_dataset(dataset, tmp_path / "cell")
    fitted = add_in_turn(load_dataset(tmp_path / "cell"), ["joint_step"])[-1].calibration
    model = FittedModel.of(fitted)
    same = model.evaluate(load_dataset(tmp_path / "cell"))
    np.testing.assert_allclose(same.error_mm, fitted.after.error_mm, atol=1e-9)
    write_dataset(replace(dataset, description="measured again"), tmp_path / "again")
    later = model.evaluate(load_dataset(tmp_path / "again"))
    (step,) = fitted.model.added_effects
    first = getattr(step, "start").first  # noqa: B009
    before = dataset.points.pose < first
    assert np.median(np.linalg.norm(later.error_mm[before], axis=1)) > 3.0 * NOISE_MM


def test_a_family_of_places_is_not_taken_whole(slipped: tuple[Dataset, Calibration]) -> None:
    with pytest.raises(CalibError, match=r"joint_step could be at \d+ places .* --add joint_step"):
        effects_named(slipped[0], ["joint_step"])
