"""Presentation of changes between two calibrations, or in a cell measured again, and of undetectable changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from calib.calibration.evaluation import Evaluation
from calib.lazy_modules import pd
from calib.monitoring.change_models import BASE, NOISE, change_label
from calib.monitoring.change_tests import Change, Detectable
from calib.monitoring.control_chart import in_time, size_in_degrees, usual_name
from calib.monitoring.iso9283 import CAVEAT, PoseFigures
from calib.monitoring.watch import ChangeReport
from calib.present import names
from calib.present.results import document, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Bullets, Facts, FigurePlace, Paragraph, Presentation, Section, Table, Verdict
from calib.rendering.colours import DOUBT, GOOD, VERDICT_COLOURS
from calib.validation.comparison import ALPHA, Comparison, ParameterChange, ParameterDifference

_MANY = 2.0  # times the declared noise, from which a fit is said to leave much
APART = 2.0  # sigmas from which a parameter is listed as different

# ---- two calibrations -----------------------------------------------------------------------------------------------


@presentation.register
def _comparison(compared: Comparison) -> Presentation:
    return Presentation(
        " and ".join(compared.names),
        comparison_head(compared),
        [Section("Errors", [errors(compared)], brief=True), Section("Parameters", parameters(compared), brief=True)],
    )


def comparison_head(compared: Comparison) -> list[Block]:
    """Blocks with the differences of two calibrations, and the effects that are in one of the models only."""
    only = [
        f"Only in the model of {name}: {numbers.listing(effects)}."
        for name, effects in zip(compared.names, compared.only_in, strict=True)
        if effects
    ]
    head: list[Block] = [Verdict(comparison_verdict(compared), DOUBT if compared.differs else GOOD)]
    left = map(misfit_sentence, compared.names, compared.times_noise)
    return [*head, *(Paragraph(sentence) for sentence in (*only, *left) if sentence)]


def misfit_sentence(name: str, times_noise: float | None) -> str:
    """Sentence on a fit that leaves many times the declared noise, in which small changes hide; "" for any other."""
    if times_noise is None or times_noise < _MANY:
        return ""
    return (
        f"The fit of {name} leaves {numbers.times(times_noise)} the declared noise: what it misses counts as "
        "uncertainty here, and small changes hide in it. What `diagnose` finds can be taken into the fit by --effect "
        "and --add."
    )


def comparison_verdict(compared: Comparison) -> str:
    """Verdict on the differences between two calibrations, in a sentence or two."""
    where = (
        f"The tool point moves by {numbers.length(compared.rms_mm)} RMS, at the most by "
        f"{numbers.length(compared.largest_mm)} at {compared.largest_pose}"
    )
    one, other = compared.names
    if not compared.changes:
        return (
            f"No link parameter differs between {one} and {other} beyond the noise (probability of this much by "
            f"chance: {numbers.probability(compared.p_same)}). {where}, which the noise explains."
        )
    changes = [_parameter_change(change) for change in compared.changes]
    listed = changes[0] if len(changes) == 1 else f"{'; '.join(changes[:-1])}; and {changes[-1]}"
    if compared.p_rest < ALPHA:
        return f"{one} and {other} differ in many link parameters, most of all in {listed}. {where}."
    return f"From {one} to {other} changed: {listed}. {where}."


def _parameter_change(change: ParameterChange) -> str:
    joint = change.name.removeprefix("theta")
    name = f"the zero of joint {joint} ({change.name})" if joint != change.name and joint.isdigit() else change.name
    return f"{name} by {numbers.with_sigma(change.size, change.sigma, change.unit, sign=True)}{_or(change.alike)}"


def _or(others: Sequence[str]) -> str:
    return f", or {numbers.listing(others, 'or')}, which are indistinguishable at these poses" if others else ""


def errors(compared: Comparison) -> Table:
    """Table of 3D RMSE before and after of both calibrations, of training and test poses."""
    rows = [
        (f"{name}, {names.role(role)}", *(numbers.column_mm(_rmse_mm(figures, role)) for figures in stages))
        for name, stages in zip(compared.names, compared.errors, strict=True)
        for role in ("train", "test")
        if _rmse_mm(stages[1], role) is not None
    ]
    return Table(("3D RMSE, mm", "nominal", "fitted"), rows)


def _rmse_mm(evaluation: Evaluation, role: str) -> float | None:
    figures = evaluation.train if role == "train" else evaluation.test
    return None if figures is None else figures.rmse_mm


def parameters(compared: Comparison) -> list[Block]:
    """Table of the parameters that differ by two sigmas or more, the most significant first."""
    apart = sorted((p for p in compared.parameters if abs(p.z) >= APART), key=lambda p: -abs(p.z))
    if not apart:
        return [Paragraph(f"No single parameter differs by {APART:g} sigma or more.")]
    columns = ("parameter", *compared.names, "difference ± sigma", "unit")
    caption = f"parameters that differ by {APART:g} sigma or more"
    return [
        Table(columns, [_difference(p) for p in apart], caption=caption, left=(0, 4), height="300px"),
        Paragraph(
            "Of many parameters one in twenty is beyond two sigma by chance, and a real change of one moves those that "
            "it is correlated with; the sentence above accounts for both.",
            soft=True,
        ),
    ]


def _difference(p: ParameterDifference) -> tuple[str, ...]:
    (first, unit), (second, _) = (numbers.readable(value, p.unit) for value in p.values)
    by = numbers.with_sigma(p.difference, p.sigma, p.unit, sign=True).removesuffix(unit).rstrip()
    return (numbers.parameter_label(p.name), f"{first:z.6g}", f"{second:z.6g}", by, unit)


@document.register
def _comparison_document(compared: Comparison) -> dict[str, Any]:
    return {
        "names": compared.names,
        "differs": compared.differs,
        "p_same": compared.p_same,
        "p_rest": compared.p_rest,
        "changes": compared.changes,
        "parameters": compared.parameters,
        "only_in": compared.only_in,
        "times_noise": compared.times_noise,
        "tool_point": {"rms_mm": compared.rms_mm, "max_mm": compared.largest_mm, "pose": compared.largest_pose},
        "errors": [{"before": before, "after": after} for before, after in compared.errors],
        "explanation": comparison_verdict(compared),
    }


# ---- a cell measured again ------------------------------------------------------------------------------------------

_WHAT = {
    "joint_zero": "the zero",
    "compliance": "the compliance",
    "length": "a length",
    "angle": "an angle",
}
METHOD = (
    "The earlier fit predicts each check pose. The limit is what the noise and the uncertainty of the fit's parameters "
    "and of the instrument's frame would make. Each possible change is fitted by generalised least squares, once with "
    "the instrument where it was and once with its place free; the arm is not blamed for what a moved instrument "
    "explains.",
    "Of unchanged cells fewer than one in a hundred is called changed, over all kinds of change together.",
)
_SIZES_NOTE = "Each size is estimated given the changes named above, whether it changed or not."


@presentation.register
def _change_report(report: ChangeReport) -> Presentation:
    head: list[Block] = [*change_verdict([report]), Facts(_limits(report)), control_chart([report])]
    return Presentation(f"Watch: {report.name}", head, change_sections([report]))


def change_verdict(reports: Sequence[ChangeReport]) -> list[Block]:
    """Blocks with the verdict on the last of several measurements of a cell."""
    left = misfit_sentence("the earlier recording", reports[-1].times_noise)
    verdict = Verdict(change_headline(reports[-1]), VERDICT_COLOURS[reports[-1].verdict])
    return [verdict, *([Paragraph(left)] if left else [])]


def change_headline(report: ChangeReport) -> str:
    """Sentence or two on what changed in a cell."""
    phrases = "; ".join(change_phrases(report))
    return change_sentence(report.name, report.verdict, phrases, report.poses, report.rmse_mm, report.expected_mm)


def change_sentence(name: str, verdict: str, phrases: str, poses: int, rmse_mm: float, expected_mm: float) -> str:
    """Sentence on what changed between two measurements of a cell, with the error of the later points."""
    off = (
        f"{poses} check poses are off by {numbers.length(rmse_mm)} RMS, where the noise and the earlier fit's "
        f"uncertainty make {numbers.length(expected_mm)}"
    )
    if verdict == "unchanged":
        return f"{name}: unchanged. {off}."
    return f"{name}: {verdict}. {numbers.capitalised(phrases)}. {off}."


def change_phrases(report: ChangeReport) -> tuple[str, ...]:
    """Phrases on what changed, one per change."""
    if report.data_problem is not None:
        return (report.data_problem.warning,)
    return tuple(change_phrase(change) for change in report.changes)


def change_phrase(change: Change) -> str:
    """Phrase on one change, with its size and the changes that cannot be discriminated from it."""
    if change.what == NOISE:
        return f"the noise is {numbers.times(change.size)} what it was"
    moved = {
        "scanner": f"the {'instrument (or the base)' if BASE in change.as_well else 'scanner on the flange'} moved",
        "tool": "the tool moved",
        "jig": "the jig (or the base) moved",
    }
    parameter = f" ({change.parameter})" if change.parameter else ""
    what = moved.get(change.what) or f"{_WHAT[change.what]} of joint {change.joint}{parameter} changed"
    others = [name for name in change.as_well if name != BASE]
    return f"{what} by {numbers.with_sigma(change.size, change.sigma, change.unit)}{_or(others)}"


def _limits(report: ChangeReport) -> list[tuple[str, object]]:
    return [
        ("check poses", report.poses),
        ("3D error, RMS", numbers.length(report.rmse_mm)),
        ("limit where nothing changed", numbers.length(report.errors.limit_mm)),
    ]


def control_chart(reports: Sequence[ChangeReport]) -> FigurePlace:
    """Placeholder of the control chart."""
    caption = "The error at the check poses of each measurement, against its limit."
    return FigurePlace("control_chart", (tuple(reports),), caption)


def change_sections(reports: Sequence[ChangeReport], repeats: Sequence[PoseFigures] = ()) -> list[Section]:
    """Sections on each measurement, the sizes of usual changes, undetectable changes, and any repeats."""
    last = reports[-1]
    unseen = unseen_sentences(last)
    return [
        *([Section("Each measurement", [measurements(reports)])] if len(reports) > 1 else []),
        Section("Every joint and the tool", [usual_sizes(reports), Paragraph(_SIZES_NOTE, soft=True)]),
        *([Section("What these poses could not see", [Bullets(unseen)], brief=True)] if unseen else []),
        *([Section("Repeats", repeat_blocks(repeats))] if repeats else []),
    ]


def measurements(reports: Sequence[ChangeReport]) -> Table:
    """Table of the measurements: verdict and error of each, with dates where they are known."""
    dated = any(report.when for report in reports)
    rows = [
        (
            report.name,
            *([report.when.replace("-", "\N{NON-BREAKING HYPHEN}") or numbers.MISSING] if dated else []),
            report.verdict,
            "; ".join(change_phrases(report)) or numbers.MISSING,
            numbers.column_mm(report.rmse_mm),
            numbers.column_mm(report.errors.limit_mm),
        )
        for report in reports
    ]
    columns = ("", *(["date"] if dated else []), "", "what changed", "error, mm", "limit, mm")
    return Table(columns, rows, left=range(len(columns) - 2))


def usual_sizes(reports: Sequence[ChangeReport]) -> Table:
    """Table of the change of each joint's zero and of the tool with its sigma, one column per measurement."""
    rows = []
    for k, usual in enumerate(reports[-1].usual):
        name = "tool" if usual.joint is None else f"zero of joint {usual.joint}"
        unit = numbers.readable(0.0, usual.unit)[1]
        sizes = [report.usual[k] for report in reports]
        shown = [numbers.with_sigma(c.size, c.sigma, c.unit, sign=True).removesuffix(unit).rstrip() for c in sizes]
        rows.append((f"{name}, {unit}", *shown))
    return Table(("change ± sigma", *(report.name for report in reports)), rows)


def unseen_sentences(report: ChangeReport) -> list[str]:
    """Sentences on changes that the poses could not have shown, and on poses where the model is not confirmed."""
    never = [_kind(d) for d in report.unseen if d.size is None]
    small = [f"{_kind(d)} below {numbers.size(d.size, d.unit)}" for d in report.unseen if d.size is not None]
    return [
        *([f"Never seen by these poses, or taken for the instrument: {', '.join(never)}."] if never else []),
        *([f"Not seen by these poses: {', '.join(small)}."] if small else []),
        *([report.outside_words] if report.outside_words else []),
    ]


def _kind(detectable: Detectable) -> str:
    return change_label(detectable.what, detectable.joint, detectable.parameter)


def repeat_blocks(repeats: Sequence[PoseFigures]) -> list[Block]:
    """Blocks with ISO 9283's figures of revisited poses: RP and AP of the last session, drift over all sessions."""
    rows = [
        (
            pose.pose,
            f"{sum(s.visits for s in pose.sessions)} in {len(pose.sessions)}",
            *map(
                numbers.column_mm,
                (pose.sessions[-1].rp_mm, pose.sessions[-1].ap_mm, pose.dap_mm, pose.drp_mm, pose.moved_mm),
            ),
        )
        for pose in repeats
    ]
    columns = ("pose, mm", "visits", "RP", "AP", "dAP", "dRP", "moved")
    return [Table(columns, rows, height="220px"), Paragraph(CAVEAT, soft=True)]


def worst_repeats(repeats: Sequence[PoseFigures]) -> list[str]:
    """Sentence on the largest ISO 9283 figures (RP, dAP, dRP); [] where no pose was visited again."""
    if not repeats:
        return []
    worst = {
        "RP": [s.rp_mm for pose in repeats for s in pose.sessions],
        "dAP": [pose.dap_mm for pose in repeats],
        "dRP": [pose.drp_mm for pose in repeats],
    }
    figures = [
        f"{name} {numbers.length(max(known))}"
        for name, values in worst.items()
        if (known := [value for value in values if value is not None])
    ]
    visited = numbers.count(len(repeats), "pose was", "poses were")
    return [f"{visited} visited again, at the most {', '.join(figures)}. {CAVEAT}"]


def series(reports: Sequence[ChangeReport]) -> pd.DataFrame:
    """Table with a row per measurement in time order: error, limit, verdict, changes, and usual changes' sizes."""
    rows = []
    for report in in_time(reports):
        row: dict[str, object] = {
            "name": report.name,
            "date": report.when,
            "verdict": report.verdict,
            "poses": report.poses,
            "rmse_mm": report.rmse_mm,
            "likely_mm": report.errors.likely_mm,
            "limit_mm": report.errors.limit_mm,
            "p_unchanged": report.p_unchanged,
            "times_noise": report.times_noise,
            "changes": "; ".join(change_phrases(report)),
        }
        for usual in report.usual:
            name, unit = usual_name(usual).rsplit("_", 1)
            size, sigma = size_in_degrees(usual)
            known = (size, sigma) if math.isfinite(sigma) else (None, None)  # an empty cell: not seen by these poses
            row |= dict(zip((f"{name}_{unit}", f"{name}_sigma_{unit}"), known, strict=True))
        rows.append(row)
    return pd.DataFrame(rows)


@document.register
def _change_document(report: ChangeReport) -> dict[str, Any]:
    return {
        "name": report.name,
        "verdict": report.verdict,
        "changes": report.changes,
        "unseen": report.unseen,
        "detectable": report.detectable,
        "date": report.when,
        "usual": [_usual_document(usual) for usual in report.usual],
        "limit_mm": report.errors.limit_mm,
        "rmse_mm": report.rmse_mm,
        "rmse_scanner_free_mm": report.rmse_free_mm,
        "expected_mm": report.expected_mm,
        "p_unchanged": report.p_unchanged,
        "poses": report.poses,
        "data_problem": report.data_problem,
        "outside": report.outside,
        "explanation": change_headline(report),
    }


def _usual_document(usual: Change) -> dict[str, Any]:
    seen = math.isfinite(usual.sigma)  # else these poses do not show it
    keys = ("what", "joint", "size", "sigma", "unit")
    return {key: getattr(usual, key) if seen or key not in ("size", "sigma") else None for key in keys}


def watch_document(reports: Sequence[ChangeReport], repeats: Sequence[PoseFigures] = ()) -> dict[str, Any]:
    """Document that `inspector watch --json` prints: the last measurement, all in order under "new", and repeats."""
    return {**document(reports[-1]), "new": reports, "iso9283": [_repeats_document(pose) for pose in repeats]}


def _repeats_document(pose: PoseFigures) -> dict[str, Any]:
    keys = {"name": "session", "pose": "pose", "visits": "visits", "rp_mm": "rp_mm", "ap_mm": "ap_mm"}
    return {
        "pose": pose.pose,
        "sessions": [{key: getattr(s, name) for key, name in keys.items()} for s in pose.sessions],
        "dap_mm": pose.dap_mm,
        "drp_mm": pose.drp_mm,
        "barycentre_moved_mm": pose.moved_mm,
    }
