"""Plans for fits and for arms: the prediction against simulated truth, and what a plan says."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from calib import calibrate
from calib.dataset.dataset import Box, Poses
from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.planning.criterion import EffectOutcome, ForCalibration, ForEffects
from calib.planning.plan import Plan, criterion_of, plan_poses
from calib.planning.prediction import enough_poses
from calib.planning.start import FromFit, FromRobot
from calib.present.plans.plans import assumptions, told
from calib.simulation.pose_design import draw_scanner_pose, scan_poses
from calib.simulation.simulate import measure
from calib.simulation.truth.arm_sampling import draw_truth
from calib.workcell.known_cell import workcell_of_robot

RB5 = builtin_robot("rb5")
SCANNER = draw_scanner_pose(RB5, rng=np.random.default_rng(0))
NOISE_MM = 0.05


def measured(q: np.ndarray, test: int, seed: int):
    """An arm with errors of its own, measured at joints (N, n), the last of which are test poses."""
    rng = np.random.default_rng(seed)
    role = np.full(len(q), "train", dtype="<U9")
    role[0], role[len(q) - test :] = "reference", "test"
    ids = tuple(f"p{i + 1:02d}" for i in range(len(q)))
    poses = Poses(ids, role, q, np.full(len(q), ""), ids)
    truth = draw_truth(RB5, SCANNER, q, rng=rng)
    return measure(RB5, truth, poses, rng=rng, name="arm", noise_mm=NOISE_MM)


@pytest.fixture(scope="module")
def seen() -> np.ndarray:
    return scan_poses(RB5, SCANNER, 140, rng=np.random.default_rng(7))


@pytest.fixture(scope="module")
def start(seen: np.ndarray) -> FromFit:
    return FromFit(calibrate(measured(seen[:40], 15, 0).dataset))


@pytest.fixture(scope="module")
def plan(start: FromFit) -> Plan:
    return plan_poses(start, 5, candidates=100)


@pytest.fixture(scope="module")
def first_set() -> Plan:
    return plan_poses(FromRobot(workcell_of_robot(RB5, base_T_scanner=SCANNER)), 20, candidates=200)


@pytest.mark.slow
def test_more_poses_never_raise_the_predicted_error(plan: Plan, first_set: Plan) -> None:
    assert np.all(np.diff(plan.curve_mm) < 0.0)
    assert np.all(np.diff(first_set.curve_mm[1:]) < 0.0)
    assert plan.curve_mm[5] == pytest.approx(plan.then.geometry_mm)
    assert first_set.curve_mm[20] == pytest.approx(first_set.then.geometry_mm)


def test_a_first_set_has_a_reference_and_says_what_it_assumes(first_set: Plan) -> None:
    assert first_set.poses.role.tolist() == ["reference", *["train"] * 19]
    assert first_set.poses.ids[0] == "p01"
    assert "noise of 50 µm" in assumptions(first_set)[0]
    assert first_set.now.geometry_mm > 1.0  # as large as tolerances
    assert first_set.enough is None or first_set.enough > 20


@pytest.mark.slow
def test_arms_that_are_measured_as_planned_have_the_predicted_error(first_set: Plan, seen: np.ndarray) -> None:
    """Errors and noise of 12 arms from the simulated truth, which shares no code with the plan."""
    q = np.concatenate([first_set.poses.q, seen[:60]])
    squares = []
    for seed in range(12):
        simulated = measured(q, 60, seed)
        errors = calibrate(simulated.dataset).after
        test = errors.is_test[errors.pose]
        noise_mm = simulated.dataset.points.xyz_mm - simulated.apex_mm
        squares.append(np.mean(np.sum((errors.error_mm + noise_mm)[test] ** 2, axis=1)))
    assert np.sqrt(np.mean(squares)) == pytest.approx(first_set.then.geometry_mm, rel=0.15)


@pytest.mark.slow
def test_a_suspected_effect_is_known_better_by_poses_planned_for_it(start: FromFit) -> None:
    for_it = plan_poses(start, 5, candidates=100, criterion=ForEffects(("joint_compliance",)), region="measurable")
    assert for_it.region == "the poses that can be measured"
    assert for_it.poses.payload_kg is None
    assert isinstance(for_it.outcome, EffectOutcome)
    assert all(c.after < c.before for c in for_it.outcome.coefficients if ".J2." in c.name)
    assert told(for_it.outcome).sentences[0].startswith("sigma of joint_compliance.J")
    with pytest.raises(CalibError, match="joint_dent"):
        plan_poses(start, 5, candidates=100, criterion=ForEffects(("joint_dent",)))


@pytest.mark.slow
def test_an_effect_is_planned_under_the_conditions_that_it_shows_under(start: FromFit) -> None:
    both = plan_poses(start, 6, candidates=80, criterion=criterion_of("backlash"))
    assert both.poses.approach is not None
    assert set(np.unique(both.poses.approach)) == {-1.0, 1.0}
    assert isinstance(both.outcome, EffectOutcome)
    assert both.outcome.conditions == both.outcome.unrecorded == ("approach",)
    loads = plan_poses(start, 6, candidates=80, criterion=criterion_of("joint_compliance", payload_kg=2.0))
    assert loads.poses.payload_kg.tolist() == sorted(loads.poses.payload_kg)  # mounted once
    assert set(loads.poses.payload_kg) <= {0.0, 2.0}
    assert 2.0 in loads.poses.payload_kg


def test_a_fit_that_leaves_more_than_noise_is_told(start: FromFit) -> None:
    dataset = start.calibration.dataset
    finer = replace(dataset, scanner=replace(dataset.scanner, point_sigma_mm=0.005))
    next_poses = plan_poses(FromFit(calibrate(finer)), 2, candidates=60)
    assert "declared noise" in assumptions(next_poses)[0]


@pytest.mark.slow
def test_a_way_through_a_wall_is_told() -> None:
    wall = Box("wall", (300.0, -5.0, 100.0), (900.0, 5.0, 1200.0))
    cell = workcell_of_robot(RB5, base_T_scanner=SCANNER)
    parted = plan_poses(FromRobot(replace(cell, boxes=(wall,))), 20, candidates=100)
    sides = set(np.sign(cell.chain(parted.poses.q).target_mm[:, 1]))
    assert sides == {-1.0, 1.0}
    assert parted.blocked
    assert set(parted.blocked) <= set(pairwise(parted.poses.ids))


def test_when_more_poses_no_longer_pay() -> None:
    assert enough_poses(1.0 / np.sqrt(np.arange(1.0, 80.0))) == 46
    assert enough_poses(np.array([3.0, 2.0, 1.0])) is None


def test_what_cannot_be_planned(start: FromFit) -> None:
    with pytest.raises(CalibError, match="ask for 1 or more"):
        plan_poses(start, 0)
    with pytest.raises(CalibError, match="no region 'here'"):
        plan_poses(start, 3, region="here")
    assert criterion_of("calibration") == ForCalibration()
    assert criterion_of("backlash, joint_compliance") == ForEffects(("backlash", "joint_compliance"))
