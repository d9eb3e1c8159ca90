"""Ranking of the effects missing from the model on show, in the background. Runs on the worker's thread only."""

from __future__ import annotations

from collections.abc import Generator
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass, replace

from calib.calibration.result import Calibration
from calib.diagnosis.moves import AddEffect
from calib.errors import CalibError
from inspector.app.controllers.shown_model import ShownModel
from inspector.server.background import Background, until_done
from inspector.server.worker import LongWork
from inspector.session import transitions as sessions
from inspector.session.planned import aims_of
from inspector.session.session import Session

AHEAD_POSES = 2000  # more are not judged before somebody asks: it takes the processor from the page


@dataclass(frozen=True)
class _Ahead:
    """The advised model, judged while the user still reads the verdict on the one before."""

    calibration: Calibration  # the advised fit
    judged: Future[Session]


class Ranking:
    """Controller that ranks effects by the residual they explain, tests the residual, and compares candidates."""

    def __init__(self, shown: ShownModel) -> None:
        self._shown = shown
        self._state, self._panel = shown.state, shown.panels.missing_effects
        self._background = Background("ahead")
        self._ahead: _Ahead | None = None

    def close(self) -> None:
        """End the thread."""
        self._background.close()

    def rank(self) -> LongWork:
        """Long work that ranks the effects and tests the residual, unless both are done."""
        session = self._shown.session
        stale = self._shown.user_effects.stale(self._state.name, session.user_effects)
        if session.calibration is None or (session.screening is not None and not stale):
            self._shown.show()
            yield from self._test_residual()
            self._look_ahead()
            return
        self._shown.panels.say("Ranking what could be missing …")
        yield
        try:
            ranked = None if stale else (yield from self._judged_ahead(session))
            if ranked is None:
                ranked = yield from self._shown.beside(lambda: self._ranked(session), session)
        except CalibError as error:  # nothing that the user asked for: the tab says it
            self._shown.panels.say(str(error))
            return
        if ranked is None:
            return
        now = self._shown.session
        ranked = sessions.seen_since(ranked, now)
        if ranked.calibration is session.calibration:
            self._state.keep(ranked)
            self._shown.show()
        else:  # own effects that are in the model have changed
            self._shown.change(ranked)
        yield from self._test_residual()
        self._look_ahead()

    def _look_ahead(self) -> None:
        """Begin to judge the model that the advice leads to, so that its verdict is there once it is asked for."""
        session = self._shown.session
        move = None if session.advice is None else session.advice.move
        if not isinstance(move, AddEffect) or len(session.dataset.poses) > AHEAD_POSES:
            return
        if self._ahead is None or self._ahead.calibration is not move.calibration:
            if self._ahead is not None:
                self._ahead.judged.cancel()
            self._ahead = _Ahead(move.calibration, self._background.submit(lambda: sessions.after_advised(session)))

    def _judged_ahead(self, session: Session) -> Generator[None, None, Session | None]:
        """Long work that ends with a session judged as it was ahead; None where it was not, or is no longer shown."""
        ahead, self._ahead = self._ahead, None
        if ahead is None or ahead.calibration is not session.calibration:
            return None
        try:
            known = yield from until_done(ahead.judged, lambda: self._shown.session.calibration is session.calibration)
        except (CalibError, CancelledError):  # an error is told where the model itself is judged
            return None
        return None if known is None else sessions.judged_as(session, known)

    def _test_residual(self) -> LongWork:
        """Long work that tests the residual, unless done; the ranking is displayed meanwhile."""
        session = self._shown.session
        if session.screening is None or session.residual_tests is not None:
            return
        yield
        tested = yield from self._shown.beside(lambda: sessions.with_residual_tests(session), session)
        if tested is not None and self._shown.session.screening is session.screening:
            known = replace(self._shown.session, residual_tests=tested.residual_tests, advice=tested.advice)
            self._state.keep(replace(known, diagnosis=tested.diagnosis, next_poses=tested.next_poses))
            self._panel.judge(self._shown.session)
            self._panel.update_choice(self._state.now)
            self._shown.panels.plan.offer(aims_of(self._shown.session))
            self._shown.panels.residuals.update(self._state.now)

    def _ranked(self, session: Session) -> Session:
        session = self.with_user_effects(session)
        return session if session.screening is not None else sessions.with_ranking(session)

    def with_user_effects(self, session: Session) -> Session:
        """Session with the user's own effects read anew from their file."""
        effects = self._shown.user_effects.families(self._state.name, session.measured)
        return session if effects is session.user_effects else sessions.with_user_effects(session, effects)
