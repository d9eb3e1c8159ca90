"""What the page says of the next move: what the model's fit leaves, and what the move does about it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from calib.calibration.result import Calibration
from calib.diagnosis.explanation import noise_told
from calib.diagnosis.moves import AddCurves, AddEffect, DropEffect, LeaveOutPoses, Move, ShapeNoise
from calib.diagnosis.verdict import curves_outweigh
from calib.diagnosis.words.conclusion_text import residual_summary_text
from calib.diagnosis.words.conclusions import ResidualSummary
from calib.diagnosis.words.headline import held_out_beyond_noise
from calib.diagnosis.words.noise_text import noise_text
from calib.diagnosis.words.phrases import curves_text, listed
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.residual_tests import ResidualTests


@dataclass(frozen=True)
class Advice:
    """A move that leads on from a model, and what the model's fit leaves."""

    move: Move
    residual: ResidualSummary

    @property
    def effect(self) -> str:
        """The effect that the move adds or drops; "" where it does neither."""
        match self.move:
            case AddCurves():
                return LEARNED
            case LeaveOutPoses() | ShapeNoise():
                return ""
        return self.move.name


def advice_on(move: Move, tests: ResidualTests, calibration: Calibration) -> Advice:
    """The advice to make a move.

    Args:
        tests: of the residual of the model that the move leads on from.
        calibration: the fit of that model.
    """
    match move:
        case AddEffect():  # what an effect explains may look like a fault too: where one leads, the pattern is reported
            tests = replace(tests, fault=None)
        case AddCurves(curves=curves):
            if tests.fault is not None and curves_outweigh(curves.members, curves.log_evidence, tests.fault):
                tests = replace(tests, fault=None)
    return Advice(move, residual_summary(tests, calibration))


def residual_summary(tests: ResidualTests, calibration: Calibration) -> ResidualSummary:
    """What a fit leaves, in short."""
    beyond = held_out_beyond_noise(calibration, tests.noise_mm)
    return ResidualSummary(tests.fault, tests.structured, tests.too_large, tests.outlier_poses, beyond)


def advice_text(advice: Advice) -> str:
    """What the fit leaves, and what to do next."""
    return f"{residual_summary_text(advice.residual)} {move_text(advice.move)}"


def move_text(move: Move) -> str:
    """What a move does and why, a sentence or two."""
    match move:
        case AddEffect():
            leads = "" if move.log_bayes_factor is None else f" and leads the next by {move.log_bayes_factor:.0f}"
            return (
                f"{move.name} explains it best: its evidence is {move.candidate.log_evidence:.0f} (3 would do){leads}. "
                "Add it; it is the cause if noise alone is left in the end."
            )
        case DropEffect(name=name):
            return f"{name} is superfluous now: the other effects explain what it does. Remove it."
        case LeaveOutPoses(poses=poses):
            them = "them" if len(poses) > 1 else "it"
            return (
                f"Without {listed(poses)} nothing but noise is left{_beside(move)}. Leave {them} out, and measure "
                f"{them} again."
            )
        case ShapeNoise():
            noise = noise_told(move.diagnosis)
            assert noise is not None
            return f"What is left is noise of a shape of its own{_beside(move)}. {noise_text(noise)}"
        case AddCurves(curves=curves):
            return (
                f"{curves_text(curves.joints, curves.inputs, curves.log_evidence)} {LEARNED} adds what was learned; it "
                "names no cause. Watch whether the test poses follow."
            )


def _beside(move: LeaveOutPoses | ShapeNoise) -> str:
    effects = move.diagnosis.missing
    return f" beside {listed(effects)}" if effects else ""
