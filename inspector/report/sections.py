"""Sections of a report, each on one part of `Report`, in sentences, tables and figures."""

from __future__ import annotations

import plotly.graph_objects as go

from calib.calibration.pose_errors import running_median
from calib.dataset.dataset import Dataset
from calib.present import numbers
from calib.present.blocks import Block, Bullets, Paragraph, Table
from calib.present.curves import BAND_NOTE, curve_blocks
from calib.present.effects import not_testable
from calib.present.residuals import AXES, band_note, input_title, joint_title, shown, turned
from calib.screening.candidates import Candidate
from calib.screening.curves.fitted_curves import fitted_curves
from calib.screening.residual_tests import InputTest
from inspector.figures.curve_plots import height_px, joint_curves
from inspector.figures.residual_plots import SELECTED, residual_against
from inspector.markup.learn.candidate import value_row
from inspector.report.content import ModelResidual, Report
from inspector.report.figure_block import Figure

SHOWN_INPUTS = 2
_P = 0.01


def ranking(report: Report) -> list[Block]:
    """Blocks on the evidence of every candidate effect, and on effects that cannot be tested."""
    rows = [
        (
            c.name,
            f"{c.log_evidence:.1f}",
            numbers.probability(c.p_holm),
            f"{100 * c.explained_share:.0f}",
            numbers.column_mm(c.cv_rmse_mm),
            _likeness(c),
        )
        for c in report.ranking.candidates
    ]
    named = [c.name in report.calibration.model.family_names for c in report.ranking.candidates]
    columns = ("effect", "log evidence", "p (Holm)", "explains, %", "CV, mm", "could also be made by")
    out: list[Block] = [
        Paragraph(
            f"Each effect tested on the residual of the model of {report.ranking_of}. CV: error per "
            "coordinate when each pose is predicted from the others, "
            f"{numbers.column_mm(report.ranking.cv_rmse_mm)} mm without any of them."
        ),
        Table(columns, rows, left=(0, 5), mark=next((i for i, c in enumerate(named) if c), None)),
    ]
    best = next((c for c in report.ranking.candidates if c.values), None)
    if best is not None:
        values = [value_row(value) for value in best.values]
        caption = f"{best.name}: its coefficients as that ranking estimates them"
        out.append(Table(("parameter", "value", "sigma", "unit"), values, caption=caption, left=(0, 3)))
    silent = report.diagnosis.untestable if report.diagnosis else report.ranking.untestable
    if silent:
        out.append(Paragraph("Cannot be tested with these data:"))
        out.append(Bullets(not_testable(silent)))
    return out


def _likeness(candidate: Candidate) -> str:
    """Text on the effects that could explain most of what a candidate explains."""
    most = sorted(candidate.overlaps.items(), key=lambda item: -item[1])[:3]
    return ", ".join(f"{name} {100 * share:.0f}\u00a0%" for name, share in most) or "–"


def model_residual(report: Report, model: ModelResidual) -> list[Block]:
    """Blocks on a fit's residual against the inputs with the clearest systematic patterns."""
    inputs = [test for test in model.residual_tests.inputs if test.input in model.pose_errors.inputs]
    if not inputs:
        return [Paragraph(f"{model.title}: no input varies that the residual could follow.")]
    rows = [
        (
            input_title(t.input, report.dataset.robot),
            _channel(t, report.dataset),
            numbers.probability(t.p_value),
        )
        for t in inputs[:5]
    ]
    caption = f"Model: {model.title}. Dependence on the inputs, the strongest first; p is corrected for all looked at"
    out: list[Block] = [Table(("input", "shows most in", "p"), rows, left=(0, 1), caption=caption)]
    structured = [t for t in inputs if t.p_value < _P] or inputs[:1]
    return [*out, *(_against(report, model, t) for t in structured[:SHOWN_INPUTS])]


def _channel(test: InputTest, dataset: Dataset) -> str:
    """Name, for `residuals.shown`, of the residual's component with the clearest pattern in a test."""
    if test.channel.joint is not None:
        return joint_title(test.channel.joint, dataset.robot)
    return next(title for title, axis in AXES.items() if "xyz"[axis] == test.channel.axis)


def _against(report: Report, model: ModelResidual, test: InputTest) -> Figure:
    robot, pose_errors = report.dataset.robot, model.pose_errors
    x = turned(test.input, pose_errors.inputs[test.input], robot)
    y, y_title, band = shown(pose_errors, _channel(test, report.dataset), test.channel.joint, robot)
    x_title, train = input_title(test.input, robot), ~pose_errors.is_test
    drawn = residual_against(
        x, y, pose_errors.pose_ids, pose_errors.is_test, x_title=x_title, y_title=y_title, band=band,
        smooth=running_median(x[train], y[train]),
    ).for_each_trace(_hide, selector={"name": SELECTED})  # fmt: skip

    order = "No systematic dependence" if test.p_value >= _P else "Systematic dependence"
    found = f"{order} on {x_title} (p = {numbers.probability(test.p_value)})"
    caption = f"Model: {model.title}. {found}. {band_note(pose_errors, band)}"
    return Figure(drawn, caption)


def _hide(trace: go.Scatter) -> None:
    trace.update(visible=False)


def learned_curves(report: Report) -> list[Block]:
    """Blocks on the learned curves in the model: formulas, sizes, and the figure; [] where there are none."""
    curves = fitted_curves(report.calibration)
    if not curves:
        return []
    columns = min(len(curves), 2)
    drawn = joint_curves(curves, report.dataset.robot, columns=columns)
    width_px = 850 if columns > 1 else 560
    figure = Figure(drawn, BAND_NOTE, height_px=height_px(len(curves), columns), width_px=width_px)
    return [*curve_blocks(report.calibration), figure]
