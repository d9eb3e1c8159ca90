"""Conclusions from findings that are put together by hand: no fit is needed for a verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

from calib.calibration.result import Calibration
from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.diagnosis.verdict import Conclusion, Findings, conclude
from calib.screening.residual_tests import ResidualTests


def concluded(
    added: Sequence[str], tests: ResidualTests, on_behalf_of: Mapping[str, tuple[str, ...]] = {}, **findings: Any
) -> Conclusion:
    """The conclusion from effects that were added in turn, tests of the residual and further findings."""
    selected = tuple(SelectedEffect(name, (), {}) for name in added)
    steps = [FitStep("", (), cast(Calibration, None))]
    for k, name in enumerate(added):
        behalf = on_behalf_of.get(name, ())
        steps.append(FitStep("", selected[: k + 1], cast(Calibration, None), effect=name, on_behalf_of=behalf))
    return conclude(Findings(tuple(steps), tests, **findings))
