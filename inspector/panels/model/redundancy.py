"""Tab Redundancy: which parameters are indistinguishable (Park), and how many the data determine."""

from __future__ import annotations

import viser

from calib.present.fit.redundancy import redundancy_blocks
from calib.present.names import joints_by_parameter
from calib.rendering import html
from inspector.figures.plots import correlation_heatmap
from inspector.markup.parts import elements
from inspector.panels.base import Actions, ChosenByDataset, hidden_plot, offer, on_page, put
from inspector.panels.input_checks import one_of
from inspector.session.measuring import measured_kinds
from inspector.session.view import RESIDUALS, View

NOTE = (
    "Pearson's r of each pair of parameters: dark red or dark blue (r\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}±1) off the "
    "diagonal means that the two "
    "always act together, so only one can be fitted. Grey means no influence at all. Hover for "
    "values; a click picks the row's joint; the sign at the figure's lower right enlarges it."
)


class RedundancyPanel:
    """Which parameters to keep, sentences on redundant ones, and the heatmap of their correlations."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self.residual = gui.add_dropdown(
            "Measured", RESIDUALS, hint="position: points, as Park does; distance: from the reference pose, as Jang"
        )
        self._kinds = ChosenByDataset(self.residual, RESIDUALS[0])
        self._content = gui.add_html(elements.note("Not computed yet."))
        self._plot = hidden_plot(gui, 0.95, "redundancy")
        self._legend = gui.add_html(elements.note(NOTE))
        on_page(self.residual, lambda value: actions.redundancy(one_of(value, RESIDUALS, RESIDUALS[0])))

    def open(self, dataset: str, view: View) -> None:
        """Restore the choice made earlier for a dataset."""
        kind = self._kinds.open(dataset)
        offer(self.residual, measured_kinds(view.session))
        put(self.residual, kind)

    def update(self, view: View) -> None:
        """Show the session's redundancy analysis."""
        analysis = view.session.redundancy
        self._plot.visible = self._legend.visible = analysis is not None
        if analysis is None:
            self._content.content = elements.note("Not computed yet.")
            return
        joints = joints_by_parameter(view.session.dataset.robot)
        self._plot.figure = correlation_heatmap(analysis.parameters, analysis.pearson, joints=joints)
        self._content.content = html.panel(redundancy_blocks(analysis))
