"""The field's judge: the same for every frame a tool may answer in, blind to what it was handed of the test poses."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from calib import frames
from tests.support import ROOT

sys.path.insert(0, str(ROOT / "benchmarks" / "field"))

from problem import Answer, Problem, judged

RNG = np.random.default_rng(3)
SETUP = np.repeat(["a", "b"], 20)
IS_TEST = np.tile([False, True], 20)
MEASURED = 500.0 * RNG.standard_normal((40, 3))
PROBLEM = Problem(np.zeros((1, 4)), np.zeros((40, 0)), MEASURED, SETUP, IS_TEST)
ANSWER = Answer(MEASURED + 0.1 * RNG.standard_normal((40, 3)), 0, sigma=np.full((40, 3), 0.1))


def test_an_answer_in_any_frame_that_stands_still_within_a_setup_is_judged_alike() -> None:
    moved = ANSWER.points.copy()
    for name, turn in (("a", (0.3, -2.0, 1.0)), ("b", (1.0, 0.4, -0.2))):
        rows = name == SETUP
        moved[rows] = moved[rows] @ frames.rotation_from_rotvec(np.array(turn)).T + 1e3 * np.array(turn)
    there, here = judged(replace(ANSWER, points=moved), PROBLEM, MEASURED), judged(ANSWER, PROBLEM, MEASURED)
    assert there == pytest.approx(here, rel=1e-9)


def test_test_poses_choose_no_frame() -> None:
    off = MEASURED + np.where(IS_TEST, 1.0, 0.0)[:, None] * np.array([3.0, 0.0, 4.0])
    found = judged(replace(ANSWER, points=off), PROBLEM, MEASURED)
    assert (found["training_rms_mm"], found["held_out_rms_mm"]) == pytest.approx((0.0, 5.0), abs=1e-9)
    assert judged(ANSWER, PROBLEM, MEASURED)["coverage_90"] == pytest.approx(0.9, abs=0.08)
