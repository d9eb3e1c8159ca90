"""The sections of a report: each tells of one thing that `Report` holds, in words, tables and figures."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go

from calib.calibration.noise_level import noise_level
from calib.calibration.pose_errors import running_median
from calib.calibration.result import Calibration
from calib.calibration.uncertainty import Combination, identifiable_combinations
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset
from calib.measurement.measured_points import failed_searches
from calib.present import names, numbers
from calib.present.blocks import Block, Bullets, Facts, Paragraph, Table
from calib.present.effects import not_testable
from calib.screening.candidates import Candidate
from calib.screening.curves.fitted_curves import fitted_curves, learned_members
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.residual_tests import InputTest
from inspector.figures.curve_plots import height_px, joint_curves
from inspector.figures.plots import correlation_heatmap, pose_residuals
from inspector.figures.residual_plots import SELECTED, residual_against
from inspector.markup.learn.candidate import value_row
from inspector.markup.learn.curves import BAND_NOTE, curve_rows, formulas
from inspector.markup.learn.curves import COLUMNS as CURVE_COLUMNS
from inspector.markup.learn.residuals import AXES, band_note, input_title, joint_title, shown, turned
from inspector.markup.model.fit import PARAMETER_COLUMNS, parameter_rows
from inspector.report.content import ModelResidual, Report
from inspector.report.figure_block import Figure

SHOWN_INPUTS = 2
_P = 0.01


def dataset(report: Report) -> list[Block]:
    """What was measured, where, under which conditions, and what is odd about it."""
    given = report.session.dataset
    poses = given.poses
    roles = [f"{np.count_nonzero(poses.role == role)} {names.role(role)}" for role in ("train", "test")]
    setups = [str(name) for name in np.unique(poses.setup)]
    rows: list[tuple[str, object]] = [("dataset", given.name)]
    if given.description:
        rows.append(("description", given.description))
    rows += [
        ("robot", f"{given.robot.name}, {given.robot.n_joints} joints"),
        ("poses", f"{len(poses)}: 1 reference, {numbers.listing(roles)}"),
        ("measured", _measured(given, report.session.searches)),
        (f"placements of the {instrument(given)}", len(setups)),
        ("noise declared", _noise(report.calibration)),
        ("conditions written down", numbers.listing(_conditions(given)) or "none"),
    ]
    notes = [*report.calibration.warnings, *_of_scans(given, report.session.searches)]
    return [Facts(rows), *([Bullets(notes)] if notes else [])]


def instrument(dataset: Dataset) -> str:
    """What measured: a scanner, or, where no jig with faces was measured, whatever it was."""
    return "scanner" if dataset.shows_faces else "instrument"


def _measured(dataset: Dataset, searches: Mapping[str, CornerSearch]) -> str:
    if dataset.points is not None:
        return f"{numbers.count(len(dataset.points), 'point')} given in the dataset's table of points"
    found = len(searches) - len(failed_searches(searches))
    jig = f"a jig of {dataset.jig.edges_text()}"
    return f"the corner of {jig} in {found} of {numbers.count(len(searches), 'scan')}"


def _of_scans(dataset: Dataset, searches: Mapping[str, CornerSearch]) -> list[str]:
    """Why scans have no corner, and which corners deserve a second look; nothing where points.csv has the points."""
    if dataset.points is not None:
        return []
    failed = failed_searches(searches)
    doubts = {
        pose_id: doubts
        for pose_id, search in searches.items()
        if search.corner is not None and (doubts := search.corner.quality.doubts())
    }
    return [
        *(f"{pose_id} has no corner and is left out: {reason}." for pose_id, reason in failed.items()),
        *(f"The corner of {pose_id} deserves a look: {'; '.join(said)}." for pose_id, said in doubts.items()),
    ]


def _noise(calibration: Calibration) -> str:
    level = noise_level(calibration)
    length = f"{numbers.length(level.sigma_mm)} per coordinate of a measured point"
    return length if level.is_declared else f"no: {level.name}, {length}"


def _conditions(dataset: Dataset) -> list[str]:
    poses = dataset.poses
    out = []
    for name, values, unit in (
        ("payload", poses.payload_kg, "kg"),
        ("temperature", poses.temperature_c, "°C"),
        ("time", poses.time_s, "s"),
    ):
        if values is not None:
            out.append(f"{name} {values.min():g} to {values.max():g} {unit}")
    if poses.approach is not None:
        out.append("side of approach")
    return [*out, *map(str, poses.extra.columns)]


def ranking(report: Report) -> list[Block]:
    """Every effect that could be missing, with its evidence, and those that cannot be tested here."""
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
    """The effects that could make most of what a candidate explains."""
    most = sorted(candidate.overlaps.items(), key=lambda item: -item[1])[:3]
    return ", ".join(f"{name} {100 * share:.0f}\u00a0%" for name, share in most) or "–"


def model_residual(report: Report, model: ModelResidual) -> list[Block]:
    """What a fit leaves over against the inputs that it has most order in."""
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
    """What `residuals.shown` calls the part of the residual that a test saw most order in."""
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
    """The learned curves in the model: their formulas, sizes, and the figure; [] where there are none."""
    calibration = report.calibration
    curves = fitted_curves(calibration)
    if not curves:
        return []
    columns = min(len(curves), 2)
    equation = learned_members(calibration)[0].equation
    height = height_px(len(curves), columns)
    drawn = joint_curves(curves, report.dataset.robot, columns=columns)
    return [
        Paragraph(f"{LEARNED}: {equation}. It names no cause."),
        *map(Paragraph, formulas(calibration)),
        Table(CURVE_COLUMNS, curve_rows(calibration), left=(0, 1)),
        Figure(drawn, BAND_NOTE, height_px=height, width_px=850 if columns > 1 else 560),
    ]


def by_pose(report: Report) -> list[Block]:
    """The error of each pose after the last fit."""
    frame = report.calibration.after.to_frame(report.dataset)
    ids, roles = frame["pose"].tolist(), frame["role"].tolist()
    drawn = pose_residuals(ids, roles, frame["error_mm"].to_numpy(), what="3D error after")
    return [Figure(drawn, "Predicted minus measured, length in mm, with everything above in the model.")]


def redundancy(report: Report) -> list[Block]:
    """Which parameters act alike, and how many can be known."""
    analysis = report.redundancy
    drawn = correlation_heatmap(analysis.parameters, analysis.pearson, no_influence=analysis.no_influence)
    rows: list[tuple[str, object]] = [
        ("parameters", len(analysis.parameters)),
        ("independent (rank)", analysis.rank),
        ("kept by pairs, as Park does", f"{len(analysis.kept)}: {', '.join(analysis.kept)}"),
        ("carry all the information", ", ".join(analysis.independent)),
    ]
    caption = "Pearson's r between the columns of the nominal Jacobian; grey: no influence."
    return [
        Paragraph(f"Seen by {analysis.measured_by}."),
        Facts(rows),
        Bullets(analysis.relations()),
        Figure(drawn, caption, height_px=660, width_px=700),
    ]


def parameters(report: Report) -> list[Block]:
    """All parameters, and the sums that are known better than their parts."""
    out: list[Block] = [
        Table(PARAMETER_COLUMNS, parameter_rows(report.calibration), left=(0, 5)),
        Paragraph(
            "* the data tell next to nothing of it by itself: the value is held by its tolerance, or shared.",
            soft=True,
        ),
    ]
    if learned_members(report.calibration):
        out.append(Paragraph(f"The modes of {LEARNED} are told as curves, in the section of their own.", soft=True))
    if report.table.words:
        out.append(Paragraph(f"What robot.toml can hold: {report.table.words}."))
    sums = identifiable_combinations(report.calibration)
    if sums:
        out.append(Paragraph("Sums that the data know better than their parts:"))
        out.append(Bullets([_sum(c, report.calibration) for c in sums]))
    return out


def _sum(known: Combination, calibration: Calibration) -> str:
    """A sum of parameters of one unit; angles in degrees, as in the table."""
    units = {p.name: p.unit for p in calibration.fit.parameters}
    angle = units[next(iter(known.coefficients))] == "rad"
    scale, unit = (float(np.degrees(1.0)), "°") if angle else (1.0, " mm")
    return f"{known.description} = {scale * known.value:.6g}{unit} ± {scale * known.sigma:.2g}{unit}"
