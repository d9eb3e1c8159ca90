"""What is said of faults, poses, inputs and moves."""

from __future__ import annotations

from dataclasses import replace

from calib.calibration.held_out import HeldOutTest
from calib.diagnosis.headline import HeldOutError
from calib.present.diagnosis.diagnosis import residual_tests
from calib.present.diagnosis.verdict import fault, promise, residual
from calib.rendering.blocks import Reference, plain
from calib.screening.residual_tests import InputTest, ResidualTests
from calib.screening.scan_statistic import Channel
from calib.screening.smooth_motions import JointFault

SWAY = JointFault("smooth", 0, 12.4, 2e-4, "rad", 0.22)
NOISE = ResidualTests(0.5, 0.05, "repeats", 0.06, (), ())


def test_faults_count_joints_from_one_and_tell_what_shows_at_the_tool() -> None:
    """Not the motion itself: most of one that is nearly a link error is absorbed, and 70 deg may leave 0.22 mm."""
    assert plain(fault(SWAY)).startswith("joint 1 moves the tool by about 0.22 mm")
    assert Reference("joint", 1, "joint 1") in fault(SWAY)


def test_noise_is_not_said_of_test_poses_that_are_off_by_more() -> None:
    said = plain(residual(NOISE, HeldOutError(0.0395, 6.36)))
    assert said == "What is left: noise at the training poses; 40 µm at the test poses, 6.4 times the noise."
    assert plain(residual(NOISE, None)) == "What is left: noise."
    assert "0.20 mm" in promise(HeldOutTest(13, 0.2, 0.1, 2.1, 1e-9))


def test_the_residual_names_its_inputs_its_fault_and_the_poses_that_stand_out() -> None:
    first = InputTest("q2", 1e-3, Channel(joint=1))
    words = residual_tests(replace(NOISE, inputs=(first,), fault=SWAY, outlier_poses=("p1", "p2")), NOISE.residual_mm)
    assert Reference("joint", 2, "joint 2 (q2)") in words
    assert {Reference("pose", "p1", "p1"), Reference("pose", "p2", "p2")} <= set(words)
    assert "depends systematically on joint 2 (q2) (p = 0.001)" in plain(words)
    without = residual_tests(replace(NOISE, inputs=(replace(first, p_value=0.6),)), NOISE.residual_mm)
    assert "does not depend systematically on any of 1 input " in plain(without)
    along = replace(NOISE, inputs=(InputTest("x", 1e-3, Channel(axis="z")),))
    assert "along z of the instrument's frame" in plain(residual_tests(along, NOISE.residual_mm))
