"""Residuals of full poses: derivatives by differences, elimination by brute force, recovery within the sigmas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calib import calibrate, frames, redundancy
from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.catalogue import effects_for, family_of
from calib.effects.link_errors import LinkErrors
from calib.errors import FitError
from calib.fitting.model import Model, geometric_model
from calib.fitting.observations import (
    Observations,
    predict_poses,
    with_nominal_scanner_frames,
)
from calib.fitting.pose_residuals import PoseResiduals, _turn_curvature
from calib.fitting.residual_kinds import make_residuals
from calib.fitting.trust_region import solve
from calib.identifiability.structural import structural_rank
from calib.options import FitOptions
from calib.simulation.simulate import simulate_dataset
from calib.simulation.truth.equilibrium import base_T_target
from calib.statistics import rms_length
from tests.support.changed import with_poses
from tests.support.fit_cases import (
    SIGMA_RAD,
    check_gradient,
    check_last_columns,
    full_poses,
    label,
    rich_dataset,
    some_of,
    with_pose_covariances,
)

DATASET = rich_dataset()
MEMBERS = [member for family in effects_for(DATASET) for member in some_of(family)]


@pytest.mark.parametrize("effect", [*MEMBERS, LinkErrors(DATASET.robot)], ids=label)
def test_the_jacobian_of_place_and_attitude_is_the_derivative(effect) -> None:
    """Analytic and numerical derivatives agree for each effect, with scanner frames, away from zero."""
    rng = np.random.default_rng(1)
    observed = with_nominal_scanner_frames(Observations.of(DATASET), DATASET.robot)
    poses, seen = observed.used_poses[0], observed.seen()
    links = () if isinstance(effect, LinkErrors) else (LinkErrors(DATASET.robot),)
    model = Model(DATASET.robot, (*links, effect))
    x = rng.normal(size=len(model.parameters)) * model.scales * 0.3
    check_last_columns(model, len(effect.parameters), poses, seen, x)


@pytest.mark.slow
@pytest.mark.parametrize("setups", [1, 2])
def test_the_jacobian_is_the_derivative_of_the_cost(setups: int) -> None:
    """The cost's gradient 2 J^T r is exact although frames and hand-eye rotation are eliminated."""
    rng = np.random.default_rng(1)
    dataset = with_pose_covariances(full_poses(2, setups=setups), rng)
    residuals = make_residuals("pose", geometric_model(dataset.robot), Observations.of(dataset))
    assert residuals.degrees_spent == 6 * setups + 3
    check_gradient(residuals, rng)


@pytest.mark.slow
def test_no_other_frame_and_hand_eye_fit_better() -> None:
    """Elimination agrees with a general minimiser over the nine unknowns, which shares no code."""
    dataset = with_pose_covariances(full_poses(4), np.random.default_rng(4))
    observed = Observations.of(dataset)
    residuals = PoseResiduals(geometric_model(dataset.robot), observed)
    x = np.zeros(len(residuals.parameters))
    base_mm, attitude = predict_poses(residuals.model, x, observed)
    orientations = observed.points.orientations
    placed = residuals.frames_and_hand_eye(x)
    (start,) = placed.scanner_T_base.values()

    def everything(u: np.ndarray) -> np.ndarray:
        turn, seat = Rotation.from_rotvec(u[3:6]).as_matrix(), Rotation.from_rotvec(u[6:]).as_matrix()
        out = []
        for m in range(len(base_mm)):
            place = turn @ start[:3, :3] @ base_mm[m] + start[:3, 3] + u[:3] - observed.points.xyz_mm[m]
            covariance = observed.covariance_mm2[m]
            if orientations.known[m]:
                jig = turn @ start[:3, :3] @ attitude[m] @ seat @ placed.tool_R_jig
                off = Rotation.from_matrix(jig @ orientations.scanner_R_jig[m].T).as_rotvec()
                place = np.concatenate([place, off])
                cross = orientations.cross_mm_rad[m]
                covariance = np.block([[covariance, cross], [cross.T, orientations.covariance_rad2[m]]])
            out.append(np.linalg.solve(np.linalg.cholesky(covariance), place))
        return np.concatenate(out)

    ours = residuals.residual(x)
    away = np.repeat([1.0, 1e-3, 1e-2], 3) * np.random.default_rng(0).normal(size=9)
    best = least_squares(everything, away, x_scale=np.repeat([0.1, 1e-4, 1e-4], 3), xtol=1e-15, ftol=1e-15)
    assert float(ours @ ours) == pytest.approx(2.0 * best.cost, rel=1e-9)


def test_a_fit_recovers_the_arm_within_its_sigmas_and_the_noise() -> None:
    dataset = full_poses(5, poses=60)
    model = geometric_model(dataset.robot)
    residuals = make_residuals("pose", model, Observations.of(dataset))
    fit = solve(residuals)
    assert fit.converged
    assert 0.85 < fit.reduced_chi < 1.15  # declared sigmas are right
    rows = 6 * int(np.sum(~dataset.poses.is_test))
    assert fit.rows == rows
    assert fit.rank > solve(make_residuals("position", model, Observations.of(dataset))).rank


def test_attitudes_of_the_fitted_arm_are_the_true_ones_up_to_base_and_seat() -> None:
    made = simulate_dataset("panda", rng=6, poses=64, orientation_sigma_rad=SIGMA_RAD)
    dataset = made.dataset
    model = geometric_model(dataset.robot)
    q = np.random.default_rng(7).uniform(-2.0, 2.0, (30, 7))
    poses = replace(dataset.poses.select(np.zeros(30, dtype=np.int64)), q=q, ids=tuple(f"n{i}" for i in range(30)))
    true = base_T_target(made.truth, q)[:, :3, :3]
    off = {}
    for kind in ("position", "pose"):
        fit = solve(make_residuals(kind, model, Observations.of(dataset)))
        found = model.state(fit.x, poses).attitude
        left, seat = np.eye(3), np.eye(3)
        for _ in range(30):  # the best frame and the best seat in turns
            left = frames.mean_rotation(true @ np.swapaxes(found @ seat, 1, 2))
            seat = frames.mean_rotation(np.swapaxes(left @ found, 1, 2) @ true)
        turn = frames.rotvec_from_rotation(left @ found @ seat @ np.swapaxes(true, 1, 2))
        off[kind] = rms_length(turn)
    assert off["pose"] < 2 * SIGMA_RAD
    assert off["pose"] < 0.5 * off["position"]


def test_data_without_what_it_takes_are_told() -> None:
    dataset = full_poses(8, poses=12)
    model = geometric_model(dataset.robot)
    points_only = dataset.with_points(replace(dataset.points, orientations=None))
    no_sigma = replace(dataset, scanner=replace(dataset.scanner, orientation_sigma_rad=None))
    for bad, says in ((points_only, "found no orientation"), (no_sigma, "orientation_sigma_deg")):
        with pytest.raises(FitError, match=says):
            make_residuals("pose", model, Observations.of(bad)).residual(np.zeros(len(model.parameters)))


def test_calibrate_tells_attitudes_and_full_poses_know_two_parameters_more() -> None:
    dataset = full_poses(9, poses=50)
    result = calibrate(dataset, FitOptions("pose"))
    assert result.orientation_errors is not None
    before, after = result.orientation_errors
    assert after.test.rmse_rad < 3.0 * SIGMA_RAD < 0.2 * before.test.rmse_rad
    assert "attitude of the jig, mrad" in result.summary()
    assert calibrate(dataset).orientation_errors is None
    for robot, points, poses in (("rb5", 19, 21), ("panda", 22, 24)):
        arm = builtin_robot(robot)
        assert structural_rank(arm) == points
        assert structural_rank(arm, residual="pose") == poses
    place, pose = (redundancy(dataset, residual=kind) for kind in ("position", "pose"))
    assert (place.rank, pose.rank) == (21, 23)
    assert "alpha5" in place.dropped or "d5" in place.dropped
    assert {"alpha5", "d5"} <= set(pose.independent)
    # A constant turn behind the last joint is the jig's seat, whatever is measured.
    assert {"theta6", "alphaTCP", "thetaTCP", "betaTCP"} <= set(pose.no_influence)


def test_a_joint_six_that_points_cannot_see_is_seen_by_poses() -> None:
    """With the tool point on joint 6's axis, an eccentric encoder there turns the jig without moving the point."""
    dataset = full_poses(12, poses=60)
    q6 = dataset.poses.q[:, 5]
    given = dataset.points.orientations
    arm = builtin_robot("rb5")
    chain = geometric_model(arm).state(np.zeros(35), dataset.poses).chain
    nominal = PoseResiduals(geometric_model(arm), Observations.of(dataset, np.ones(60, dtype=bool)))
    frame = next(iter(nominal.frames_and_hand_eye(np.zeros(35)).scanner_T_base.values()))
    axis = np.einsum("ij,nj->ni", frame[:3, :3], chain.base_T_frame[:, 5, :3, 2])
    turned = frames.rotation_from_rotvec(2e-3 * np.sin(q6)[:, None] * axis) @ given.scanner_R_jig
    spoiled = dataset.with_points(replace(dataset.points, orientations=replace(given, scanner_R_jig=turned)))
    members = [m for m in family_of(spoiled, "transmission_error").members if m.joint == 5 and m.order == 1]
    seen = calibrate(spoiled, FitOptions("pose"), effects=members).to_frame().set_index("name")
    row = seen.loc["transmission_error.J6.sin1_rad"]
    assert row["change"] == pytest.approx(2e-3, abs=max(5 * row["sigma"], 1e-4))
    blind = calibrate(spoiled, FitOptions("position"), effects=members).to_frame().set_index("name")
    assert abs(blind.loc["transmission_error.J6.sin1_rad", "change"]) < 2e-4


@pytest.mark.parametrize("angle", [1e-3, 0.05, 1.0, 2.5])
def test_second_derivatives_by_a_turn_are_those_of_differences(angle: float) -> None:
    rng = np.random.default_rng(0)
    error, gradient = rng.normal(size=(2, 1, 3))
    error *= angle / np.linalg.norm(error)
    rotation = Rotation.from_rotvec(error[0])

    def cost(turn: np.ndarray) -> float:
        return float(gradient[0] @ (Rotation.from_rotvec(turn) * rotation).as_rotvec())

    step = 1e-4 * np.eye(3)
    differences = [[cost(a + b) - cost(a - b) - cost(b - a) + cost(-a - b) for b in step] for a in step] / np.array(
        4e-8
    )
    np.testing.assert_allclose(_turn_curvature(error, gradient)[0][0], differences, atol=1e-6)


@pytest.mark.parametrize("joint", [1, 4])
def test_frames_and_hand_eye_settle_where_a_joint_turns_the_wrong_way(joint: int) -> None:
    """With residuals as large as the arm the cost's slope by frames and hand-eye vanishes too."""
    made = simulate_dataset("rb5", rng=0, poses=30, orientation_sigma_rad=2e-4, setups=2)
    q = made.dataset.poses.q.copy()
    q[:, joint] *= -1.0
    wrong = with_poses(made.dataset, q=q)
    observed = with_nominal_scanner_frames(Observations.of(wrong), wrong.robot)
    residuals = PoseResiduals(geometric_model(wrong.robot), observed)
    x = np.zeros(len(residuals.parameters))
    residual, columns = residuals.residual(x), residuals.nuisance(x).by_frames
    slope = columns.T @ residual / np.linalg.norm(columns, axis=0)
    assert np.abs(slope).max() < 1e-6 * np.linalg.norm(residual)
