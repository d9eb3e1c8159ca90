"""Presentation of changes in a cell that is measured again, once or over time, and of undetectable changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from calib.extras.watch.change_models import BASE, NOISE, change_label
from calib.extras.watch.change_tests import Detectable
from calib.extras.watch.control_chart import in_time, size_in_degrees, usual_name
from calib.extras.watch.courses import DRIFT, STEP
from calib.extras.watch.iso9283 import CAVEAT, PoseFigures
from calib.extras.watch.series import EWMA_WEIGHT, MovingAverage, SeriesReport
from calib.extras.watch.watch import ChangeReport
from calib.extras.watch.watched_cell import WatchedCell
from calib.lazy_modules import pd
from calib.present.over_time.comparison import misfit_sentence, or_confounded
from calib.present.results import document, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Bullets, Facts, FigurePlace, Paragraph, Presentation, Section, Table, Verdict
from calib.rendering.colours import DOUBT, GOOD, VERDICT_COLOURS
from calib.validation.cell_changes import Change

_WHAT = {
    "joint_zero": "the zero",
    "compliance": "the compliance",
    "length": "a length",
    "angle": "an angle",
    "backlash": "the backlash",
}
METHOD = (
    "The earlier fit predicts each check pose. The limit is what the noise and the uncertainty of the fit's parameters "
    "and of the instrument's frame would make. Each possible change is fitted by generalised least squares, once with "
    "the instrument where it was and once with its place free; the arm is not blamed for what a moved instrument "
    "explains.",
    "Of unchanged cells fewer than one in a hundred is called changed, over all kinds of change together.",
)
_SIDE_BY_SIDE = 3  # measurements in one table
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
    size = numbers.with_sigma(change.size, change.sigma, change.unit)
    metal = ", of which aluminium grows 23 per \N{DEGREE SIGN}C" if change.what == "warmth" else ""
    return f"{_part(change)} {_MOVED.get(change.what, 'changed')} by {size}{metal}{or_confounded(_rivals(change))}"


_MOVED = {"scanner": "moved", "tool": "moved", "jig": "moved", "warmth": "grew"}


def _part(change: Change) -> str:
    """What of the cell changed: "the zero of joint 3 (theta3)", "the tool"."""
    whole = {
        "scanner": f"the {'instrument (or the base)' if BASE in change.as_well else 'scanner on the flange'}",
        "tool": "the tool",
        "jig": "the jig (or the base)",
        "warmth": "all lengths together",
    }
    parameter = f" ({change.parameter})" if change.parameter else ""
    return whole.get(change.what) or f"{_WHAT[change.what]} of joint {change.joint}{parameter}"


def _rivals(change: Change) -> list[str]:
    return [name for name in change.as_well if name != BASE]


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


# ---- several checks together ----------------------------------------------------------------------------------------


@presentation.register
def _series_report(found: SeriesReport) -> Presentation:
    return Presentation("Over the checks", series_head(found), series_sections(found))


def series_head(found: SeriesReport) -> list[Block]:
    """Blocks with what a series of checks shows together, the time left, and the chart of the change."""
    left = time_left_sentence(found)
    verdict = Verdict(series_sentence(found), GOOD if found.is_steady else DOUBT)
    chart = [] if found.shown is None else [FigurePlace("series_chart", (found,), _SERIES_CAPTION)]
    return [verdict, *([Paragraph(left)] if left else []), *chart]


_SERIES_CAPTION = (
    "The size of one change at each check with its sigma, its moving average, and the limit that one in 200 unchanged "
    "series exceeds."
)


def series_sentence(found: SeriesReport) -> str:
    """Sentence or two on the drift or step that a series of checks shows."""
    count = len(found.names)
    over = f"Over {count} checks" + (f" from {found.when[0]} to {found.when[-1]}" if found.time_unit == "day" else "")
    change = found.change
    if change is None:
        high = [numbers.listing([average_label(a) for a in found.beyond_limit])] if found.beyond_limit else []
        by_chance = f"(probability of this much by chance: {numbers.probability(found.p_unchanged)})"
        if high:
            return f"{over} no single drift or step explains what changes {by_chance}; beyond the limit: {high[0]}."
        return f"{over} nothing drifts or steps {by_chance}."
    size = numbers.with_sigma(change.size, change.sigma, change.unit)
    rivals = or_confounded(_rivals(change))
    if found.course == DRIFT:
        what = f"{_part(change)} drifts by {size} a {found.time_unit} since the calibration{rivals}"
    else:
        when = "before the first check" if found.onset == 0 else f"between {_check(found, found.onset - 1)} and "
        when += "" if found.onset == 0 else _check(found, found.onset)
        what = f"{_part(change)} {_MOVED.get(change.what, 'changed')} by {size} {when}{rivals}"
    undecided = "; a drift and a step cannot be told apart yet" if found.either_course else ""
    since = [] if found.alarmed is None else [f"shown since {_check(found, found.alarmed)}"]
    since += [] if found.named is None else [f"named so since {_check(found, found.named)}"]
    seen = f" ({', '.join(since)})" if since else ""
    supposed = " The calibration has no date before theirs; it counts as one mean interval before the first check."
    undated = supposed if found.time_unit == "day" and found.course == DRIFT and not found.calibration_dated else ""
    return f"{over}: {what}{undecided}{seen}.{undated}"


def time_left_sentence(found: SeriesReport) -> str:
    """Sentence on the time until the tolerance is reached; "" where none was given."""
    left = found.time_left
    if left is None:
        return ""
    now = f"The check poses are off by {numbers.length(left.now_mm)} RMS now, without noise"
    limit = numbers.length(left.tolerance_mm)
    if left.now_mm >= left.tolerance_mm:
        return f"{now}: the tolerance of {limit} is reached."
    if left.likely is not None:
        earliest, latest = (numbers.MISSING if t is None else f"{t:.0f}" for t in (left.earliest, left.latest))
        span = f"{earliest} to {latest}" if left.latest is not None else f"{earliest} or more"
        time = numbers.count(round(left.likely), found.time_unit)
        return f"{now}; at this rate the tolerance of {limit} is reached in {time} (90 % interval: {span})."
    if left.earliest is None:
        return f"{now}; these checks show no drift that would reach the tolerance of {limit}."
    time = numbers.count(round(left.earliest), found.time_unit)
    return f"{now}; the fastest drift that these checks do not exclude (95 %) reaches {limit} in {time}."


def _check(found: SeriesReport, index: int) -> str:
    when = f" ({found.when[index][:10]})" if found.when[index] else ""
    return f"{found.names[index]}{when}"


def series_sections(found: SeriesReport) -> list[Section]:
    """Section with the moving average of each usual change at the last check."""
    rows = [
        (
            average_label(a),
            numbers.with_sigma(float(a.smoothed[-1]), float(a.smoothed_sigmas[-1]), a.unit, sign=True),
            f"{abs(a.z[-1]):.1f}",
        )
        for a in found.averages
    ]
    if not rows:
        return []
    caption = f"moving averages (EWMA, weight {EWMA_WEIGHT:g}) at {found.names[-1]}; limit {found.limit_z:.1f} sigma"
    note = "Of unchanged cells 1 in 200 exceeds the limit with any of them at any check of the series."
    table = Table(("change", "moving average ± sigma", "sigmas"), rows, caption=caption, left=(0,))
    return [Section("Over the checks", [table, Paragraph(note, soft=True)])]


def average_label(average: MovingAverage) -> str:
    """Label of the change whose moving average it is: "zero of joint 3", "tool, x"."""
    if average.joint is not None:
        return f"zero of joint {average.joint}"
    what, _, axis = average.what.partition("_")
    return f"{what}, {axis}"


@document.register
def _series_document(found: SeriesReport) -> dict[str, Any]:
    return {
        "names": found.names,
        "dates": found.when,
        "times": found.times,
        "time_unit": found.time_unit,
        "course": found.course,
        "change": found.change,
        "onset": found.names[found.onset] if found.course == STEP else None,
        "either_course": found.either_course,
        "p_unchanged": found.p_unchanged,
        "alarmed_since": None if found.alarmed is None else found.names[found.alarmed],
        "named_since": None if found.named is None else found.names[found.named],
        "moving_averages": [
            {"what": a.what, "joint": a.joint, "unit": a.unit, "sizes": a.sizes, "sigmas": a.sigmas, "z": a.z}
            for a in found.averages
        ],
        "limit_z": found.limit_z,
        "time_left": found.time_left,
        "explanation": " ".join(filter(None, (series_sentence(found), time_left_sentence(found)))),
    }


# ---- sections, tables -----------------------------------------------------------------------------------------------


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
    """Table of the measurements: what changed and the error of each, with dates where they are known."""
    dated = any(report.when for report in reports)
    rows = [
        (
            report.name,
            *([report.when or numbers.MISSING] if dated else []),
            "; ".join(change_phrases(report)) or report.verdict,
            numbers.column_mm(report.rmse_mm),
            numbers.column_mm(report.errors.limit_mm),
        )
        for report in reports
    ]
    columns = ("", *(["date"] if dated else []), "what changed", "error, mm", "limit, mm")
    return Table(columns, rows, left=range(len(columns) - 2))


def usual_sizes(reports: Sequence[ChangeReport]) -> Table:
    """Table of the change of each joint's zero and of the tool with its sigma, one column for each late measurement."""
    rows, count = [], len(reports)
    if count > _SIDE_BY_SIDE:
        reports = reports[-_SIDE_BY_SIDE:]
    for k, usual in enumerate(reports[-1].usual):
        name = "tool" if usual.joint is None else f"zero of joint {usual.joint}"
        unit = numbers.readable(0.0, usual.unit)[1]
        sizes = [report.usual[k] for report in reports]
        shown = [numbers.with_sigma(c.size, c.sigma, c.unit, sign=True).removesuffix(unit).rstrip() for c in sizes]
        rows.append((f"{name}, {unit}", *shown))
    caption = f"the last {len(reports)} of {count} checks; `--out` writes all as .csv" if count > len(reports) else ""
    return Table(("change ± sigma", *(report.name for report in reports)), rows, caption=caption)


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


def watch_document(cell: WatchedCell) -> dict[str, Any]:
    """Document that `inspector watch --json` prints: the last measurement, all in order under "new", and repeats.

    Of three checks or more "series" is what they show together, and "trend" the drift in it by day.
    """
    return {
        **document(cell.seen[-1]),
        "new": cell.seen,
        "iso9283": [_repeats_document(pose) for pose in cell.repeats],
        "series": cell.together,
        "trend": [] if cell.together is None else _trends(cell.together),
    }


def _trends(found: SeriesReport) -> list[dict[str, Any]]:
    """Drift of a series by day, none where nothing drifts or dates are missing."""
    change, left = found.change, found.time_left
    if change is None or found.course != DRIFT or found.time_unit != "day":
        return []
    drift = {"what": change.what, "joint": change.joint, "per_day": change.size, "sigma": change.sigma}
    return [{**drift, "unit": change.unit, "days_left": None if left is None else left.likely}]


def watch_summary(cell: WatchedCell) -> list[str]:
    """Paragraphs that `inspector watch` prints: each measurement, the last in full, repeats, and the series."""
    together = [] if cell.together is None else [cell.together.summary()]
    *earlier, last = cell.seen
    return [*map(change_headline, earlier), last.summary(), *worst_repeats(cell.repeats), *together]


def cell_verdict(cell: WatchedCell) -> list[Block]:
    """Blocks with the verdict on the last measurement of a cell, and on all of them together."""
    together = [] if cell.together is None else series_head(cell.together)
    return [*change_verdict(cell.by_date), *together]


def cell_sections(cell: WatchedCell) -> list[Section]:
    """Sections on each measurement of a cell, on single changes, and on all measurements together."""
    sections = change_sections(cell.by_date, cell.repeats)
    return [*sections, *([] if cell.together is None else series_sections(cell.together))]


def _repeats_document(pose: PoseFigures) -> dict[str, Any]:
    keys = {"name": "session", "pose": "pose", "visits": "visits", "rp_mm": "rp_mm", "ap_mm": "ap_mm"}
    return {
        "pose": pose.pose,
        "sessions": [{key: getattr(s, name) for key, name in keys.items()} for s in pose.sessions],
        "dap_mm": pose.dap_mm,
        "drp_mm": pose.drp_mm,
        "barycentre_moved_mm": pose.moved_mm,
    }
