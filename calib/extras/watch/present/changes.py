"""Presentation of changes in a cell that is measured again, once or over time, and of undetectable changes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from calib.extras.watch.change_models import BASE, DRIFT, NOISE, Change, change_label
from calib.extras.watch.series import SeriesReport, WatchedCell
from calib.extras.watch.watch import ChangeReport
from calib.present.over_time.comparison import misfit_sentence, or_confounded
from calib.present.results import document, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Bullets, Facts, FigurePlace, Paragraph, Presentation, Section, Table, Verdict
from calib.rendering.colours import DOUBT, GOOD, VERDICT_COLOURS
from calib.rendering.text import block_text

_WHAT = {
    "joint_zero": "the zero",
    "compliance": "the compliance",
    "length": "a length",
    "angle": "an angle",
    "backlash": "the backlash",
}
_CHART = "The error at the check poses, against its limit."
_MOVED = {"scanner": "moved", "tool": "moved", "jig": "moved", "warmth": "grew"}


@presentation.register
def _change_report(report: ChangeReport) -> Presentation:
    limits = [
        ("check poses", report.poses),
        ("3D error, RMS", numbers.length(report.rmse_mm)),
        ("limit where nothing changed", numbers.length(report.limit_mm)),
    ]
    head: list[Block] = [*change_verdict(report), Facts(limits), FigurePlace("control_chart", ((report,),), _CHART)]
    return Presentation(f"Watch: {report.name}", head, change_sections([report]))


@presentation.register
def _series_report(found: SeriesReport) -> Presentation:
    left = time_left_sentence(found)
    verdict = Verdict(series_sentence(found), GOOD if found.is_steady else DOUBT)
    return Presentation("Over the checks", [verdict, *([Paragraph(left)] if left else [])])


def cell_verdict(cell: WatchedCell) -> list[Block]:
    """Blocks with the verdict on the last measurement of a cell, and on all of them together."""
    return [*change_verdict(cell.seen[-1]), *_together(cell)]


def _together(cell: WatchedCell) -> Sequence[Block]:
    """Blocks on what all measurements show, or on why no drift is sought."""
    if cell.undated:
        missing = f"[about] date in dataset.toml of {numbers.listing(cell.undated)}"
        return [Paragraph(f"No drift is sought over these checks, which takes {missing}, the calibration's the first.")]
    return [] if cell.together is None else presentation(cell.together).head


def change_verdict(report: ChangeReport) -> list[Block]:
    """Blocks with the verdict on one measurement of a cell."""
    verdict = Verdict(change_headline(report), VERDICT_COLOURS[report.verdict])
    without = f"The earlier fit is without {numbers.listing(report.left_out)}." if report.left_out else ""
    anew = ""
    if report.set_up_anew_mm is not None:
        anew = (
            f"The instrument was set up anew: its points are {numbers.length(report.set_up_anew_mm)} from where its "
            "earlier place would have them. That is no change of the cell."
        )
    said = (anew, without, misfit_sentence("the earlier recording", report.times_noise))
    return [verdict, *map(Paragraph, filter(None, said))]


def change_headline(report: ChangeReport) -> str:
    """Sentence or two on what changed in a cell, with the error of the check poses."""
    phrases, told = "; ".join(change_phrases(report)), f"{report.name}: {report.verdict}."
    off = (
        f"{report.poses} check poses are off by {numbers.length(report.rmse_mm)} RMS, where the noise and the earlier "
        f"fit's uncertainty make {numbers.length(report.expected_mm)}"
    )
    if phrases and report.verdict != "unchanged":
        return f"{told} {numbers.capitalised(phrases)}. {off}."
    if report.verdict == "unclear":
        off += (
            ", and no change that is tested explains it: check the rows of these poses, the target, and that this is "
            "the same arm"
        )
    return f"{told} {off}."


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
    return f"{_part(change)} {_MOVED.get(change.what, 'changed')} by {size}{metal}{_or_rivals(change)}"


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


def _or_rivals(change: Change) -> str:
    return or_confounded([name for name in change.as_well if name != BASE])


# ---- several checks together ----------------------------------------------------------------------------------------


def series_sentence(found: SeriesReport) -> str:
    """Sentence or two on the drift or step that a series of checks shows."""
    over = f"Over {len(found.names)} checks from {found.dates[0]} to {found.dates[-1]}"
    change = found.change
    if change is None:
        what = "nothing drifts or steps" if found.is_steady else "no single drift or step explains what changes"
        return f"{over} {what} (probability of this much by chance: {numbers.probability(found.p_unchanged)})."
    size = numbers.with_sigma(change.size, change.sigma, change.unit)
    if found.course == DRIFT:
        return f"{over}: {_part(change)} drifts by {size} a day since the calibration{_or_rivals(change)}."
    checks = [f"{name} ({when[:10]})" for name, when in zip(found.names, found.dates, strict=True)]
    first = found.names.index(found.onset or "")
    when = f"between {checks[first - 1]} and {checks[first]}" if first else "before the first check"
    return f"{over}: {_part(change)} {_MOVED.get(change.what, 'changed')} by {size} {when}{_or_rivals(change)}."


def time_left_sentence(found: SeriesReport) -> str:
    """Sentence on the time until the tolerance is reached; "" where none was given."""
    left = found.time_left
    if left is None:
        return ""
    now = f"The check poses are off by {numbers.length(left.now_mm)} RMS now, without noise"
    limit = numbers.length(left.tolerance_mm)
    if left.now_mm >= left.tolerance_mm:
        return f"{now}: the tolerance of {limit} is reached."
    if left.likely is None:
        return f"{now}; these checks show no drift that would reach the tolerance of {limit}."
    earliest, latest = (numbers.MISSING if t is None else f"{t:.0f}" for t in (left.earliest, left.latest))
    span = f"{earliest} to {latest}" if left.latest is not None else f"{earliest} or more"
    time = numbers.count(round(left.likely), "day")
    return f"{now}; at this rate the tolerance of {limit} is reached in {time} (90 % interval: {span})."


# ---- sections, tables -----------------------------------------------------------------------------------------------


def change_sections(reports: Sequence[ChangeReport]) -> list[Section]:
    """Sections on each measurement, and undetectable changes."""
    unseen = unseen_sentences(reports[-1])
    return [
        *([Section("Each measurement", [measurements(reports)])] if len(reports) > 1 else []),
        *([Section("What these poses could not see", [Bullets(unseen)], brief=True)] if unseen else []),
    ]


def measurements(reports: Sequence[ChangeReport]) -> Table:
    """Table of the measurements: what changed and the error of each, with dates where they are known."""
    rows = [
        (
            report.name,
            report.date or numbers.MISSING,
            "; ".join(change_phrases(report)) or report.verdict,
            numbers.column_mm(report.rmse_mm),
            numbers.column_mm(report.limit_mm),
        )
        for report in reports
    ]
    return Table(("", "date", "what changed", "error, mm", "limit, mm"), rows, left=range(3))


def unseen_sentences(report: ChangeReport) -> list[str]:
    """Sentences on changes that the poses could not have shown, and on poses where the model is not confirmed."""
    label = {d: change_label(d.what, d.joint, d.parameter) for d in report.unseen}
    never = [name for d, name in label.items() if d.size is None]
    small = [f"{name} below {numbers.size(d.size, d.unit)}" for d, name in label.items() if d.size is not None]
    return [
        *([f"Never seen by these poses, or taken for the instrument: {', '.join(never)}."] if never else []),
        *([f"Not seen by these poses: {', '.join(small)}."] if small else []),
        *([report.outside_words] if report.outside_words else []),
    ]


# ---- documents ------------------------------------------------------------------------------------------------------


@document.register
def _change_document(report: ChangeReport) -> dict[str, Any]:
    return {
        **vars(report),
        "unseen": report.unseen,
        "explanation": change_headline(report),
    }


@document.register
def _series_document(found: SeriesReport) -> dict[str, Any]:
    return {**vars(found), "explanation": f"{series_sentence(found)} {time_left_sentence(found)}".strip()}


def watch_document(cell: WatchedCell) -> dict[str, Any]:
    """Document that `inspector watch --json` prints: the last measurement, and all in order under "new".

    Of three checks or more "series" is what they show together, and "trend" the drift in it by day.
    """
    return {
        **document(cell.seen[-1]),
        "new": cell.seen,
        "series": cell.together,
        "trend": [] if cell.together is None else _trends(cell.together),
    }


def _trends(found: SeriesReport) -> list[dict[str, Any]]:
    """Drift of a series by day, none where nothing drifts."""
    change, left = found.change, found.time_left
    if change is None or found.course != DRIFT:
        return []
    drift = {"what": change.what, "joint": change.joint, "per_day": change.size, "sigma": change.sigma}
    return [{**drift, "unit": change.unit, "days_left": None if left is None else left.likely}]


def watch_summary(cell: WatchedCell) -> list[str]:
    """Paragraphs that `inspector watch` prints: each measurement, the last in full, and the series."""
    *earlier, last = cell.seen
    return [*map(change_headline, earlier), last.summary(), block_text(*_together(cell))]
