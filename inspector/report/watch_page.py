"""A watched cell as one page: what changed, the control chart, what could not be seen, repeats by ISO 9283."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from calib.display.blocks import (
    Block,
    Bullets,
    Facts,
    KeyFigures,
    Paragraph,
    Section,
    Table,
    VerdictLine,
)
from calib.display.colours import VERDICT_COLOURS
from calib.monitoring.control_chart import in_time
from calib.monitoring.iso9283 import CAVEAT, PoseFigures
from calib.monitoring.watch import Watched
from inspector.figures.svg.file import svg_file
from inspector.figures.watch_plots import control_chart
from inspector.markup.model.watch import (
    EACH,
    REPEATS,
    USUAL_NOTE,
    each_rows,
    repeat_rows,
    unseen_sentences,
    usual_rows,
)
from inspector.markup.parts import numbers
from inspector.report.figure_block import Figure
from inspector.report.page import render_page
from inspector.report.report import versions

METHOD = (
    "The earlier fit predicts each check pose; what it does not know of its parameters and of the scanner's place, and "
    "the noise, make the limit. Each kind of change is fitted by generalised least squares, the scanner where it was "
    "and with its place free; nothing is blamed on the arm that a moved scanner explains.",
    "Of unchanged cells fewer than one in a hundred is called changed, over all kinds together.",
)


def watch_html(base: str, seen: Sequence[Watched], repeats: Sequence[PoseFigures], *, now: datetime) -> str:
    """The page of a cell whose earlier calibration is `base`."""
    made = now.astimezone().strftime("%Y-%m-%d %H:%M %Z").strip()
    shown = in_time(seen)
    last = shown[-1]
    unseen = unseen_sentences(last)
    head: list[Block] = [
        KeyFigures([("Calibration", base), ("Measurements", len(shown)), ("Made", made)]),
        VerdictLine(numbers.typeset(last.headline), VERDICT_COLOURS[last.verdict]),
        Figure(control_chart(shown), "The error at the check poses of each measurement, against its limit."),
    ]
    usual = Table(("", *(w.name for w in shown)), usual_rows(shown))
    visited = Table(REPEATS, repeat_rows(repeats), caption="mm")
    sections = [
        Section("Each measurement", (Table(EACH, each_rows(shown), left=(0, 1, 2, 3)),)),
        Section("Every joint and the tool", (usual, Paragraph(USUAL_NOTE, soft=True))),
        Section("What these poses could not see", (Bullets(unseen or ["Nothing of note."]),)),
        *([Section("Repeats", (visited, Paragraph(CAVEAT, soft=True)))] if repeats else []),
        Section("Method", (Bullets(METHOD),)),
        Section("Made with", (Facts(versions()),)),
    ]
    return render_page(f"Watch: {base}", head, sections)


def watch_svg(seen: Sequence[Watched]) -> str:
    """The control chart as a file of its own."""
    return svg_file(control_chart(seen), 850, 360, title="control chart")
