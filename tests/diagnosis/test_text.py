"""Sentences with their facts, and the words that they become."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from calib.calibration.held_out import HeldOutTest
from calib.calibration.result import Calibration
from calib.diagnosis.advice import Advice, advice_text, move_text
from calib.diagnosis.moves import AddEffect, DropEffect, LeaveOutPoses
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.words import conclusions
from calib.diagnosis.words import sentences as facts
from calib.diagnosis.words.conclusion_text import residual_summary_text, verdict_text
from calib.diagnosis.words.phrases import fault_text, poses_text
from calib.diagnosis.words.text import explanation_text, reason_text
from calib.screening.candidates import Candidate
from calib.screening.scan_statistic import Channel
from calib.screening.smooth_motions import JointFault

SWAY = JointFault("smooth", 0, 12.4, 2e-4, "rad", 0.22)


def test_faults_count_joints_from_one_and_tell_what_shows_at_the_tool() -> None:
    """Not the motion itself: most of one that is nearly a link error is absorbed, and 70 deg may leave 0.22 mm."""
    assert fault_text(SWAY) == (
        "joint 1 moves the tool by about 0.22 mm, beyond what links could, in a way that changes smoothly with the "
        "arm's attitude"
    )


def test_poses_are_told_in_degrees_and_millimetres() -> None:
    pose = facts.DiscriminatingPose(np.array([np.pi / 2, 120.0]), 0.123)
    assert poses_text([pose, pose], np.array([True, False])) == ("(90, 120): 0.12 mm apart; (90, 120): 0.12 mm apart")


@pytest.mark.parametrize(
    ("verdict", "says"),
    [
        (
            conclusions.Adequate(True, ("backlash",)),
            "adequate. Nothing in the catalogue is missing beyond noise, as far as these data can tell (backlash: not "
            "testable), and nothing else shows.",
        ),
        (
            conclusions.Adequate(False, ()),
            "adequate. These data can test none of the catalogue's effects; what is left is no more than noise, and "
            "nothing else shows.",
        ),
        (
            conclusions.Named(("backlash",), None),
            "What is missing is backlash. With it nothing else shows.",
        ),
        (
            conclusions.Unexplained((), "promise", "", held_out=HeldOutTest(13, 0.2, 0.1, 2.1, 1e-9)),
            "unexplained. No effect of the catalogue fits: the test poses are off by 0.20 mm, where the noise and what "
            "the fit does not know promise 0.10 mm: they were measured in another way or on another day, or they show "
            "what the training poses do not. Measure training poses like them.",
        ),
        (
            conclusions.Named(("backlash", "tool_sag"), 7),
            "What is missing is backlash and tool_sag. With them nothing else shows. But the 7 test points do not "
            "confirm it: they got worse, though by no more than their scatter. Take it for a "
            "lead, and measure more poses.",
        ),
        (
            conclusions.Ambiguous(("backlash",), ("a", "b")),
            "ambiguous after backlash. The set above holds the cause if the catalogue does.",
        ),
        (
            conclusions.Unexplained((), "implausible", "the points do not belong to these poses"),
            "unexplained. The points do not belong to these poses.",
        ),
        (
            conclusions.Unexplained(("backlash",), "fault", ""),
            "unexplained. backlash helps, yet what is left tells of something else, said above. Look at that joint. "
            "backlash is suspected, not shown: what causes the rest may cause its part too. Do not open a gear for it.",
        ),
        (
            conclusions.Unexplained((), "order", ""),
            "unexplained. No effect of the catalogue fits: something with a pattern is left. Look at the inputs named "
            "above; a loose part or a hose would show so.",
        ),
        (
            conclusions.Unexplained(("a", "b"), "size", ""),
            "unexplained. a and b help, yet more than noise is left, without a pattern against any input. a "
            "and b are suspected, not shown: what causes the rest may cause their part too. Do not open a gear for "
            "them.",
        ),
        (
            conclusions.Ambiguous((), ("a", "b"), ("backlash",)),
            "ambiguous. The set above holds the cause if the catalogue does. backlash is suspected, not shown: what "
            "causes the rest may cause its part too. Do not open a gear for it.",
        ),
        (
            conclusions.Unexplained((), "refused", ""),
            "unexplained. No effect of the catalogue fits: what was found makes the test poses worse.",
        ),
        (
            conclusions.Outliers(("backlash",), ("p1",)),
            "outliers. What is missing is backlash. Apart from single poses nothing is left. Measure those poses again "
            "before you leave them out.",
        ),
    ],
)
def test_each_verdict_has_its_words(verdict: conclusions.VerdictSentence, says: str) -> None:
    assert verdict_text(verdict) == says


AT = conclusions.AtPose("p12", 0.684)
COMPLIANCE = conclusions.Cause("joint_compliance", (2, 5, 3), "0.051°", AT, "the compliance of joint")
STEP = conclusions.Cause(
    "joint_step", (5,), "joint 5 is off by -0.23° from pose p37 on", None, "a step in the zero of joint"
)


@pytest.mark.parametrize(
    ("verdict", "begins"),
    [
        (
            conclusions.Named(("joint_compliance",), None, causes=(COMPLIANCE,)),
            "What is missing is the compliance of joint 2, less of joints 3 and 5 (joint_compliance): 0.051°, 0.68 mm "
            "at pose p12. With it nothing else shows.",
        ),
        (
            conclusions.Named(("joint_compliance", "joint_step"), None, causes=(COMPLIANCE, STEP)),
            "What is missing is the compliance of joint 2, less of joints 3 and 5 (joint_compliance): 0.051°, 0.68 mm "
            "at pose p12; and a step in the zero of joint 5 (joint_step): joint 5 is off by -0.23° from pose p37 on. "
            "With them",
        ),
        (
            conclusions.Named(("warp",), None, causes=(conclusions.Cause("warp", (3,), "", AT),)),
            "What is missing is warp of joint 3: 0.68 mm at pose p12. ",
        ),
        (
            conclusions.Adequate(True, (), left=conclusions.AtPose("p7", 0.0123)),
            "adequate: at most 12 µm at pose p7 is left. ",
        ),
        (
            conclusions.Ambiguous((), ("a", "b"), left=AT, joints=(4,)),
            "ambiguous: something of joint 4 makes up to 0.68 mm at pose p12. ",
        ),
        (
            conclusions.Ambiguous((), ("a", "b"), left=AT),
            "ambiguous: something makes up to 0.68 mm at pose p12. ",
        ),
        (
            conclusions.Unexplained((), "order", "", AT, 6),
            "unexplained: up to 0.68 mm at pose p12 has no known cause, most of it in the motion of joint 6. ",
        ),
        (
            conclusions.Unexplained((), "size", "", AT),
            "unexplained: up to 0.68 mm at pose p12 has no known cause. ",
        ),
        (
            conclusions.Outliers((), ("p12", "p3"), AT),
            "outliers: pose p12 is off by 0.68 mm, and p3 stands out too. ",
        ),
    ],
)
def test_joint_size_and_pose_stand_in_the_first_sentence(verdict: conclusions.VerdictSentence, begins: str) -> None:
    assert verdict_text(verdict).startswith(begins)


def test_noise_is_not_said_of_test_poses_that_are_off_by_more() -> None:
    held_out = conclusions.HeldOutError(0.0395, 6.36)
    said = verdict_text(conclusions.Named(("a",), None, held_out=held_out))
    assert "nothing else shows at the training poses; the test poses are off by 40 µm, 6.4 times the noise" in said
    left = conclusions.ResidualSummary(None, (), False, (), held_out)
    assert (
        residual_summary_text(left)
        == "What is left: noise at the training poses; 40 µm at the test poses, 6.4 times the noise."
    )


def test_a_verdict_points_to_where_its_reasons_stand() -> None:
    tied = conclusions.Ambiguous((), ("a", "b"))
    assert verdict_text(tied, reasons="below").startswith("ambiguous. The set below holds")
    assert verdict_text(tied, tied="a or b") == (
        "ambiguous. These data cannot tell which: a or b. This set holds the cause if the catalogue does."
    )
    assert "said below" in verdict_text(conclusions.Unexplained((), "fault", ""), reasons="below")
    assert "named below" in verdict_text(conclusions.Unexplained((), "order", ""), reasons="below")


def test_an_effect_is_told_with_its_lead_its_test_error_and_its_surest_parameters() -> None:
    values = tuple(facts.FittedValue(f"backlash.J{j}.b", 1e-3, 1e-5, "rad", "0.057°") for j in range(1, 7))
    found = facts.EffectFound(
        "backlash",
        "claimed",
        0.81,
        1e-9,
        "tool_sag",
        12.3,
        facts.ErrorChange(True, 0.2, 0.1),
        values,
        "unknown masses",
    )
    said = reason_text(found)
    assert said.startswith(
        "Missing: backlash. It explains 81 % of what was left (p = 1e-09) and leads the next, tool_sag, by 12 in "
        "log evidence (more than 3 is asked for). With it the test poses, which it never saw, fall from 0.2 to 0.1 mm. "
        "Fitted: backlash.J1.b = 0.001 +- 1e-05 rad (0.057°); "
    )
    assert said.endswith(", and 2 more. Note: unknown masses.")
    ratio = (facts.FittedValue("joint_coupling.J6.k_of_J5", 1e-3, 1e-4, "1", "0.001° for each degree"),)
    assert "k_of_J5 = 0.001 +- 0.0001 (0.001° for" in reason_text(replace(found, values=ratio))
    alone = reason_text(replace(found, lead=2.2))  # what explains something else is no rival, and no lead is asked for
    assert "leads the next, tool_sag, by 2 in log evidence, which would explain something else. With it" in alone
    assert "by 2 in log evidence (more than 3 is asked for)" in reason_text(replace(found, lead=2.2, standing="open"))


def test_the_verdict_comes_last_and_paragraphs_are_apart() -> None:
    size = facts.ResidualSize(0.06, 0.05, "repeats")
    order = facts.ResidualOrder(("q2", "time_s"), 1e-3, Channel(joint=1))
    paragraph = (size, order, facts.FaultSuspected(SWAY), facts.PosesStandOut(("p1", "p2")))
    reasons = ((facts.EffectRefused("backlash", "test poses"),), paragraph)
    first, second, last = explanation_text(facts.Explanation(reasons, conclusions.Named(("a",), None))).split("\n\n")
    assert first.startswith("backlash explains the training poses well")
    assert second.startswith(
        "What is left is 0.06 mm a coordinate; the noise is 0.05 mm, by repeated measurements. It has order against "
        "q2, time_s (p = 0.001), most in the motion of joint 2 against q2: it is not noise. It looks as if joint 1 "
        "moves the tool by"
    )
    assert second.endswith("(log evidence 12). Single poses stand out: p1, p2.")
    assert last == "Verdict: What is missing is a. With it nothing else shows."
    along = reason_text(facts.ResidualOrder(("x",), 1e-3, Channel(axis="z")))
    assert "most in the z of the scanner's frame against x" in along


def added(name: str, log_evidence: float) -> AddEffect:
    candidate = SimpleNamespace(name=name, log_evidence=log_evidence)
    return AddEffect(cast(Candidate, candidate), None, "", (), cast(Calibration, None))


def left_out(poses: tuple[str, ...], missing: tuple[str, ...]) -> LeaveOutPoses:
    return LeaveOutPoses(cast(Diagnosis, SimpleNamespace(missing=missing)), poses)


def test_advice_names_the_effect_and_its_evidence() -> None:
    left = conclusions.ResidualSummary(None, (), True, ())
    assert advice_text(Advice(added("backlash", 8.0), left)) == (
        "What is left: more than noise, without a pattern. backlash explains it best: its evidence is 8 (3 would "
        "do). Add it; it is the cause if noise alone is left in the end."
    )
    assert "leads the next by 5" in move_text(replace(added("backlash", 8.0), log_bayes_factor=5.0))
    out = move_text(left_out(("p3", "p7"), ("backlash",)))
    assert out.startswith("Without p3 and p7 nothing but noise is left beside backlash. Leave them out")
    assert "Remove it" in move_text(DropEffect("backlash", (), cast(Calibration, None)))
