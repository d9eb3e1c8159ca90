"""What to do next with a model built by hand: add the effect that leads, measure more, look closer, or stop.

The same thresholds as `calib.diagnosis.decision_rules`, for any fit: the tests of what is left come first, then the
ranking, then the curves of the joints, where they were learned.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from calib.diagnosis.decision_rules import (
    curves_say_more,
    is_convincing,
    leading_fault,
    rank_candidates,
    untestable_names,
)
from calib.diagnosis.words.conclusions import (
    AddCurves,
    AddEffect,
    AdviceSentence,
    LookAtJoint,
    LookCloser,
    MeasureAgain,
    NothingToAdd,
    ResidualSummary,
    TellApart,
)
from calib.screening.candidates import Screening
from calib.screening.curves.joint_curves import LearnedCurves
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.residual_tests import ResidualTests

KINDS = ("add", "ambiguous", "done", "outliers", "unknown")


@dataclass(frozen=True)
class Advice:
    """The next step, and why."""

    kind: str  # of KINDS
    effects: tuple[str, ...]  # that it is about, the best first
    sentences: tuple[
        AdviceSentence, ...
    ]  # `calib.diagnosis.words.conclusion_text.advice_text` puts them into words


def asks_for_curves(screening: Screening, tests: ResidualTests) -> bool:
    """Whether something is left and no effect of the ranking is convincing: then curves may explain it."""
    left = bool(tests.fault or tests.structured or tests.too_large)
    return left and not any(map(is_convincing, screening.candidates))


def advise(screening: Screening, tests: ResidualTests, curves: LearnedCurves | None = None) -> Advice:
    """What the ranking and the residual tests of one fit suggest; and curves, where they were learned from it."""
    convincing = any(map(is_convincing, screening.candidates))
    if not convincing and curves is not None:
        return _with_curves(tests, curves)
    if not convincing:
        return _without_candidate(screening, tests)
    fault = leading_fault(screening)
    if fault is not None:
        return Advice("unknown", (), (LookAtJoint(fault),))
    # What an effect explains may also look like a fault: where an effect is convincing, the order is reported.
    left = residual_summary(replace(tests, fault=None))
    best, lead, tied = rank_candidates(screening)
    if tied:
        names = tuple(candidate.name for candidate in tied)
        return Advice("ambiguous", names, (left, TellApart(names)))
    return Advice("add", (best.name,), (left, AddEffect(best.name, best.log_evidence, lead)))


def _with_curves(tests: ResidualTests, curves: LearnedCurves) -> Advice:
    """To add the curves; a fault of one joint stays told unless all joints say more."""
    unsaid = tests.fault is not None and curves_say_more(curves, tests.fault)
    left = residual_summary(replace(tests, fault=None) if unsaid else tests)
    add = AddCurves(LEARNED, curves.joints, curves.inputs, curves.log_evidence)
    return Advice("add", (LEARNED,), (left, add))


def _without_candidate(screening: Screening, tests: ResidualTests) -> Advice:
    """What the residual tests suggest where no effect is convincing."""
    left = residual_summary(tests)
    if tests.fault or tests.structured or tests.too_large:
        return Advice("unknown", (), (left, LookCloser(_named_in(screening))))
    if tests.outlier_poses:
        return Advice("outliers", (), (left, MeasureAgain()))
    blind = untestable_names(screening.untestable)
    return Advice("done", (), (left, NothingToAdd(bool(screening.candidates), len(blind))))


def _named_in(screening: Screening) -> tuple[str, ...]:
    """The effects in the model that a screening is of, without learned curves, which name no cause."""
    names = screening.projected.residuals.model.family_names
    return tuple(name for name in names if name != LEARNED)


def residual_summary(tests: ResidualTests) -> ResidualSummary:
    """What a fit leaves, in short."""
    return ResidualSummary(tests.fault, tests.structured, tests.too_large, tests.outlier_poses)
