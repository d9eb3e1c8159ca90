"""What to do next with a model: the move that the automatic search would make from it, or the verdict.

Whoever follows it, one move after the other, ends with the model and the verdict of `diagnose`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from calib.calibration.result import Calibration
from calib.consistency.data_problem import Suspicions
from calib.diagnosis.conclusion import concluded, with_split
from calib.diagnosis.data_check import data_suspicions, diagnosis_of_problem, problem_beside_effects
from calib.diagnosis.decision_rules import curves_say_more
from calib.diagnosis.diagnose import AddCurves, SearchAgain, SearchWithNoise, closing_move
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.explanation import noise_told
from calib.diagnosis.moves import AddEffect, DropEffect, Stop, Tell, next_move
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import SearchSpace
from calib.diagnosis.words import conclusions as words
from calib.diagnosis.words.headline import held_out_beyond_noise
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.residual_tests import ResidualTests

Move = AddEffect | DropEffect | SearchAgain | SearchWithNoise | AddCurves


@dataclass(frozen=True)
class Advice:
    """A move, and why."""

    move: Move
    sentences: tuple[words.AdviceSentence, ...]  # `calib.diagnosis.words` puts them into words

    @property
    def effect(self) -> str:
        """The effect that the move adds or takes out; "" where it does neither."""
        match self.move:
            case AddCurves():
                return LEARNED
            case SearchAgain() | SearchWithNoise():
                return ""
        return self.move.name


def advice_or_verdict(
    space: SearchSpace,
    steps: Sequence[FitStep],
    tests: ResidualTests,
    dropped: Collection[str] = (),
    tell: Tell = lambda words: None,
) -> Advice | Diagnosis:
    """What the search would do next with the last step's model; the verdict on it where that is nothing.

    Args:
        space: of the fits.
        steps: that led to the model; the last with its screening.
        tests: of what the last fit leaves over.
        dropped: effects that were taken out as superfluous.
        tell: called before each stage.
    """
    of_step = space.without(steps[-1].left_out)
    doubts = data_suspicions(of_step, steps[0]) if not steps[0].selected else Suspicions(None)
    if doubts.problem is not None:
        return diagnosis_of_problem(of_step, steps[0], doubts.problem)
    move = next_move(of_step, steps[-1], dropped, tell)
    if not isinstance(move, Stop):
        return advice_on(move, tests, steps[-1].calibration)
    found = concluded(space, steps, move, tests)
    problem = problem_beside_effects(of_step, found, doubts.open)
    if problem is not None:
        return diagnosis_of_problem(of_step, steps[0], problem)
    closing = closing_move(space, found, tell)
    return with_split(found) if closing is None else advice_on(closing, tests, steps[-1].calibration)


def advice_on(move: Move, tests: ResidualTests, calibration: Calibration) -> Advice:
    """What speaks for a move."""
    match move:
        case AddEffect():
            # What an effect explains may also look like a fault: where one is convincing, the order is reported.
            left = residual_summary(replace(tests, fault=None), calibration)
            return Advice(move, (left, words.AddEffect(move.name, move.candidate.log_evidence, move.lead)))
        case DropEffect():
            return Advice(move, (residual_summary(tests, calibration), words.RemoveEffect(move.name)))
        case SearchAgain():
            return Advice(move, (residual_summary(tests, calibration), words.LeaveOut(move.poses, move.found.missing)))
        case SearchWithNoise():
            noise = noise_told(move.found)
            assert noise is not None
            return Advice(move, (residual_summary(tests, calibration), words.WeighNoise(noise, move.found.missing)))
        case AddCurves():
            curves = move.curves
            unsaid = tests.fault is not None and curves_say_more(curves, tests.fault)
            left = residual_summary(replace(tests, fault=None) if unsaid else tests, calibration)
            said = words.AddCurves(LEARNED, curves.joints, curves.inputs, curves.log_evidence)
            return Advice(move, (left, said))


def residual_summary(tests: ResidualTests, calibration: Calibration) -> words.ResidualSummary:
    """What a fit leaves, in short."""
    beyond = held_out_beyond_noise(calibration, tests.noise_mm)
    return words.ResidualSummary(tests.fault, tests.structured, tests.too_large, tests.outlier_poses, beyond)
