"""HTML page on a watched cell: changes, the control chart, undetectable changes."""

from __future__ import annotations

from datetime import datetime

from calib.extras.watch.present.changes import METHOD, cell_verdict, change_sections, control_chart
from calib.extras.watch.series import WatchedCell
from calib.rendering.blocks import Block, Bullets, Facts, KeyFigures, Presentation, Section
from inspector.report.page import render
from inspector.report.report import versions


def watch_html(base: str, cell: WatchedCell, *, now: datetime) -> str:
    """HTML of the page on a cell whose earlier calibration is `base`."""
    made = now.astimezone().strftime("%Y-%m-%d %H:%M %Z").strip()
    head: list[Block] = [
        KeyFigures([("Calibration", base), ("Measurements", len(cell.seen)), ("Made", made)]),
        *cell_verdict(cell),
        control_chart(cell.seen),
    ]
    sections = [
        *change_sections(cell.seen),
        Section("Method", (Bullets(METHOD),)),
        Section("Made with", (Facts(versions()),)),
    ]
    return render(Presentation(f"Watch: {base}", head, sections))
