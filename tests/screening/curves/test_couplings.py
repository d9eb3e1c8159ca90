"""Couplings of all joints: what they add up to, by hand; that noise teaches none; the file that they are written to."""

from __future__ import annotations

import numpy as np
import pytest

from calib import calibrate
from calib.diagnosis.effect_selection import calibrate_with, selected_curves
from calib.effects.state import RobotState
from calib.models.effect_fields import member_document
from calib.screening.curves.couplings import coupling_inputs, learn_couplings
from calib.screening.curves.fitted_curves import fitted_curves
from calib.screening.curves.joint_curves import LearnedCurves
from calib.screening.curves.readings import coupling_readings, curve_readings
from calib.screening.curves.smooth_joint_error import CouplingModes, SmoothJointError
from calib.screening.projected_residual import project_residual
from tests.support.engine.cases import Case, Simulated, simulate


@pytest.fixture(scope="module")
def nothing() -> Simulated:
    """An arm of the second simulator in which nothing is hidden."""
    return simulate(Case("null", (), 7, seed=5))


def test_they_are_sines_and_cosines_of_angles_sums_and_differences(nothing: Simulated) -> None:
    state = RobotState.nominal(nothing.dataset.robot, nothing.dataset.poses)
    weights = np.array([[1.0, 0.0], [0.0, 2.0], [0.0, 0.0], [3.0, 0.0]])
    q = nothing.dataset.poses.q
    found = CouplingModes(("q2", "q4-q5"), weights).at_state(state)
    assert found[:, 0] == pytest.approx(np.sin(q[:, 1]) + 3.0 * np.cos(q[:, 3] - q[:, 4]), abs=1e-12)
    assert found[:, 1] == pytest.approx(2.0 * np.cos(q[:, 1]), abs=1e-12)
    inputs = coupling_inputs(nothing.dataset.robot)
    turning = sum(joint.is_revolute for joint in nothing.dataset.robot.joints)
    assert len(set(inputs)) == len(inputs) == turning**2


def test_nothing_hidden_teaches_none(nothing: Simulated) -> None:
    assert learn_couplings(project_residual(calibrate(nothing.dataset))) is None


def test_they_are_fitted_and_read(nothing: Simulated) -> None:
    dataset = nothing.dataset
    modes = CouplingModes(("q1", "q2+q3", "q1-q3"), np.linalg.qr(np.random.default_rng(1).standard_normal((6, 2)))[0])
    curves = LearnedCurves((SmoothJointError(1, modes, (1e-4, 1e-4)),), 10.0)
    fitted = calibrate_with(dataset, [selected_curves(curves)])
    assert fitted_curves(fitted) == curve_readings(fitted) == ()
    (reading,) = coupling_readings(fitted)
    assert (reading.joint, reading.parameters, set(reading.strongest)) == (2, 2, set(modes.inputs))
    (member,) = [one for one in fitted.model.added_effects if isinstance(one, SmoothJointError)]
    assert member_document(member)["fields"]["modes"]["inputs"] == list(modes.inputs)
