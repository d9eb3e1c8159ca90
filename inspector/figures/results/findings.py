"""Figures of a diagnosis: how the error fell, which effects could be missing, what was learned; see `fits`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from calib.calibration.noise_level import noise_level
from calib.calibration.result import Calibration
from calib.diagnosis.decision_rules import MIN_LOG_EVIDENCE
from calib.diagnosis.effect_selection import FitStep, candidate_of
from calib.diagnosis.result import Diagnosis
from calib.errors import CalibError
from calib.screening.curves.fitted_curves import fitted_curves
from inspector.figures import (
    curve_plots,
    evidence_plots,
    plots,
    residual_plots,
)
from inspector.figures.results.alone import titled


def error_history(of: Diagnosis | Sequence[FitStep], *, dark: bool = False) -> go.Figure:
    """How the 3D error (RMS, mm, logarithmic) of training and test poses fell with each effect that was added.

    Dashed: what noise alone leaves, as the dataset declares it, as repeats show it, or as the fit left it.

    Args:
        of: a diagnosis, or the steps of a model, as `calib.diagnosis.search_space.add_in_turn` makes them.
    """
    steps = of.steps if isinstance(of, Diagnosis) else of
    first, last = steps[0].calibration, steps[-1].calibration
    stages = [first.before, *(step.calibration.after for step in steps)]
    labels = ["as delivered", *(step.label for step in steps)]
    train = [np.nan if s.train is None else s.train.rmse_mm for s in stages]
    test = [np.nan if s.test is None else s.test.rmse_mm for s in stages]
    level = noise_level(last)
    drawn = plots.error_history(labels, train, test, level.floor_mm, noise=level.name, dark=dark)
    return titled(drawn, f"The error falls: {last.dataset.name}", dark=dark)


def ranking(diagnosis: Diagnosis, *, step: int = 0, dark: bool = False) -> go.Figure:
    """Log evidence of each effect that could be missing, before the first one was added; above 3 it convinces.

    Args:
        step: after how many effects were added; 0 is the ranking that the first decision was taken by.
    """
    if not 0 <= step < len(diagnosis.screenings):
        raise CalibError(f"no ranking after step {step}; there are 0 to {len(diagnosis.screenings) - 1}")
    candidates = diagnosis.screenings[step].candidates
    drawn = evidence_plots.evidence_bars(
        [c.name for c in candidates], [c.log_evidence for c in candidates],
        [c.name in diagnosis.missing for c in candidates], MIN_LOG_EVIDENCE, dark=dark,
    )  # fmt: skip
    return titled(drawn, f"Which effect is missing: {diagnosis.calibration.dataset.name}", dark=dark)


def added_variable(diagnosis: Diagnosis, effect: str, *, dark: bool = False) -> go.Figure:
    """Residual against what an effect would explain of it, in sigmas of the noise; points on the line are explained.

    Both are of the link errors alone, without what geometry could have absorbed (an added-variable plot). Raises
    CalibError on an effect that is no candidate.
    """
    screening = diagnosis.screenings[0]
    candidate = candidate_of(screening, effect)
    drawn = residual_plots.added_variable(
        candidate.explained, screening.projected.residual, effect, screening.projected.row_poses, dark=dark
    )
    return titled(drawn, f"What {effect} would explain: {diagnosis.calibration.dataset.name}", dark=dark)


def learned_curves(of: Calibration | Diagnosis, *, dark: bool = False) -> go.Figure:
    """Learned curves of the joints (`smooth_joint_error`): error over input with a band of two sigmas.

    mrad over degrees, or the units of the input; grey where nothing was measured. Raises CalibError where the model has
    none.
    """
    calibration = of.calibration if isinstance(of, Diagnosis) else of
    curves = fitted_curves(calibration)
    if not curves:
        inside = " + ".join(["link errors", *calibration.model.family_names])
        raise CalibError(f"dataset {calibration.dataset.name}: no curves were learned; the model is {inside}")
    drawn = curve_plots.joint_curves(curves, calibration.dataset.robot, columns=min(len(curves), 2), dark=dark)
    height = curve_plots.height_px(len(curves), min(len(curves), 2))
    return titled(drawn, f"Learned curves: {calibration.dataset.name}", dark=dark, height_px=height)
