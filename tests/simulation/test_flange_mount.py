"""Simulated cells whose arm carries the scanner, and what a fit, a correction, a model and a check make of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate, corrected_joints, frames
from calib.dataset.dataset import Poses
from calib.effects.catalogue import effects_named
from calib.errors import CalibError
from calib.models.fitted_model import FittedModel
from calib.models.model_file import load_model, save_model
from calib.planning.plan import plan_poses
from calib.planning.start import FromFit
from calib.simulation.pose_design import scan_poses
from calib.simulation.simulate import Simulation, measure, simulate_dataset
from calib.simulation.truth.equilibrium import Truth, base_T_target
from calib.statistics import rms_length
from calib.workcell.known_cell import workcell_of_dataset
from tests.support.flange_mount import MADE, RB5
from tests.support.mujoco_arm import in_mujoco, mujoco_model

FITTED = calibrate(MADE.dataset, effects=effects_named(MADE.dataset, ["joint_compliance"]))


def test_points_are_those_of_an_engine_that_shares_no_code() -> None:
    """MuJoCo's flange and the scanner on it against a jig fixed in the room, rigid arm."""
    made = simulate_dataset(RB5, rng=1, noise_mm=0.0, poses=10)
    model = mujoco_model(made.truth.robot)
    flange = int(model.jnt_bodyid[-1])
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
        off.append(rms_length((base @ reached @ tool - nominal)[:, :3, 3]))
    assert off[1] < 0.05 * off[0]


def _mean(motions: np.ndarray) -> np.ndarray:
    return frames.make_transform(frames.mean_rotation(motions[:, :3, :3]), motions[:, :3, 3].mean(axis=0))


def test_a_saved_model_keeps_the_mount(tmp_path: Path) -> None:
    save_model(FITTED, tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    assert again.evaluate(MADE.dataset).test.rmse_mm == pytest.approx(FITTED.after.test.rmse_mm, rel=1e-6)
    in_world = replace(MADE.dataset, robot=replace(RB5, carries_scanner=False))
    with pytest.raises(CalibError, match=r"\[scanner\] mount in its dataset.toml is not that of the model"):
        again.evaluate(in_world)


def test_an_effect_of_the_jigs_attitude_is_refused() -> None:
    with pytest.raises(CalibError, match="the effect incidence_bias with a scanner on the flange: no fit takes it"):
        simulate_dataset(RB5, rng=0, effects=["incidence_bias"])


def _measured(truth: Truth, q: np.ndarray, test: int, seed: int) -> Simulation:
    """A carried scanner's points at joints (N, n), the last of which are test poses."""
    role = np.full(len(q), "train", dtype="<U9")
    role[0], role[len(q) - test :] = "reference", "test"
    ids = tuple(f"p{i + 1:02d}" for i in range(len(q)))
    poses = Poses(ids, role, q, np.full(len(q), ""), ids)
    return measure(RB5, truth, poses, rng=np.random.default_rng(seed), name="arm", noise_mm=0.05)


def _squared_error_mm2(made: Simulation) -> float:
    """Mean square error, mm^2, of a fit's predictions at the test poses, without the points' noise."""
    errors = calibrate(made.dataset).after
    true_mm = errors.error_mm + made.dataset.points.xyz_mm - made.apex_mm
    return float(np.mean(np.sum(true_mm[errors.is_test[errors.pose]] ** 2, axis=1)))


@pytest.mark.slow
def test_planned_poses_have_the_jig_in_view_and_the_predicted_error() -> None:
    """Five arms: 20 poses and 6 planned ones, beside 6 others of the same field."""
    predicted, planned, others = [], [], []
    for seed in range(5):
        made = simulate_dataset(RB5, rng=seed, poses=20, scans=True)
        truth, q = made.truth, made.dataset.poses.q
        assert truth.base_T_jig is not None
        rng = np.random.default_rng(seed + 100)
        more = scan_poses(RB5, truth.base_T_scanner, 46, rng=rng, base_T_jig=truth.base_T_jig)
        test, other = more[:40], more[40:]
        fit = calibrate(_measured(truth, np.concatenate([q, test]), 40, seed).dataset)
        plan = plan_poses(FromFit(fit), 6, candidates=200)
        taken = _measured(truth, np.concatenate([q, plan.poses.q, test]), 40, seed + 50)
        predicted.append(plan.then.geometry_mm**2)
        planned.append(_squared_error_mm2(taken))
        others.append(_squared_error_mm2(_measured(truth, np.concatenate([q, other, test]), 40, seed + 50)))
        seen_mm = taken.apex_mm[20:26]
        assert np.all(np.abs(seen_mm[:, 2] - 700.0) < 200.0)
        assert np.all(np.abs(seen_mm[:, :2]) < 250.0)
        cosine = -taken.scanner_T_jig[20:26, 2, 2]
        assert np.all(np.abs(cosine) > np.cos(np.radians(60.0)))
    assert np.sqrt(np.mean(planned)) == pytest.approx(np.sqrt(np.mean(predicted)), rel=0.25)
    assert np.mean(planned) < np.mean(others)


def test_a_cell_needs_points_to_place_a_carried_scanner() -> None:
    with pytest.raises(CalibError, match="measure 6 poses first"):
        workcell_of_dataset(replace(MADE.dataset, points=None))
