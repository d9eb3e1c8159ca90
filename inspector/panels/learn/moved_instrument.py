"""A move of the instrument that was found, with a button that gives it another place from there on."""

from __future__ import annotations

import viser

from inspector.panels.base import SECONDARY, Actions
from inspector.session.session import Session


class MovedInstrument:
    """Button for the first move of the instrument that the verdict claims; the verdict's sentence stands above it."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self.button = gui.add_button(
            "New setup", visible=False, color=SECONDARY, hint="finds the instrument's place anew, and fits again"
        )
        self._pose = ""  # id
        self.button.on_click(lambda _: actions.new_setup(self._pose))

    def update(self, session: Session) -> None:
        """Offer the move that a diagnosis claims; hide the button where there is none."""
        moves = () if session.diagnosis is None else session.diagnosis.instrument_moved
        self.button.visible = bool(moves)
        if moves:
            self._pose = moves[0].before
            self.button.label = f"New setup from {self._pose} on: the instrument was moved"
