"""Controller for opening a dataset, searching its scans and selecting poses. Runs on the worker's thread only.

Scans are searched one by one (`open` and `process` are long work), so that what is ready can be looked at meanwhile.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from functools import partial
from pathlib import Path

from calib.corners.search import CornerSearch
from calib.errors import CalibError
from calib.measurement.measured_points import counted_reasons
from calib.present.names import instrument
from calib.scans.scan import Scan
from inspector.app.controllers.model_controller import ModelController
from inspector.app.controllers.stage import SceneController
from inspector.app.page.page_state import PageState
from inspector.app.page.tabs import Panels
from inspector.panels.base import put
from inspector.scene.draw_scan import draw_corners, draw_overview
from inspector.server.background import Background, until_done
from inspector.server.worker import LongWork
from inspector.session import measuring
from inspector.session.scan_cache import ScanCache

AHEAD = 2  # scans that are read at a time
WAITING = "The fit starts when all scans have been searched. Calibrate takes the corners found so far."


class DatasetController:
    """Controller that opens datasets, works through their scans, and selects poses."""

    def __init__(
        self,
        folders: Mapping[str, Path],
        state: PageState,
        scans: ScanCache,
        panels: Panels,
        stage: SceneController,
        model: ModelController,
        *,
        on_open: Callable[[], None],
    ) -> None:
        self._folders, self._state, self._scans, self._panels = folders, state, scans, panels
        self._stage, self._model, self._on_open = stage, model, on_open
        self._background = Background("scans", AHEAD)
        self._search_s = 0.0
        self._first = True  # whether the dataset on show was not opened before

    def close(self) -> None:
        """End the threads."""
        self._background.close()

    # ---- datasets ---------------------------------------------------------------------------------------------------

    def open(self, name: str, *, again: bool = False) -> LongWork:
        """Show a dataset at once, then search its scans and fit the arm; `again`: as its files are now."""
        state, review = self._state, self._panels.review
        review.show_problem("")
        self._panels.headline.opening(name)
        try:
            session = (None if again else state.known(name)) or measuring.open_session(self._folders[name])
        except CalibError:
            if state.view is None:
                review.show_nothing()
            elif state.name:
                put(review.dataset, state.name)
            self._panels.headline.still(state.view)
            raise
        self._search_s = 0.0
        self._scans.open(session.dataset)
        self._first = again or state.known(name) is None
        state.open(name, session)
        for panel in (self._panels.fit, self._panels.redundancy, self._panels.missing_effects):
            panel.open(name, state.now)
        self._on_open()
        put(review.dataset, name)
        self._stage.scene.clear_overview()
        self._stage.scene.draw_instrument(instrument(session.dataset))
        review.set_poses(state.now)
        review.show_box(state.now)
        if self._first:
            self._stage.choose_factor()
        else:
            put(review.factor, f"{state.now.factor:g}")
        self._draw()
        self._stage.open_view()
        return self.process()

    def _draw(self) -> None:
        """Draw a dataset that was just opened."""
        self._show_progress(running=True)
        self._stage.draw_pose()
        self._panels.redundancy.update(self._state.now)
        self._panels.fit.update(self._state.now, waiting=WAITING if self._state.session.scans else "")
        self._model.show()

    def process(self) -> LongWork:
        """Long work that computes what the dataset on show lacks: redundancy, scan overview, corners, the fit."""
        fit = self._panels.fit
        if self._state.session.redundancy is None:
            self.analyse_as_chosen()
            yield
        yield from self._work_on_scans()
        self._show_progress(running=False)
        self._stage.show_corner()  # equal targets have their names only now, by all poses together
        self._stage.aim_again()
        if self._state.session.calibration is None or self._state.name in self._model.saved:
            if self._state.session.calibration is None:
                fit.update(self._state.now, waiting="Calibrating …")
            yield
            yield from self._model.start(str(fit.residual.value))
        else:
            yield from self._model.rank()

    def stopped(self) -> None:
        """Show that the user has stopped the search."""
        self._show_progress(running=False)

    def analyse(self, residual: str) -> None:
        """Analyse the redundancy of the parameters for a kind of residual."""
        self._state.keep(measuring.with_redundancy(self._state.session, residual))
        self._panels.redundancy.update(self._state.now)

    def analyse_as_chosen(self) -> None:
        """Analyse redundancy for the residual chosen in the tab Redundancy; skipped where too few poses are in use."""
        try:
            self.analyse(str(self._panels.redundancy.residual.value))
        except CalibError:
            self._panels.redundancy.update(self._state.now)

    # ---- scans ------------------------------------------------------------------------------------------------------

    def _work_on_scans(self) -> LongWork:
        """Long work that reads each scan and searches it where its corner is not measured yet, the next one ahead."""
        dataset, tried = self._state.session.dataset, set[int]()
        coming = deque[tuple[int, Future[tuple[Scan | None, CornerSearch | None]]]]()
        while True:
            started = time.perf_counter()
            while len(coming) < AHEAD and (pose := self._scans.next(self._state.now.pose, tried)) is not None:
                tried.add(pose)
                needed = pose in self._state.session.needed
                read_scan = partial(measuring.read_scan, dataset, pose, search=needed)
                coming.append((pose, self._background.submit(read_scan)))
            if not coming:
                return
            pose, future = coming.popleft()
            read = yield from until_done(future, lambda: True)
            assert read is not None
            self._show_scan(pose, *read)
            self._search_s += time.perf_counter() - started if read[1] is not None else 0.0
            self._show_progress(running=True)
            yield

    def _show_scan(self, pose: int, scan: Scan | None, search: CornerSearch | None) -> None:
        """Keep a scan's search, and draw the scan in the overview."""
        view = self._state.now
        if search is not None:
            self._state.keep(measuring.with_result(view.session, pose, search))
        if scan is None and search is not None:
            self._state.change(failures={**view.failures, view.session.dataset.poses.ids[pose]: search.failure})
        first = not self._scans.medians and self._first
        self._scans.worked_on(pose, scan, keep=pose == view.pose)
        view, stage = self._state.now, self._stage
        if scan is not None and len(scan.points_mm):
            draw_overview(stage.scene, view, pose, scan)
        if first:
            stage.choose_factor()
            stage.aim_again()
        self._panels.scans.update_list(self._state.now)
        if pose == self._state.now.pose:
            self._stage.draw_pose()
        else:
            draw_corners(stage.scene, self._state.now, stage.on_click)

    def _show_progress(self, *, running: bool) -> None:
        session = self._state.session
        searches = session.searches
        known = [(i, searches[i]) for i in session.dataset.poses.ids if i in searches]
        failed = {i: search.failure for i, search in known if search.failure}
        measured = session.dataset.points is not None
        self._panels.headline.doing(searching=running and bool(session.needed))
        self._panels.review.show_progress(
            len(searches),
            0 if measured else session.scans,
            list(failed),
            [i for i, search in known if search.corner is not None and search.corner.quality.doubts()],
            running=running,
            seconds=self._search_s or None,
            why=counted_reasons(failed) if len(failed) == session.scans else "",
        )

    # ---- poses ------------------------------------------------------------------------------------------------------

    def select(self, pose: int) -> None:
        """Select a pose and redraw everything that belongs to it."""
        session = self._state.session
        if not 0 <= pose < len(session.dataset.poses):
            return
        self._state.change(pose=pose)
        if session.dataset.points is not None and pose in session.waiting:
            self._state.keep(measuring.with_search(session, pose))  # not needed for the fit, only to be looked at
        self._stage.draw_pose()
        self._panels.fit.update_residuals(self._state.now)
        self._panels.residuals.update(self._state.now)
