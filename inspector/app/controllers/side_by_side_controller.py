"""Comparison of another dataset with the calibration on show. Runs on the worker's thread only."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from pathlib import Path

from calib.errors import CalibError
from inspector.app.page.page_state import PageState
from inspector.panels.model.side_by_side import NONE, SideBySidePanel
from inspector.server.background import Background
from inspector.server.worker import LongWork
from inspector.session.side_by_side import Beside, beside_of_folder, beside_of_session

NOT_YET = "Nothing to compare yet: the model is fitted when the search has ended."
CHOOSE = "Choose what to see beside this calibration: another dataset of the folder."


class SideBySideController:
    """Controller that fits the chosen dataset in the background, unless it is open, and shows both calibrations."""

    def __init__(self, folders: Mapping[str, Path], state: PageState, panel: SideBySidePanel) -> None:
        self._folders, self._state, self._panel = folders, state, panel
        self._fitted: dict[tuple[str, str], Beside] = {}  # by dataset and kind of residual
        self._background = Background("beside")

    def close(self) -> None:
        """End the thread."""
        self._background.close()

    def show(self) -> LongWork:
        """Long work that compares the chosen dataset with the model on show."""
        view = self._state.now
        self._panel.offer(tuple(n for n in self._folders if n != self._state.name))
        chosen = self._panel.chosen
        if view.session.calibration is None or chosen == NONE:
            self._panel.say(NOT_YET if view.session.calibration is None else CHOOSE)
            return
        try:
            other = yield from self._other(chosen)
            now = self._state.now
            if other is None or self._panel.chosen != chosen or now.session.calibration is None:
                return
            self._panel.update(now, beside_of_session(self._state.name, now.session), other)
        except CalibError as error:
            self._panel.say(str(error), bad=True)

    def _other(self, chosen: str) -> Generator[None, None, Beside | None]:
        """Long work that ends with the errors of the chosen dataset; None where it no longer exists."""
        session = self._state.session
        known = self._state.known(chosen)
        if known is not None and known.calibration is not None:
            return beside_of_session(chosen, known)
        residual = session.calibration.residual if session.calibration is not None else "position"
        if (chosen, residual) not in self._fitted:
            self._panel.say(f"Fitting {chosen} …")
            folder = self._folders[chosen]
            work = self._background.run(lambda: beside_of_folder(chosen, folder, residual))
            found = yield from work
            if found is None:
                return None
            self._fitted[chosen, residual] = found
        return self._fitted[chosen, residual]
