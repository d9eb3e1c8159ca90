"""Tab Watch: later measurements of the same cell, compared with the calibration on show."""

from __future__ import annotations

from collections.abc import Callable

import viser

from calib.extras.watch.present.changes import cell_verdict, change_sections
from calib.extras.watch.series import WatchedCell
from calib.rendering import html
from inspector.extras.watch.watch_plots import chart
from inspector.markup.parts import elements
from inspector.panels.base import Actions, hidden_plot, on_page, put
from inspector.session.view import View

NOTE = (
    "Is the calibration still right? A few poses measured later tell what changed since, and what they could not have "
    "detected. The arm is not blamed for what a moved instrument explains."
)
NONE, ALL = "–", "all other datasets"


class WatchPanel:
    """Choice of later measurements, the changes found, and the control chart."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        gui.add_html(elements.note(NOTE))
        self.later = gui.add_dropdown("Measured later", (NONE,), hint="another dataset of the folder, or all of them")
        self._state = gui.add_html("")
        self._plot = hidden_plot(gui, 0.7, "control chart")
        self._found = gui.add_html("")
        self._name = ""  # of the dataset on show
        self._drawn: WatchedCell | None = None
        self.on_asked: Callable[[], None] = lambda: None  # told of each choice
        on_page(self.later, lambda _: self.on_asked())

    def chosen(self, name: str, others: tuple[str, ...]) -> tuple[str, ...]:
        """Names of the chosen later datasets, of those that can be compared with the one on show."""
        options = (NONE, *([ALL] if len(others) > 1 else []), *others)
        value = str(self.later.value) if name == self._name else NONE
        self._name = name
        if options != tuple(self.later.options):
            self.later.options = options
        if value not in options or value != str(self.later.value):
            put(self.later, value if value in options else NONE)
        self.later.disabled = not others
        return others if value == ALL else tuple(each for each in others if each == value)

    def say(self, words: str, *, bad: bool = False) -> None:
        """Show why there is no result yet."""
        self._plot.visible = False
        self._found.content, self._drawn = "", None
        self._state.content = elements.alert(words) if bad else elements.note(words)

    def update(self, view: View, cell: WatchedCell) -> None:
        """Show the changes of the cell found by the later measurements."""
        if self._drawn is cell:
            return
        self._state.content = html.panel(cell_verdict(cell))
        self._found.content = html.panel(change_sections(cell.seen))
        self._plot.visible = True
        self._plot.figure = chart(cell.seen)
        self._drawn = cell
