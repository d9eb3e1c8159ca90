"""Results in a notebook with the report's own sections and figures, where the extra `page` is installed.

`calib.display.shown` finds `html_with_figures` by name when a cell shows a result: nothing has to be imported for it.
Figures are SVG in the notebook's own colours, without a script.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import singledispatch
from itertools import count

from calib.diagnosis.result import Diagnosis
from calib.present.blocks import Block, Section
from calib.views.fit_views import diagnosis_head
from calib.views.view_page import FIGURES, view_html
from inspector import figures
from inspector.report.content import report_of
from inspector.report.figure_block import Figure, still
from inspector.report.report import HISTORY, finding_sections
from inspector.session.session import Session
from inspector.session.transitions import with_found


@singledispatch
def html_with_figures(result: object) -> str | None:
    """The view of a result; None of a kind that has no figures."""
    return None


@html_with_figures.register
def _of_diagnosis(found: Diagnosis) -> str:
    """The way of the error and the verdict, the error's fall, then the report's sections."""
    dataset = found.calibration.dataset
    report = report_of(with_found(Session(dataset), found))
    drawn = Figure(figures.error_history(found), "3D RMSE after each change of the model.", height_px=260)
    head = [*diagnosis_head(found), drawn]
    sections = finding_sections(report)
    return _view(f"Diagnosis of {dataset.name}", head, [_drawn_above(section) for section in sections])


def _drawn_above(section: Section) -> Section:
    """The error's history is drawn at the top already."""
    if section.heading != HISTORY:
        return section
    return Section(HISTORY, [block for block in section.blocks if not isinstance(block, Figure)])


@html_with_figures.register
def _view(title: str, head: Sequence[Block], sections: Sequence[Section] = ()) -> str:
    names = (f"{FIGURES}-{number}" for number in count(1))
    drawn = [Section(section.heading, still(section.blocks, names)) for section in sections]
    return view_html(title, still(head, names), drawn)
