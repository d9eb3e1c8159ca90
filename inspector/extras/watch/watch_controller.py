"""Later measurements of the cell on show, compared with its calibration in the background."""

from __future__ import annotations

from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.errors import CalibError
from calib.extras.watch.series import WatchedCell, watched_cell
from inspector.app.page.tab_controller import Page, TabController
from inspector.extras.watch.watch_panel import WatchPanel
from inspector.server.background import Background
from inspector.server.worker import LongWork
from inspector.session.side_by_side import measured_dataset

NOT_YET = "Nothing to compare them with yet: the model is fitted when the search has ended."
ALONE = (
    "This dataset is open alone: there is nothing that was measured later. Open a folder with a later measurement "
    "of the same cell, too, or import one: Open your own data."
)
CHOOSE = "Choose what was measured later: three poses or more of the same cell."


class WatchController(TabController):
    """Controller that reads later measurements in the background and shows the changes of the cell."""

    def __init__(self, page: Page, panel: WatchPanel) -> None:
        self._folders, self._state, self._worker, self._panel = page.folders, page.state, page.worker, panel
        self._measured: dict[str, Dataset] = {}
        self._last: tuple[tuple[str, ...], Calibration, WatchedCell] | None = None
        self._background = Background("watch")
        panel.on_asked = self.ask

    def close(self) -> None:
        """End the thread."""
        self._background.close()

    def model_shown(self) -> None:
        """Compare the chosen measurements with the model that was just drawn."""
        self.ask()

    def ask(self) -> None:
        """Ask the worker for the changes at the chosen later datasets."""
        if self._state.view is not None:
            self._worker.submit("watch", self._show)

    def _show(self) -> LongWork:
        """Long work that shows the changes of the cell at the chosen later datasets."""
        base = self._state.session.calibration
        chosen = self._chosen()
        if base is None or not chosen:
            self._panel.say(NOT_YET if base is None else CHOOSE if len(self._folders) > 1 else ALONE)
            return
        if self._last is None or self._last[0] != chosen or self._last[1] is not base:
            if missing := [n for n in chosen if n not in self._measured]:
                self._panel.say(f"Reading {', '.join(missing)} …")
            try:
                cell = yield from self._background.run(lambda: self._watched(base, chosen))
            except CalibError as error:
                self._panel.say(str(error), bad=True)
                return
            if cell is None or self._state.session.calibration is not base or self._chosen() != chosen:
                return
            self._last = (chosen, base, cell)
        self._panel.update(self._state.now, self._last[2])

    def _chosen(self) -> tuple[str, ...]:
        name = self._state.name
        return self._panel.chosen(name, tuple(other for other in self._folders if other != name))

    def _watched(self, base: Calibration, chosen: tuple[str, ...]) -> WatchedCell:
        for name in chosen:
            if name not in self._measured:
                self._measured[name] = measured_dataset(self._folders[name])
        return watched_cell(base, [self._measured[name] for name in chosen])
