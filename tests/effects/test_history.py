"""What a pose owes to the poses before it: all that were measured count, used by a fit or not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from calib import calibrate, diagnose, screen
from calib.effects.catalogue import family_of
from calib.effects.catalogue.friction import PathFriction, hysteresis, stick_and_slip
from calib.effects.catalogue.thermal import lagged, workload
from calib.effects.catalogue.user_file import check_effects
from calib.effects.effect import Parameter, families_from
from calib.effects.state import RobotState
from calib.simulation.simulate import simulate_dataset
from tests.support.fit_cases import rich_dataset

DATASET = rich_dataset()


def test_the_sequence_is_all_poses_in_the_order_measured() -> None:
    rng = np.random.default_rng(2)
    poses = replace(DATASET.poses, time_s=rng.permutation(40.0 * np.arange(40)), order=np.zeros(0))
    some = poses.select(np.array([30, 4, 17]))
    by_time = np.argsort(poses.time_s if poses.time_s is not None else 0)
    for of in (poses, some, some.select(np.array([2, 0]))):
        np.testing.assert_array_equal(of.sequence.q, poses.q[by_time])
        np.testing.assert_array_equal(of.from_sequence(of.sequence.q), of.q)
    np.testing.assert_array_equal(some.measured_later().from_sequence(poses.q), np.zeros((3, 6)))
    moved = replace(
        some, q=2.0 * some.q, came_from=np.zeros((0, 0))
    )  # another sequence, of which nothing else is known
    assert len(moved.sequence) == 3


def test_friction_winds_up_along_the_way_and_forgets() -> None:
    length = np.radians(10.0)
    z = hysteresis(np.array([0.0, 5.0, 5.01, 4.99]), length)
    np.testing.assert_allclose(z[:2], [0.0, 1.0])
    assert z[2] == pytest.approx(1.0)
    assert z[3] == pytest.approx(-1.0 + 2.0 * np.exp(-0.02 / length))
    fine = hysteresis(np.linspace(0.0, 0.2, 50), length)
    assert fine[-1] == pytest.approx(hysteresis(np.array([0.0, 0.2]), length)[-1])


def test_what_was_before_the_first_pose_fades_along_the_way() -> None:
    q_rad = np.array([0.0, 0.3, 0.1, 1.0])
    at_rest, wound = (hysteresis(q_rad, 0.2, start) for start in (0.0, 1.0))
    np.testing.assert_allclose(wound - at_rest, np.exp(-np.array([0.0, 0.3, 0.5, 1.4]) / 0.2))
    time_s = 40.0 * np.arange(4.0)
    cold, warm = (workload(q_rad, time_s, 100.0, warm=warm) for warm in (False, True))
    np.testing.assert_allclose(warm - cold, 1.4 / 120.0 * np.exp(-time_s / 100.0))


def test_a_slider_remembers_what_a_small_move_and_its_way_back_left_alone() -> None:
    q_rad = np.array([0.0, 1.0, 0.9, 1.0])
    np.testing.assert_allclose(stick_and_slip(q_rad, 0.5), [0.0, 1.0, 0.8, 1.0])
    assert hysteresis(q_rad, 0.5)[3] < hysteresis(q_rad, 0.5)[1]


def test_links_follow_the_temperature_with_a_lag() -> None:
    time_s = np.array([0.0, 100.0, 400.0])
    np.testing.assert_allclose(lagged(np.array([20.0, 21.0, 21.0]), time_s, 100.0), 21.0 - np.exp(-time_s / 100.0))


def test_poses_left_out_are_part_of_the_history() -> None:
    member = next(m for m in family_of(DATASET, "path_friction").members if isinstance(m, PathFriction))
    whole = member.shapes(RobotState.nominal(DATASET.robot, DATASET.poses))
    rows = np.arange(1, 40, 3)
    some = member.shapes(RobotState.nominal(DATASET.robot, DATASET.poses.select(rows)))
    np.testing.assert_array_equal(some, whole[rows])


@dataclass(frozen=True)
class WoundUp:
    """As in a user's file: the play of a joint, by the whole sequence of poses."""

    joint: int
    parameters = (Parameter("h_rad", unit="rad", scale=3e-4),)
    linear = True

    def apply(self, state: RobotState, *, h_rad: float) -> RobotState:
        q_rad = state.poses.sequence.q[:, self.joint]
        wound = np.zeros(len(q_rad))
        for k in range(1, len(q_rad)):
            side = np.sign(q_rad[k] - q_rad[k - 1])
            wound[k] = side + (wound[k - 1] - side) * np.exp(-abs(q_rad[k] - q_rad[k - 1]) / 0.5)
        return state.add_joint_error(self.joint, h_rad * state.poses.from_sequence(wound))


@pytest.mark.slow
def test_friction_is_told_from_following_and_a_users_effect_knows_as_much() -> None:
    dataset = simulate_dataset(
        "rb5",
        rng=np.random.default_rng([77, 0]),
        effects=(("path_friction", 1.5),),
        poses=80,
        conditions=True,
        noise_mm=0.05,
    ).dataset
    assert diagnose(dataset).missing == ("path_friction",)
    families = [family_of(dataset, "path_friction"), *families_from([WoundUp(joint) for joint in range(6)])]
    candidates = {c.name: c for c in screen(calibrate(dataset), families).candidates}
    assert candidates["wound_up"].log_evidence > 0.8 * candidates["path_friction"].log_evidence


def test_heat_is_a_running_average_of_speed() -> None:
    """The response to one move, and to even work for a long time."""
    time_s = np.array([0.0, 10.0, 310.0])
    heat = workload(np.array([0.0, 1.0, 1.0]), time_s, 300.0)
    assert heat[0] == 0.0
    assert heat[1] == pytest.approx(0.1 * (1.0 - np.exp(-10.0 / 300.0)))
    assert heat[2] == pytest.approx(heat[1] * np.exp(-1.0))
    even = workload(0.02 * np.arange(0.0, 9000.0, 30.0), np.arange(0.0, 9000.0, 30.0), 300.0)
    assert even[-1] == pytest.approx(0.02)


class Wave:
    """As in a user's file: at size zero the phase does nothing."""

    parameters = (Parameter("size_rad", unit="rad", scale=1e-4), Parameter("phase_rad", unit="rad", scale=1.0))

    def apply(self, state: RobotState, *, size_rad: float, phase_rad: float) -> RobotState:
        return state.add_joint_error(0, size_rad * np.sin(state.q_rad[:, 0] + phase_rad))


def test_a_users_parameter_without_a_derivative_at_zero_is_noted() -> None:
    state = RobotState.nominal(DATASET.robot, DATASET.poses)
    (wave,) = check_effects([Wave()], state)
    assert wave.note.startswith("phase_rad changes nothing to first order while all parameters are zero")
    assert "sine and a cosine" in wave.note
    (wound,) = check_effects([WoundUp(1)], state)
    assert wound.note == ""
