"""A watched cell as one page: what changed, the control chart, what could not be seen, repeats by ISO 9283."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from calib.monitoring.control_chart import in_time, shown_size
from calib.monitoring.iso9283 import CAVEAT, PoseFigures
from calib.monitoring.kinds import kind_words_of
from calib.monitoring.watch import Watched
from inspector.figures.control_chart import control_chart
from inspector.figures.svg.figure import svg_of
from inspector.markup.parts import numbers
from inspector.markup.parts.palette import BAD, DOUBT, GOOD
from inspector.report.blocks import (
    Block,
    Bullets,
    Facts,
    Figure,
    KeyFigures,
    Paragraph,
    Section,
    Table,
    VerdictLine,
)
from inspector.report.page import render_page
from inspector.report.report import versions

METHOD = (
    "The earlier fit predicts each check pose; what it does not know of its parameters and of the scanner's place, and "
    "the noise, make the limit. Each kind of change is fitted by generalised least squares, the scanner where it was "
    "and with its place free; nothing is blamed on the arm that a moved scanner explains.",
    "Of unchanged cells fewer than one in a hundred is called changed, over all kinds together.",
)
_COLOURS = {"unchanged": GOOD, "unclear": DOUBT, "changed": BAD}


def watch_html(base: str, seen: Sequence[Watched], repeats: Sequence[PoseFigures], *, now: datetime) -> str:
    """The page of a cell whose earlier calibration is `base`."""
    made = now.astimezone().strftime("%Y-%m-%d %H:%M %Z").strip()
    shown = in_time(seen)
    last = shown[-1]
    unseen = [numbers.typeset(said) for said in last.unseen_words]
    head: list[Block] = [
        KeyFigures([("Calibration", base), ("Measurements", len(shown)), ("Made", made)]),
        VerdictLine(numbers.typeset(last.headline), _COLOURS[last.verdict]),
        Figure(control_chart(shown), "The error at the check poses of each measurement, against its limit."),
    ]
    sections = [
        Section("Each measurement", (_each(shown),)),
        Section("Every joint and the tool", (_sizes(shown), Paragraph(_USUAL, soft=True))),
        Section(
            "What these poses could not see",
            (Bullets(unseen or ["Nothing of note."]),),
        ),
        *([Section("Repeats", (_repeats(repeats), Paragraph(CAVEAT, soft=True)))] if repeats else []),
        Section("Method", (Bullets(METHOD),)),
        Section("Made with", (Facts(versions()),)),
    ]
    return render_page(f"Watch: {base}", head, sections)


_USUAL = "Size ± sigma of each joint's zero and of the tool beside what is named above, whether they changed or not."


def watch_svg(seen: Sequence[Watched]) -> str:
    """The control chart as a file of its own."""
    drawn = svg_of(control_chart(seen), 850, 360, name="watch", title="control chart")
    style = (
        "<style>.plot{--ink:#1f2328;--soft:#59636e;--line:#d1d9e0;background:#fff;font-family:sans-serif}"
        ".plot text{fill:var(--ink)}.plot .grid{stroke:var(--line);fill:none}"
        ".plot .zero,.plot .ruler{stroke:var(--soft);fill:none}</style>"
    )
    start = drawn.index(">") + 1
    return drawn[:start].replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ') + style + drawn[start:]


def _each(seen: Sequence[Watched]) -> Table:
    rows = [
        (
            w.name, w.when.replace("-", "\u2011") or "–", w.verdict,
            numbers.typeset("; ".join(w.told)) or "–", numbers.millimetres(w.rmse_mm),
            numbers.millimetres(w.errors.limit_mm),
        )
        for w in seen
    ]  # fmt: skip
    return Table(("", "date", "", "what changed", "error, mm", "limit, mm"), rows, left=(0, 1, 2, 3))


def _sizes(seen: Sequence[Watched]) -> Table:
    rows = []
    for k, found in enumerate(seen[-1].usual):
        cells = []
        for w in seen:
            size, sigma = shown_size(w.usual[k])
            cells.append(f"{size:+.2g} ± {sigma:.1g}" if sigma < 1e6 else "not seen")
        unit = "°" if found.unit == "rad" else found.unit
        rows.append((f"{kind_words_of(found.what, found.joint)}, {unit}", *cells))
    return Table(("", *(w.name for w in seen)), rows)


def _repeats(repeats: Sequence[PoseFigures]) -> Table:
    rows = [
        (
            p.pose, " + ".join(str(s.visits) for s in p.sessions),
            *(_mm(v) for v in (p.sessions[-1].rp_mm, p.sessions[-1].ap_mm, p.dap_mm, p.drp_mm, p.moved_mm)),
        )
        for p in repeats
    ]  # fmt: skip
    return Table(("pose", "visits", "RP", "AP", "dAP", "dRP", "barycentre moved"), rows, caption="mm")


def _mm(value: float | None) -> str:
    return "–" if value is None else numbers.millimetres(value)
