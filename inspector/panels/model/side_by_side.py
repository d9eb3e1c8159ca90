"""Tab Beside: a second dataset, compared with the calibration on show."""

from __future__ import annotations

import viser

from calib.calibration.result import Calibration
from calib.present.fit.residuals import turned
from calib.present.names import input_title
from calib.present.over_time.comparison import comparison_head, errors, parameters
from calib.rendering import html
from inspector.figures.residual_plots import errors_beside
from inspector.markup.parts import elements
from inspector.panels.base import Actions, hidden_plot, offer, on_page
from inspector.session.side_by_side import Beside, compared
from inspector.session.view import View

NOTE = (
    "Before and after a repair, or two arms of a type: another dataset beside the one on show. Each is fitted by "
    "itself, so that another place of the instrument does not count as a difference of the arms."
)
NONE = "–"


class SideBySidePanel:
    """Comparison with the calibration on show: differences, and the errors of both in one plot."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        gui.add_html(elements.note(NOTE))
        self.other = gui.add_dropdown("Beside", (NONE,), hint="another dataset of the folder")
        self.against = gui.add_dropdown("Plotted against", (NONE,), hint="what the errors are plotted against")
        self._state = gui.add_html("")
        self._plot = hidden_plot(gui, 0.75, "errors side by side")
        self._differences = gui.add_html("")
        self._drawn: tuple[object, ...] = ()  # what the figure on show is of
        self._fits: tuple[Calibration | None, ...] = (None, None)
        on_page(self.other, lambda _: actions.beside())
        on_page(self.against, lambda _: actions.beside())

    @property
    def chosen(self) -> str:
        """Choice to compare with: a dataset's name, or NONE."""
        return str(self.other.value)

    def offer(self, datasets: tuple[str, ...]) -> None:
        """Update the choices; one that is no longer available becomes NONE."""
        offer(self.other, (NONE, *datasets))

    def say(self, words: str, *, bad: bool = False) -> None:
        """Show why there is nothing to compare yet."""
        self._plot.visible = False
        self._differences.content, self._drawn = "", ()
        self._state.content = elements.alert(words) if bad else elements.note(words)

    def update(self, view: View, one: Beside, other: Beside) -> None:
        """Show both calibrations. Raises FitError for arms that cannot be compared."""
        inputs = {input_title(n, view.session.dataset.robot): n for n in ("order", *one.inputs) if n in other.inputs}
        offer(self.against, tuple(inputs) or (NONE,))
        title = str(self.against.value)
        drawing = (other.name, title)
        fits = (one.calibration, other.calibration)
        if drawing == self._drawn and all(a is b for a, b in zip(fits, self._fits, strict=True)):
            return
        found = compared(one, other)
        self._state.content = html.panel(comparison_head(found))
        self._differences.content = html.panel([errors(found), *parameters(found)])
        self._plot.visible = title in inputs
        if title in inputs:
            name, robot = inputs[title], view.session.dataset.robot
            self._plot.figure = errors_beside(
                (one.name, other.name),
                (turned(name, one.inputs[name], robot), turned(name, other.inputs[name], robot)),
                (one.error_mm, other.error_mm),
                (one.pose_ids, other.pose_ids),
                x_title=title,
            )
        self._drawn, self._fits = drawing, fits
