"""Tab Redundancy: which parameters are indistinguishable (Park), and how many the data determine."""

from __future__ import annotations

import numpy as np
import viser

from calib.identifiability.redundancy import Redundancy
from calib.present.fit.redundancy import redundancy_blocks
from calib.present.names import joints_by_parameter
from calib.rendering import html
from inspector.figures.plots import correlation_heatmap
from inspector.markup.parts import elements
from inspector.panels.base import Actions, ChosenByDataset, by_page, hidden_plot, offer, put
from inspector.panels.input_checks import one_of
from inspector.session.measuring import measured_kinds
from inspector.session.view import RESIDUALS, View

NOTE = (
    "Pearson's r of each pair of parameters: dark red or dark blue (r\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}±1) off the "
    "diagonal means that the two "
    "always act together, so only one can be fitted. Grey means no influence at all. Hover for "
    "values; a click picks the row's joint; the sign at the figure's lower right enlarges it."
)
LENGTHS, ANGLES, ALL = "lengths (a, d)", "angles (α, θ, β)", "all, unsplit"
CHOICES = (LENGTHS, ANGLES, ALL)


class RedundancyPanel:
    """Heatmap of the correlations, and sentences on redundant parameters."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        gui.add_html(elements.note(NOTE))
        self.residual = gui.add_dropdown(
            "Measured", RESIDUALS, hint="position: points, as Park does; distance: from the reference pose, as Jang"
        )
        self._kinds = ChosenByDataset(self.residual, RESIDUALS[0])
        self.choice = gui.add_dropdown(
            "Parameters", CHOICES, hint="Park correlates lengths and angles apart; unsplit also pairs mm with rad"
        )
        self._plot = hidden_plot(gui, 0.95, "redundancy")
        self._content = gui.add_html(elements.note("Not computed yet."))
        self.residual.on_update(
            lambda e: actions.redundancy(one_of(e.target.value, RESIDUALS, RESIDUALS[0])) if by_page(e) else None
        )
        self.choice.on_update(lambda e: actions.correlation() if by_page(e) else None)

    def open(self, dataset: str, view: View) -> None:
        """Restore the choice made earlier for a dataset."""
        kind = self._kinds.open(dataset)
        offer(self.residual, measured_kinds(view.session))
        put(self.residual, kind)

    def update(self, view: View) -> None:
        """Show the session's redundancy analysis."""
        analysis = view.session.redundancy
        self._plot.visible = analysis is not None
        if analysis is None:
            self._content.content = elements.note("Not computed yet.")
            return
        at = shown(analysis, str(self.choice.value))
        joints = joints_by_parameter(view.session.dataset.robot)
        self._plot.figure = correlation_heatmap(
            [analysis.parameters[i] for i in at],
            np.asarray(analysis.pearson)[np.ix_(at, at)],
            no_influence=analysis.no_influence,
            joints=joints,
        )
        self._content.content = html.panel(redundancy_blocks(analysis))


def shown(analysis: Redundancy, choice: str) -> list[int]:
    """Indices of the chosen group of parameters: lengths or angles, as Park splits them, or all."""
    unit = {LENGTHS: "mm", ANGLES: "rad"}.get(choice)
    return [i for i, u in enumerate(analysis.units) if unit is None or u == unit]
