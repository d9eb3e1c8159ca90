"""A step gives way to a slow course of what it displaces, and to nothing else."""

from __future__ import annotations

import pytest

from calib import calibrate, diagnose, screen
from calib.effects.catalogue import family_of
from calib.screening.smooth_motions import slow_course
from tests.support.engine.cases import Case, simulate


@pytest.mark.parametrize(
    ("cause", "step", "slow"),
    [
        ("creeping_tool", "target_step", True),
        ("target_step", "target_step", False),
        ("swaying_tripod", "scanner_step", True),
        ("scanner_step", "scanner_step", False),
        ("base_loosening", "base_loosening", False),
    ],
)
def test_what_creeps_or_sways_is_told_from_a_step(cause: str, step: str, slow: bool) -> None:
    dataset = simulate(Case("slow", (cause,), 5, sigmas=(3.0,))).dataset
    found = screen(calibrate(dataset), [family_of(dataset, step)])
    evidence = slow_course(found.projected, found.candidates[0])
    assert evidence > 10.0
    assert (evidence > found.candidates[0].log_evidence + 5.0) == slow


def test_an_effect_that_is_no_step_has_no_slow_course() -> None:
    dataset = simulate(Case("slow", ("joint_scale",), 0, sigmas=(3.0,))).dataset
    found = screen(calibrate(dataset), [family_of(dataset, "joint_scale")])
    assert slow_course(found.projected, found.candidates[0]) == 0.0


@pytest.mark.thorough
def test_a_target_that_creeps_is_not_called_knocked() -> None:
    found = diagnose(simulate(Case("slow", ("creeping_tool",), 2)).dataset)
    assert found.verdict == "unexplained"
    assert found.named == ()
