"""Scanner on the flange, targets in the world: derivatives by differences, recovery, invariances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, redundancy
from calib.effects.catalogue import effects_for
from calib.effects.link_errors import LinkErrors, TargetOffsets
from calib.errors import FitError
from calib.fitting.model import Model
from calib.fitting.observations import Observations, with_nominal_scanner_frames, with_observed_targets
from calib.identifiability.structural import free_frame_rank, structural_rank
from calib.identifiability.tool_rows import tool_rows
from calib.kinematics.robot import FixedFrame, Robot
from calib.options import FitOptions
from calib.present.fit.calibration import calibration_warnings
from calib.present.fit.redundancy import free_frame_sentence, tool_sentence
from calib.rendering.blocks import plain
from tests.support.arms import flange_dataset_of, perturbed, random_arm
from tests.support.changed import with_poses
from tests.support.fit_cases import check_last_columns, label, rich_dataset, some_of

RICH = rich_dataset()
RICH = replace(RICH, robot=replace(RICH.robot, carries_scanner=True))
MEMBERS = [member for family in effects_for(RICH) for member in some_of(family)[-1:]]


@pytest.mark.parametrize("effect", [*MEMBERS, LinkErrors(RICH.robot)], ids=label)
def test_the_jacobian_of_place_and_attitude_is_the_derivative(effect) -> None:
    """Analytic and numerical derivatives agree for each effect and the jig's place, away from zero."""
    rng = np.random.default_rng(1)
    observed = Observations.of(RICH)
    robot = with_observed_targets(RICH.robot, observed)
    observed = with_nominal_scanner_frames(observed, robot)
    poses, seen = observed.used_poses[0], observed.seen()
    links = () if isinstance(effect, LinkErrors) else (LinkErrors(robot),)
    jig = TargetOffsets(tuple(target for target in robot.targets if target.in_world))
    model = Model(robot, (*links, jig, effect))
    x = rng.normal(size=len(model.parameters)) * np.minimum(model.scales, 10.0) * 0.3
    check_last_columns(model, len(effect.parameters) + 3, poses, seen, x)


@pytest.mark.parametrize("joints", [5, 6, 7])
def test_exact_data_are_met_without_a_first_guess(joints: int) -> None:
    rng = np.random.default_rng(joints)
    nominal = random_arm(rng, joints)
    dataset = flange_dataset_of(nominal, perturbed(nominal, rng), rng, poses=60, test=20)
    result = calibrate(dataset)
    assert result.fit.converged
    assert result.before.test.rmse_mm > 1.0
    assert result.after.test.rmse_mm < 1e-8
    assert calibration_warnings(result) == ()
    assert result.fit.rank == structural_rank(dataset.robot)


def test_several_mounts_and_targets_share_one_arm() -> None:
    """A third mount of the scanner has test poses only: its place comes from these, the target's from the others."""
    rng = np.random.default_rng(8)
    nominal = random_arm(rng, 6)
    dataset = flange_dataset_of(
        nominal, perturbed(nominal, rng), rng, poses=99, test=20, targets=("jig", "west"), setups=("A", "B", "C")
    )  # fmt: skip
    role = np.where((dataset.poses.setup == "C") & (dataset.poses.role == "train"), "test", dataset.poses.role)
    dataset = with_poses(dataset, role=role)
    result = calibrate(dataset)
    assert result.after.test.rmse_mm < 1e-7
    assert "'C'" in calibration_warnings(result)[0]
    assert " ".join(p.name for p in result.fit.parameters[-6:]) == "jig.x jig.y jig.z west.x west.y west.z"


def test_full_poses_are_met() -> None:
    rng = np.random.default_rng(3)
    nominal = random_arm(rng, 6)
    dataset = flange_dataset_of(nominal, perturbed(nominal, rng), rng, poses=30, test=10, full_poses=True)
    result = calibrate(dataset, FitOptions(residual="pose"))
    assert result.after.test.rmse_mm < 1e-7
    assert result.orientation_errors[1].test.rmse_rad < 1e-9
    assert result.fit.rank == structural_rank(dataset.robot, residual="pose")


def test_the_base_and_the_jig_moved_together_change_nothing() -> None:
    rng = np.random.default_rng(5)
    nominal = random_arm(rng, 6)
    dataset = flange_dataset_of(nominal, perturbed(nominal, rng), rng, poses=60, test=20, noise_mm=0.05)
    moved = replace(dataset.robot, base=FixedFrame((300.0, -20.0, 700.0), (0.4, -1.0, 2.0)))
    one, other = calibrate(dataset), calibrate(replace(dataset, robot=moved))
    np.testing.assert_allclose(one.after.error_mm, other.after.error_mm, atol=2e-4)
    assert one.fit.rank == other.fit.rank


def test_the_tool_and_the_last_row_do_not_show() -> None:
    rng = np.random.default_rng(6)
    nominal = random_arm(rng, 6)
    dataset = flange_dataset_of(nominal, nominal, rng, poses=40)
    robot = nominal.with_table(nominal.table + np.array([[0.0] * 5] * 6 + [[3.0, 0.1, -5.0, 0.2, 0.1]]))
    other = replace(dataset, robot=replace(robot, carries_scanner=True))
    assert calibrate(other).before.train.rmse_mm < 1e-9
    assert set(redundancy(dataset).no_influence) == {"aTCP", "alphaTCP", "dTCP", "thetaTCP", "betaTCP"}
    assert "a scanner on the flange does not see the tool" in plain(tool_sentence(tool_rows(dataset)))
    unknown = free_frame_rank(dataset)
    assert unknown.here == unknown.best["position"]
    assert "With the scanner's place on the flange unknown, positions determine" in free_frame_sentence(unknown)


@pytest.mark.parametrize("kind", ["distance", "pairs"])
def test_distances_are_refused(kind: str) -> None:
    rng = np.random.default_rng(7)
    nominal = random_arm(rng, 6)
    dataset = flange_dataset_of(nominal, nominal, rng)
    for asked in (
        lambda: calibrate(dataset, FitOptions(residual=kind)),
        lambda: redundancy(dataset, residual=kind),
    ):
        with pytest.raises(FitError, match="a jig that stands still, and distances between poses are not the arm's"):
            asked()


def _turning(arm: Robot, kinds: list[str], alphas: list[float]) -> Robot:
    """The arm with other joint types and other angles between the axes."""
    changed = zip(arm.joints, kinds, alphas, strict=True)
    return replace(arm, joints=tuple(replace(j, type=kind, alpha_rad=alpha) for j, kind, alpha in changed))


def test_what_the_poses_leave_open_is_said() -> None:
    rng = np.random.default_rng(9)
    scara = _turning(random_arm(rng, 4), ["revolute"] * 2 + ["prismatic", "revolute"], [0.0] * 4)
    result = calibrate(flange_dataset_of(scara, scara, rng, poses=40, noise_mm=0.01))
    assert "along (0.00, 0.00, 1.00) of the base frame" in calibration_warnings(result)[0]
    gantry = _turning(random_arm(rng, 3), ["prismatic"] * 3, [0.5 * np.pi] * 3)
    result = calibrate(flange_dataset_of(gantry, gantry, rng, poses=40, noise_mm=0.01))
    assert "in all directions the positions of targets" in calibration_warnings(result)[0]
    still = flange_dataset_of(gantry, gantry, rng, q=np.zeros((40, 3)))
    with pytest.raises(FitError, match="how the scanner is turned"):
        calibrate(still)


def test_a_target_of_test_poses_alone_is_refused() -> None:
    rng = np.random.default_rng(10)
    nominal = random_arm(rng, 6)
    dataset = flange_dataset_of(nominal, nominal, rng, poses=40, test=10)
    points = dataset.points
    assert points is not None
    target = np.where(dataset.poses.is_test, "east", "jig")
    with pytest.raises(FitError, match="'east'"):
        calibrate(replace(dataset, points=replace(points, target=target)))
