"""HTML page on a watched cell: changes, the control chart, undetectable changes, repeats by ISO 9283."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from calib.monitoring.control_chart import in_time
from calib.monitoring.iso9283 import PoseFigures
from calib.monitoring.watch import ChangeReport
from calib.present.changes import METHOD, change_sections, change_verdict, control_chart
from calib.rendering.blocks import Block, Bullets, Facts, KeyFigures, Presentation, Section
from inspector.figures import watch_plots
from inspector.figures.svg.file import svg_file
from inspector.report.page import render
from inspector.report.report import versions


def watch_html(base: str, reports: Sequence[ChangeReport], repeats: Sequence[PoseFigures], *, now: datetime) -> str:
    """HTML of the page on a cell whose earlier calibration is `base`."""
    made = now.astimezone().strftime("%Y-%m-%d %H:%M %Z").strip()
    in_order = in_time(reports)
    head: list[Block] = [
        KeyFigures([("Calibration", base), ("Measurements", len(in_order)), ("Made", made)]),
        *change_verdict(in_order),
        control_chart(in_order),
    ]
    sections = [
        *change_sections(in_order, repeats),
        Section("Method", (Bullets(METHOD),)),
        Section("Made with", (Facts(versions()),)),
    ]
    return render(Presentation(f"Watch: {base}", head, sections))


def watch_svg(reports: Sequence[ChangeReport]) -> str:
    """SVG file of the control chart."""
    return svg_file(watch_plots.control_chart(reports), 850, 360, title="control chart")
