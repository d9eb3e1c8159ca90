"""Results in a notebook with the report's own sections and figures, where the extra `page` is installed.

`calib.display.shown` finds `html_with_figures` by name when a cell shows a result: nothing has to be imported for it.
Figures are SVG in the notebook's own colours, without a script.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import singledispatch
from itertools import count

from calib.calibration.result import Calibration
from calib.identifiability.redundancy import Redundancy
from calib.identifiability.structural import redundancy
from calib.present.blocks import Block, Section
from calib.present.calibration import parameters
from calib.views.fit_views import calibration_head, redundancy_head
from calib.views.view_page import FIGURES, view_html
from inspector import figures
from inspector.report.figure_block import Figure, still


@singledispatch
def html_with_figures(result: object) -> str | None:
    """The view of a result; None of a kind that has no figures."""
    return None


@html_with_figures.register
def _of_calibration(calibration: Calibration) -> str:
    """The errors, a bar a pose; how the fit went, its parameters, and which of them act alike."""
    drawn = Figure(figures.error_bars(calibration), "3D error of each pose after the fit.", height_px=260)
    analysis = redundancy(calibration.dataset, residual=calibration.residual)
    sections = [
        Section("Parameters", parameters(calibration)),
        Section("Which parameters can be known", _redundant(analysis)),
        Section(
            "Convergence",
            [Figure(figures.convergence(calibration), "Error at each iteration.", height_px=280)],
        ),
    ]
    return _view(f"Calibration of {calibration.dataset.name}", [*calibration_head(calibration), drawn], sections)


@html_with_figures.register
def _of_redundancy(analysis: Redundancy) -> str:
    """The matrix, and in words which parameters act alike."""
    return _view("Which parameters can be known", _redundant(analysis))


def _redundant(analysis: Redundancy) -> list[Block]:
    caption = "Pearson's r between the columns of the nominal Jacobian; grey: no influence."
    drawn = Figure(figures.redundancy_heatmap(analysis), caption, height_px=600, width_px=640)
    return [*redundancy_head(analysis), drawn]


def _view(title: str, head: Sequence[Block], sections: Sequence[Section] = ()) -> str:
    names = (f"{FIGURES}-{number}" for number in count(1))
    drawn = [Section(section.heading, still(section.blocks, names)) for section in sections]
    return view_html(title, still(head, names), drawn)
