"""Signals as inputs of learned curves and of a user's effects: a second body's joints, torques, the pose before."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import calibrate
from calib.dataset.files.folder import load_dataset
from calib.effects.catalogue.user_file import load_effects
from calib.errors import CalibError
from calib.fitting.observations import nominal_state
from calib.screening.curves.joint_curves import learn_joint_curves
from tests.support.mujoco_arm import in_mujoco, mujoco, mujoco_model
from tests.support.signal_cell import Measured, measured, write

N = 70
NOD_RAD, LATE, STRETCH_MM = 1.5e-3, 2e-4, 0.004

EFFECTS = '''
from dataclasses import dataclass

import numpy as np

from calib import Parameter


@dataclass(frozen=True)
class Torso:
    """A torso that nods under the weight of its other arm."""

    parameters = (Parameter("nod_rad", unit="rad", scale=1e-3),)
    linear = True

    def apply(self, state, *, nod_rad):
        held_out = np.cos(np.radians(state.column("load_left_q1_deg")))
        return state.turn_base(np.outer(nod_rad * held_out, [0.0, 1.0, 0.0]))


@dataclass(frozen=True)
class Late:
    """Joint 5 stops short of its way."""

    parameters = (Parameter("share", unit="1", scale=1e-4),)
    linear = True

    def apply(self, state, *, share):
        return state.add_joint_error(4, share * (state.q_rad - state.previous_q_rad)[:, 4])


@dataclass(frozen=True)
class Stretched:
    """A tool that gives way along its own z by the torque that joint 2 reads."""

    parameters = (Parameter("by_nm_mm", unit="mm/Nm", scale=1e-3),)
    linear = True

    def apply(self, state, *, by_nm_mm):
        return state.displace(by_nm_mm * state.column("torque2_nm")[:, None] * state.attitude[:, :, 2])
'''


@pytest.fixture(scope="module")
def cell() -> tuple[Measured, dict]:
    """An arm on a nodding torso, read late, with a soft tool; the compliance of its joints is in its motor torques."""
    mujoco()
    rng = np.random.default_rng(4)
    q = measured(N).q
    late = np.zeros_like(q)
    late[1:, 4] = LATE * np.diff(q[:, 4])
    arm = measured(N, further=late)
    columns = {"load_left_q1_deg": rng.uniform(-80.0, 80.0, N), "torque2_nm": -arm.torque_nm[:, 1]}
    model = mujoco_model(arm.robot)
    tool_z = np.array([in_mujoco(model, arm.robot, one).site("target").xmat.reshape(3, 3)[:, 2] for one in arm.link_q])
    nod = NOD_RAD * np.cos(np.radians(columns["load_left_q1_deg"]))
    turn = Rotation.from_rotvec(np.outer(nod, [0.0, 1.0, 0.0]))
    point_mm = turn.apply(arm.point_mm) + STRETCH_MM * columns["torque2_nm"][:, None] * turn.apply(tool_z)
    return Measured(arm.robot, arm.q, arm.link_q, arm.torque_nm, point_mm), columns


def test_a_users_effect_reaches_another_body_the_pose_before_torque_and_attitude(
    cell: tuple[Measured, dict], tmp_path: Path
) -> None:
    dataset = write(tmp_path / "cell", *cell, masses=True)
    (tmp_path / "effects.py").write_text(EFFECTS, encoding="utf-8")
    families = load_effects(tmp_path / "effects.py", nominal_state(dataset))
    fit = calibrate(dataset, effects=["joint_compliance", *families])
    found = fit.fit.by_name
    for name, truth in (
        ("torso.nod_rad", NOD_RAD),
        ("late.share", LATE),
        ("stretched.by_nm_mm", STRETCH_MM),
    ):
        value, sigma = found[name]
        assert abs(value - truth) < 4.0 * sigma, name
        assert sigma < 0.2 * truth, name
    assert fit.sigma_mm < 0.036


def test_a_column_that_is_not_there_is_told_by_its_name(cell: tuple[Measured, dict], tmp_path: Path) -> None:
    dataset = write(tmp_path / "cell", cell[0], {}, masses=True)
    (tmp_path / "effects.py").write_text(EFFECTS, encoding="utf-8")
    with pytest.raises(CalibError, match=r"effects\.py.*column 'load_left_q1_deg' is needed"):
        load_effects(tmp_path / "effects.py", nominal_state(dataset))


@pytest.mark.slow
def test_a_curve_is_learned_over_a_joint_of_another_body(tmp_path: Path) -> None:
    """A torso that turns about the first joint's axis as its other arm swings, by no law of the catalogue."""
    mujoco()
    other_deg = np.random.default_rng(7).uniform(-80.0, 80.0, N)
    swung = np.zeros((N, 6))
    swung[:, 0] = 1e-3 * np.tanh(other_deg / 25.0)
    write(tmp_path / "cell", measured(N, further=swung), {"load_left_q1_deg": other_deg}, masses=True)
    dataset = load_dataset(tmp_path / "cell")
    learned = learn_joint_curves(calibrate(dataset, effects=["joint_compliance"]))
    assert [(member.joint, member.modes.input) for member in learned.members] == [(0, "load_left_q1_deg")]
    with_curve = calibrate(dataset, effects=["joint_compliance", *learned.members])
    assert with_curve.sigma_mm < 0.05
    assert calibrate(dataset, effects=["joint_compliance"]).sigma_mm > 0.2
