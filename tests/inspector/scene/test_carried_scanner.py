"""An arm that carries the scanner, as it is drawn: the flange stays where the scanner is, the base moves about it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib import calibrate, frames
from calib.calibration.model_versions import LINKS, NOMINAL, versions
from inspector.markup.legend import legend_html
from inspector.report.arm_drawing import arm_drawing
from inspector.scene.arm_shape import arm_of
from inspector.session.session import Session
from inspector.session.transitions import with_calibration, with_versions
from inspector.session.view import View
from tests.support.arms import flange_dataset_of, perturbed, random_arm

RNG = np.random.default_rng(2)
ARM = random_arm(RNG, 6)
CALIBRATION = calibrate(flange_dataset_of(ARM, perturbed(ARM, RNG), RNG, poses=40, test=8, noise_mm=0.02))


def test_the_flange_stays_before_the_scanner_and_the_base_moves() -> None:
    fitted = versions(CALIBRATION)[-1]
    mounted = frames.invert(fitted.evaluation.scanner_T_base[""])
    arms = [arm_of(fitted, pose) for pose in (0, 7, 20)]
    for arm in arms:
        np.testing.assert_allclose(arm.base_T_link[-1], frames.invert(mounted), atol=1e-9)
        ends = arm.end_mm[arm.part == "tool"]
        assert np.min(np.linalg.norm(ends, axis=1)) < 1e-9  # a piece of the arm ends at the scanner
    bases = fitted.scanner_T_base[[0, 7, 20], :3, 3]
    assert np.ptp(bases, axis=0).max() > 100.0


def test_the_report_draws_it() -> None:
    nominal, fitted = versions(CALIBRATION)
    assert arm_drawing(nominal, fitted, ("before", "after"), 3).startswith("<svg")


def test_the_legend_says_from_where_it_is_drawn() -> None:
    session = Session(CALIBRATION.dataset)
    assert "carries the scanner" in legend_html(View(session), {"corners"}, None)
    in_world = replace(CALIBRATION.dataset, robot=ARM)
    assert "carries" not in legend_html(View(Session(in_world)), {"corners"}, None)


def test_other_scans_are_brought_to_the_room_by_the_model_on_show() -> None:
    """The jig of every scan comes to lie on that of the selected one, as far as the model is right."""
    points = CALIBRATION.dataset.points
    session = with_calibration(Session(CALIBRATION.dataset))
    session = with_versions(session, session)
    spread_mm = {}
    for version in versions(CALIBRATION):
        shown = View(session, pose=3, chosen=version.name)
        placed = [
            frames.apply(shown.here_T_scanner(int(p)), xyz) for p, xyz in zip(points.pose, points.xyz_mm, strict=True)
        ]
        spread_mm[version.name] = float(np.linalg.norm(np.std(placed, axis=0)))
    assert spread_mm[NOMINAL] > 0.5
    assert spread_mm[LINKS] < 0.1
    np.testing.assert_array_equal(View(Session(CALIBRATION.dataset)).here_T_scanner(5), np.eye(4))
