"""Advice on a model: the next move, with the tests of the residual of the model's fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

from calib.calibration.result import Calibration
from calib.diagnosis.headline import HeldOutError, held_out_beyond_noise
from calib.diagnosis.moves import AddCurves, AddEffect, LeaveOutPoses, Move, ShapeNoise
from calib.diagnosis.verdict import curves_outweigh
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.residual_tests import ResidualTests


@dataclass(frozen=True)
class Advice:
    """Recommended next move for a model, with the tests of the residual of the model's fit."""

    move: Move
    residual_tests: ResidualTests  # without a fault of one joint where the move explains it
    held_out: HeldOutError | None = None  # of the test poses, beyond noise

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
    """Advice on a model, made of the next move, the tests of the residual, and the test poses' error.

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
    return Advice(move, tests, held_out_beyond_noise(calibration, tests.noise_mm))
