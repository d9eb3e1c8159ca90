"""Fits with a far wrong tool point in robot.toml agree with the fit from the right one, and report the shift."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate, corrected_joints, cross_validate, diagnose
from calib.calibration.model_versions import versions
from calib.calibration.plausibility import implausibility_reason
from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot, load_robot_toml, robot_to_toml
from calib.effects.catalogue import effects_named
from calib.effects.link_errors import TOLERANCE_RAD
from calib.fitting.tool_point import tip_turn_rad
from calib.kinematics.robot import Robot, Target
from calib.kinematics.tool_point import tool_point, with_tool_point
from calib.models.model_file import load_model, save_model
from calib.options import FitOptions
from calib.present.fit.calibration import calibration_warnings
from calib.simulation.simulate import simulate_dataset
from inspector.panels.model.fit import fit_html
from tests.support.changed import with_xyz


def simulated(robot: Robot, seed: int = 7, **more: object) -> Dataset:
    options: dict = {"poses": 64} | more
    return simulate_dataset(robot, rng=seed, **options).dataset


def with_wrong_tool(dataset: Dataset, off_mm: object) -> Dataset:
    """The dataset with its robot's tool point shifted, mm in the last joint's frame."""
    robot = dataset.robot
    return replace(dataset, robot=with_tool_point(robot, tool_point(robot.table) + np.asarray(off_mm)))


def directions(count: int, rng: np.random.Generator) -> np.ndarray:
    """Random vectors (count, 3) of 20 to 300 mm length."""
    unit = rng.normal(size=(count, 3))
    return unit / np.linalg.norm(unit, axis=1)[:, None] * rng.uniform(20.0, 300.0, (count, 1))


def held_out_mm(dataset: Dataset, options: FitOptions = FitOptions()) -> float:
    result = calibrate(dataset, options)
    assert result.fit.converged
    assert not implausibility_reason(result)
    return result.after.test.rmse_mm


@pytest.mark.slow
@pytest.mark.parametrize("residual", ["position", "distance", "pairs", "pose"])
def test_wrong_tools_end_where_the_right_one_does(residual: str) -> None:
    more: dict = {"orientation_sigma_rad": 1e-4} if residual == "pose" else {}
    dataset, options = simulated(builtin_robot("rb5"), **more), FitOptions(residual)
    right_mm = held_out_mm(dataset, options)
    for off_mm in [*directions(3, np.random.default_rng(0)), (0.0, 80.0, 0.0), (0.0, 0.0, 176.0)]:
        assert held_out_mm(with_wrong_tool(dataset, off_mm), options) == pytest.approx(right_mm, rel=1e-3)


def test_several_setups_and_further_targets_do_not_mislead() -> None:
    dataset = simulated(builtin_robot("rb5"), setups=3)
    right_mm = held_out_mm(dataset)
    assert held_out_mm(with_wrong_tool(dataset, (0.0, -150.0, 60.0))) == pytest.approx(right_mm, rel=1e-3)
    further = replace(dataset.robot, targets=(Target("smr2", (12.0, -40.0, 80.0)),))
    twice = replace(dataset, robot=further)
    wrong = calibrate(with_wrong_tool(twice, (0.0, -150.0, 60.0)))
    assert wrong.robot.targets[1:] == further.targets
    assert wrong.after.test.rmse_mm == pytest.approx(right_mm, rel=1e-3)


@pytest.mark.slow
def test_the_tool_is_told_with_where_it_is() -> None:
    dataset = simulated(builtin_robot("rb5"))
    wrong = with_wrong_tool(dataset, (50.0, -60.0, 30.0))
    result = calibrate(wrong)
    shift = result.tool_shift
    # The arm's own link errors are of 0.3 mm.
    np.testing.assert_allclose(shift.point_mm, tool_point(dataset.robot.table), atol=2.0)
    assert shift.off_mm == pytest.approx(np.sqrt(50.0**2 + 60.0**2 + 30.0**2), abs=2.0)
    words = f"the tool point is {shift.off_mm:.1f} mm from where robot.toml has it"
    assert sum(words in warning for warning in calibration_warnings(result)) == 1
    assert words[4:] in result.summary()
    assert words in fit_html(result)  # on the page
    assert "The tool point is" in diagnose(wrong, max_steps=0).summary()


@pytest.mark.slow
def test_a_right_tool_is_left_alone() -> None:
    for seed in range(5):
        for robot in (builtin_robot("rb5"), builtin_robot("panda")):
            dataset = simulated(robot, seed)
            assert calibrate(dataset).model.tool_found is None
    few_mm = calibrate(with_wrong_tool(dataset, (2.0, 0.0, 2.0)))
    assert few_mm.tool_shift is None


def test_what_the_user_asks_for_wins() -> None:
    wrong = with_wrong_tool(simulated(builtin_robot("rb5")), (50.0, -60.0, 30.0))
    tolerances = {"aTCP": 100.0, "dTCP": 100.0, "thetaTCP": 3.0}
    loose = calibrate(wrong, FitOptions(tolerances=tolerances))
    assert loose.model.tool_found is None
    narrow = calibrate(wrong, FitOptions(tolerances={"aTCP": 1e-6})).to_frame().set_index("name")
    assert narrow.loc["jig.x", "tolerance"] == 1e-6
    assert narrow.loc["jig.z", "tolerance"] > 50.0
    held = calibrate(wrong, FitOptions(fixed=("aTCP", "dTCP", "thetaTCP")))
    assert held.model.tool_found is None
    np.testing.assert_array_equal(held.robot.table[-1, [0, 2, 3]], wrong.robot.table[-1, [0, 2, 3]])
    assert calibrate(wrong, FitOptions(prior=False)).fit.converged


@pytest.mark.thorough
def test_every_further_fit_has_the_same_tool() -> None:
    dataset = simulated(builtin_robot("rb5"), effects=["transmission_error"])
    wrong = with_wrong_tool(dataset, (-90.0, 40.0, 120.0))
    found, right = diagnose(wrong), diagnose(dataset)
    assert found.missing == right.missing == ("transmission_error",)
    assert found.verdict == right.verdict
    first = found.steps[0].calibration.model.tool_found
    assert first is not None
    assert all(step.calibration.model.tool_found == first for step in found.steps)
    for of_wrong, of_right in zip(found.steps, right.steps, strict=True):
        assert of_wrong.calibration.after.test.rmse_mm == pytest.approx(
            of_right.calibration.after.test.rmse_mm, rel=2e-3
        )
    whole = effects_named(wrong, ["transmission_error"])
    at_once = calibrate(wrong, effects=whole)
    assert all(version.calibration.model.tool_found == first for version in versions(at_once))
    pooled, of_right = (cross_validate(d, effects=effects_named(d, ["transmission_error"])) for d in (wrong, dataset))
    assert pooled.after.test.rmse_mm == pytest.approx(of_right.after.test.rmse_mm, rel=5e-3)


def test_outliers_move_no_tool() -> None:
    dataset = simulated(builtin_robot("rb5"), poses=30)
    xyz_mm = dataset.points.xyz_mm.copy()
    xyz_mm[5] += [0.0, 50.0, 0.0]
    spoilt = with_xyz(dataset, xyz_mm)
    for options in (FitOptions(), FitOptions(robust=True)):
        assert calibrate(spoilt, options).tool_shift is None


def test_a_tool_that_is_found_keeps_its_attitude(tmp_path: Path) -> None:
    """One point does not determine the tool's attitude or the rows behind the last axis: they stay as in robot.toml."""
    robot = builtin_robot("rb5")
    beside = with_tool_point(robot, tool_point(robot.table) + np.array([0.0, 30.0, 0.0]))
    q = np.random.default_rng(0).uniform(-0.3, 0.3, (4, 6)) + np.array([0.0, 0.3, 1.4, 0.5, 1.4, 0.0])
    result = calibrate(replace(simulated(beside), robot=robot))
    save_model(result, tmp_path / "model.json")
    assert result.model.tool_found is not None
    np.testing.assert_array_equal(result.robot.table[-2:], robot.table[-2:])
    np.testing.assert_allclose(result.robot.own_tool_point.xyz_mm, tool_point(beside.table), atol=2.0)
    loaded = load_model(tmp_path / "model.json")
    assert loaded.model.tool_found == result.model.tool_found
    assert loaded.robot == result.robot
    for model in (result.model, loaded.model):
        correction = corrected_joints(robot, model, q, x=result.fit.x, kind="pose")
        assert correction.reached.all()
        assert np.degrees(np.abs(correction.change)).max() < 3.0


def test_a_tool_point_within_tolerance_is_told_apart_from_a_turn_of_the_tip() -> None:
    """A point that the last rows reach only by turning the tip beyond tolerance becomes a point of its own."""
    robot = builtin_robot("rb5")
    beside = with_tool_point(robot, tool_point(robot.table) + np.array([3.0, 3.0, 0.0]))
    result = calibrate(replace(simulated(beside), robot=robot))
    assert tip_turn_rad(robot, result.robot) <= TOLERANCE_RAD


def test_a_calibrated_robot_with_a_tool_point_of_its_own_is_read_back_and_fitted(tmp_path: Path) -> None:
    robot = builtin_robot("rb5")
    beside = with_tool_point(robot, tool_point(robot.table) + np.array([0.0, 30.0, 50.0]))
    dataset = replace(simulated(beside), robot=robot)
    result = calibrate(dataset)
    (tmp_path / "robot.toml").write_text(robot_to_toml(result.robot))
    again = load_robot_toml(tmp_path / "robot.toml")
    assert again.targets == result.robot.targets
    for residual in ("position", "distance"):
        anew = calibrate(replace(dataset, robot=again), FitOptions(residual))
        assert anew.model.tool_found is None
        assert anew.before.test.rmse_mm == pytest.approx(result.after.test.rmse_mm, rel=1e-6)
        np.testing.assert_allclose(anew.robot.table[-2:], result.robot.table[-2:], atol=1e-12)
