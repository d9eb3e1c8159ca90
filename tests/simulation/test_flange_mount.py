"""Simulated cells whose arm carries the scanner, and what a fit, a correction, a model and a check make of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import frames
from calib.calibration.calibrate import calibrate
from calib.compensation.target_correction import corrected_joints
from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.catalogue import effects_named
from calib.errors import CalibError
from calib.models.fitted_model import FittedModel
from calib.models.model_file import load_model, save_model
from calib.monitoring.watch import watch
from calib.options import FitOptions
from calib.planning.start import start_of_dataset
from calib.simulation.measured_dataset import measure
from calib.simulation.simulate import simulate_dataset
from calib.simulation.truth.equilibrium import Truth, base_T_target
from tests.support.mujoco_arm import in_mujoco, mujoco_model

RB5 = replace(builtin_robot("rb5"), carries_scanner=True)
MADE = simulate_dataset(RB5, rng=np.random.default_rng(3), effects=["joint_compliance"], noise_mm=1e-4, poses=50)
FITTED = calibrate(MADE.dataset, effects=effects_named(MADE.dataset, ["joint_compliance"]))


def test_points_are_those_of_an_engine_that_shares_no_code() -> None:
    """MuJoCo's flange and the scanner on it against a jig fixed in the room, rigid arm."""
    made = simulate_dataset(RB5, rng=np.random.default_rng(1), noise_mm=0.0, poses=10)
    model = mujoco_model(made.truth.robot)
    flange = int(model.jnt_bodyid[-1])
    assert made.truth.base_T_jig is not None
    for q, apex_mm in zip(made.dataset.poses.q, made.apex_mm, strict=True):
        data = in_mujoco(model, made.truth.robot, q)
        base_T_flange = frames.make_transform(data.xmat[flange].reshape(3, 3), 1e3 * data.xpos[flange])
        seen = np.linalg.inv(base_T_flange @ made.truth.scanners[""]) @ made.truth.base_T_jig
        np.testing.assert_allclose(seen[:3, 3], apex_mm, atol=1e-6)


def test_a_compliant_arm_is_found_with_its_compliances() -> None:
    assert FITTED.after.test.rmse_mm < 5e-3
    truth = MADE.truth.effects[0].parameters()["c_rad_per_nm"]
    found = {p.name: value for p, value in zip(FITTED.fit.parameters, FITTED.fit.x, strict=True)}
    np.testing.assert_allclose(found["joint_compliance.J2.c_rad_per_nm"], truth[1], rtol=0.02)


def test_corrected_targets_bring_the_real_arm_where_the_nominal_one_would_be() -> None:
    """Up to one motion of the base, and what the flange's own rows hide: distances between targets are right."""
    robot = MADE.dataset.robot
    model = FITTED.model
    q = MADE.dataset.poses.q[:12]
    correction = corrected_joints(robot, model, q, x=FITTED.fit.x, kind="pose")
    assert correction.reached.all()
    assert FittedModel.of(FITTED).predict(q).shape == (12, 3)
    nominal = base_T_target(replace(MADE.truth, robot=replace(robot, carries_scanner=False), effects=()), q)
    real = [base_T_target(MADE.truth, at) for at in (q, correction.q)]
    base, tool = np.eye(4), np.eye(4)
    off = []
    for reached in real:  # the best constant motions of base and tool, by alternating means
        for _ in range(60):
            base = _mean(nominal @ np.linalg.inv(reached @ tool))
            tool = _mean(np.linalg.inv(reached) @ np.linalg.inv(base) @ nominal)
        off.append(float(np.sqrt(np.mean(np.sum((base @ reached @ tool - nominal)[:, :3, 3] ** 2, axis=1)))))
    assert off[1] < 0.05 * off[0]


def _mean(motions: np.ndarray) -> np.ndarray:
    return frames.make_transform(frames.mean_rotation(motions[:, :3, :3]), motions[:, :3, 3].mean(axis=0))


def test_a_saved_model_keeps_the_mount(tmp_path: Path) -> None:
    save_model(FITTED, tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    assert again.evaluate(MADE.dataset).test.rmse_mm == pytest.approx(FITTED.after.test.rmse_mm, rel=1e-6)
    in_world = replace(MADE.dataset, robot=replace(RB5, carries_scanner=False))
    with pytest.raises(CalibError, match=r"\[scanner\] mount in its dataset.toml is not that of the model's dataset"):
        again.evaluate(in_world)


def _later(truth: Truth, seed: int) -> Dataset:
    rng = np.random.default_rng(seed)
    return measure(RB5, truth, MADE.dataset.poses, rng=rng, name="later", noise_mm=0.01).dataset


def test_a_jig_that_moved_is_told_from_the_arm_and_the_scanner() -> None:
    assert MADE.truth.base_T_jig is not None
    moved = MADE.truth.base_T_jig.copy()
    moved[:3, 3] += [0.0, 0.3, 0.2]
    first = calibrate(_later(MADE.truth, 5), effects=effects_named(MADE.dataset, ["joint_compliance"]))
    assert watch(first, _later(MADE.truth, 6)).verdict == "unchanged"
    later = _later(replace(MADE.truth, base_T_jig=moved), 7)
    seen = watch(first, later)
    assert [change.what for change in seen.changes] == ["jig"]
    assert seen.changes[0].size == pytest.approx(np.hypot(0.3, 0.2), rel=0.05)
    assert "jig (or the base) moved" in seen.headline
    with pytest.raises(CalibError, match="its scanner is in the room, that of later on the flange"):
        watch(first, replace(later, robot=replace(RB5, carries_scanner=False)))


def test_an_effect_of_the_jigs_attitude_is_refused() -> None:
    with pytest.raises(CalibError, match="the effect incidence_bias with a scanner on the flange: no fit takes it"):
        simulate_dataset(RB5, rng=np.random.default_rng(0), effects=["incidence_bias"])


def test_no_poses_are_planned() -> None:
    with pytest.raises(CalibError, match="poses are planned for a scanner in the room alone"):
        start_of_dataset(MADE.dataset, FitOptions())
