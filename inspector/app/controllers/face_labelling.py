"""Labelling of the jig's faces in the corners found so far, which fits of full poses need."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import replace

from calib.errors import CalibError
from calib.measurement.face_labels import FaceLabels
from inspector.app.page.page_state import PageState
from inspector.panels.model.fit import FitPanel
from inspector.server.background import Background, until_done
from inspector.server.worker import LongWork
from inspector.session import measuring
from inspector.session.session import Session


class FaceLabelling:
    """Controller that labels faces on its own thread, so that a fit of full poses need not wait for other work."""

    def __init__(self, state: PageState, panel: FitPanel) -> None:
        self._state, self._panel = state, panel
        self._background = Background("labelling")
        self._last: tuple[Session, Future[FaceLabels]] | None = None  # asked for last, and of what corners

    def close(self) -> None:
        """End the thread."""
        self._background.close()

    def require(self) -> LongWork:
        """Long work that adds face labels to the session, once for all requests. Raises CalibError."""
        session = self._state.session
        if not (session.unlabelled and session.searches):
            return
        if self._last is None or self._last[0].searches is not session.searches:
            self._last = session, self._background.submit(lambda: measuring.find_face_labels(session))
        future = self._last[1]
        labels = yield from until_done(future, lambda: self._state.session.searches is session.searches)
        if labels is not None:
            self._state.keep(replace(self._state.session, face_labels=labels))
            self._last = None

    def try_it(self) -> LongWork:
        """Long work that labels the faces; on failure the tab Fit shows why full poses cannot be fitted."""
        try:
            yield from self.require()
        except CalibError as error:  # nothing that the user asked for: no notification
            self._panel.update_faces(self._state.now, str(error))
        else:
            self._panel.update_faces(self._state.now)
