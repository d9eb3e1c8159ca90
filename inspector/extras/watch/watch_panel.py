"""Tab Watch: later measurements of the same cell, compared with the calibration on show."""

from __future__ import annotations

from collections.abc import Callable

import viser

from calib.extras.watch.present.changes import cell_verdict, change_sections
from calib.extras.watch.series import WatchedCell
from calib.rendering import html
from inspector.extras.watch.watch_plots import control_chart
from inspector.markup.parts import elements
from inspector.panels.base import SECONDARY, Actions, by_page, hidden_plot, put
from inspector.session.view import View

NOTE = (
    "Is the calibration still right? A few poses measured later tell what changed since, and what they could not have "
    "detected. The arm is not blamed for what a moved instrument explains."
)
MOVED = "Instrument moved"
NONE, ALL = "–", "all other datasets"


class WatchPanel:
    """Choice of later measurements, the changes found, and the control chart."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        gui.add_html(elements.note(NOTE))
        self.later = gui.add_dropdown(
            "Measured later", (NONE,), hint="another dataset of the folder; choose one after the other"
        )
        self.moved = gui.add_checkbox(
            MOVED, False, hint="it was set up again: its new place is then not reported as a change"
        )
        self._clear = gui.add_button("Clear", color=SECONDARY, hint="clear the choice", visible=False)
        self._state = gui.add_html("")
        self._plot = hidden_plot(gui, 0.7, "control chart")
        self._found = gui.add_html("")
        self._name = ""  # of the dataset on show
        self._chosen: dict[str, tuple[str, ...]] = {}  # by dataset on show
        self._drawn: WatchedCell | None = None
        self.on_asked: Callable[[bool], None] = lambda forget: None  # told of each choice, and whether to forget it
        self.later.on_update(lambda e: self.on_asked(False) if by_page(e) else None)
        self.moved.on_update(lambda e: self.on_asked(False) if by_page(e) else None)
        self._clear.on_click(lambda _: self.on_asked(True))

    @property
    def chosen(self) -> tuple[str, ...]:
        """Names of the chosen later datasets, in the order chosen."""
        return self._chosen.get(self._name, ())

    @property
    def scanner_moved(self) -> bool:
        """Whether the user states that the instrument was set up again."""
        return bool(self.moved.value)

    def offer(self, name: str, others: tuple[str, ...], *, forget: bool) -> None:
        """Update the datasets that can be chosen; one just picked is added to those chosen."""
        picked = str(self.later.value) if name == self._name else NONE
        self._name = name
        chosen = () if forget else tuple(n for n in self.chosen if n in others)
        joins = others if picked == ALL else (picked,) if picked in others else ()
        self._chosen[name] = chosen = tuple(dict.fromkeys((*chosen, *joins)))
        left = tuple(n for n in others if n not in chosen)
        options = (NONE, *([ALL] if len(left) > 1 else []), *left)
        if options != tuple(self.later.options):
            self.later.options = options
        self.later.disabled = self.moved.disabled = not others
        if str(self.later.value) != NONE:
            put(self.later, NONE)
        self._clear.visible = bool(chosen)

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
        self._plot.figure = control_chart(cell.seen)
        self._drawn = cell
