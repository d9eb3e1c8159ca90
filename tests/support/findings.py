"""Conclusions from findings that are put together by hand: no fit is needed for a verdict."""

from __future__ import annotations

from typing import Any, cast

from calib.calibration.result import Calibration
from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.diagnosis.verdict import Conclusion, Findings, conclude
from calib.screening.residual_tests import ResidualTests


def concluded(added: tuple[str, ...], tests: ResidualTests, **findings: Any) -> Conclusion:
    """The conclusion from effects in the model, tests of the residual and further findings."""
    selected = tuple(SelectedEffect(name, (), {}) for name in added)
    step = FitStep("", selected, cast(Calibration, None))
    return conclude(Findings((step,), tests, **findings))
