"""Every change of the model: fits, effects added and removed, undo and redo. Runs on the worker's thread only.

A fit is quick and done at once. Ranking the effects and the whole diagnosis take seconds: they are done in the
background, while the worker goes on with what else is asked for. Their result counts only if the model is still the
one they began with.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Mapping
from dataclasses import replace
from typing import TypeVar

from calib.errors import CalibError
from inspector.app.controllers.face_labelling import FaceLabelling
from inspector.app.page.page_state import PageState
from inspector.app.page.tabs import Panels
from inspector.server.background import Background
from inspector.server.worker import LongWork
from inspector.session import transitions as sessions
from inspector.session.reopening import reopened
from inspector.session.session import Session
from inspector.session.session_file import Saved, Shown
from inspector.session.undo import Undo
from inspector.session.user_effects import UserEffects

T = TypeVar("T")
POSITION = "position"  # what any measured points can be fitted by


class Stopped(Exception):
    """Raised inside work in the background that nobody waits for any more."""


class ModelController:
    """What changes the calibration of the session on show, and shows it in the model's tabs.

    redraw: draws the model in the 3D view and in the tab Compare; told whether it is the dataset's first.
    draw_as: draws the view as a saved session had it.
    """

    def __init__(
        self,
        state: PageState,
        panels: Panels,
        user_effects: UserEffects,
        saved: Mapping[str, Saved],
        *,
        redraw: Callable[[bool], None],
        draw_as: Callable[[Shown], None],
    ) -> None:
        self._state, self._panels, self._user_effects = state, panels, user_effects
        self._redraw, self._draw_as = redraw, draw_as
        self._undo: dict[str, Undo] = {}  # by dataset
        self.saved = dict(saved)  # sessions to open again once their dataset is there, by its name
        self._background = Background("model")
        self._labelling = FaceLabelling(state, panels.fit)

    def close(self) -> None:
        """End the threads."""
        self._background.close()
        self._labelling.close()

    @property
    def _session(self) -> Session:
        return self._state.session

    @property
    def _steps(self) -> Undo:
        return self._undo.setdefault(self._state.name, Undo())

    def show(self) -> None:
        """The tabs about what is missing and where the model fails, as the session stands."""
        steps = self._steps
        self._panels.missing_effects.update(
            self._state.now, undo=len(steps.past), redo=len(steps.future), own=self._user_effects.problem
        )
        self._panels.residuals.update(self._state.now)

    def _change(self, session: Session) -> None:
        """A new model, with the way back to the one before."""
        self._steps.changed(self._session)
        self._show_model(session)

    def _show_model(self, session: Session) -> None:
        """Another model of the same dataset, everywhere."""
        first = self._session.calibration is None
        self._state.keep(sessions.with_versions(session, self._session))
        self._redraw(first)
        self._panels.fit.update(self._state.now)
        self.show()

    # ---- the first fit ---------------------------------------------------------------------------------------------

    def start(self, residual: str) -> LongWork:
        """The first fits of a dataset: those of a saved session where one waits for it, else the link errors.

        What can wait, names of the jig's faces that no fit has asked for yet, comes last.
        """
        saved = self.saved.pop(self._state.name, None)
        try:
            yield from self._first_fit(residual) if saved is None else self._reopen(saved, residual)
        except CalibError:  # full poses may still be fitted
            yield from self._labelling.try_it()
            raise
        yield from self._labelling.try_it()

    def _first_fit(self, residual: str) -> LongWork:
        """The link errors; by positions where these data cannot be fitted as was chosen with another dataset."""
        try:
            yield from self.calibrate(residual)
        except CalibError:
            if residual == POSITION or self._session.calibration is not None:
                raise
            yield from self.calibrate(POSITION)
            raise

    def _reopen(self, saved: Saved, residual: str) -> LongWork:
        session = self._session
        self._panels.missing_effects.say("Opening the saved session …")
        yield
        try:
            again = yield from self._beside(
                lambda: reopened(self._with_user_effects(session), saved), session
            )
        except CalibError:
            yield from self._first_fit(residual)
            raise
        if again is not None and again[0].calibration is not None:
            labels = again[0].face_labels or self._session.face_labels
            self._change(replace(sessions.seen_since(again[0], self._session), face_labels=labels))
            self._draw_as(saved.shown)
        if again is not None:
            self._panels.review.show_problem(" ".join(again[1]))
        if self._session.calibration is None:
            yield from self._first_fit(residual)
        yield from self.rank()

    # ---- the link errors --------------------------------------------------------------------------------------------

    def calibrate(self, residual: str) -> LongWork:
        """Fit the parameters to this kind of residual, then rank what could be missing."""
        dataset = self._session.dataset
        self._panels.fit.busy(True)
        try:
            if residual == "pose":
                yield from self._labelling.require()
                if self._session.dataset is not dataset:  # another one is on show now
                    return
            session = sessions.with_calibration(self._session, residual)
        except CalibError as error:
            self._panels.fit.update(self._state.now, waiting=str(error))
            raise
        finally:
            self._panels.fit.busy(False)
        if self._session.calibration is None:  # points were found since: earlier models are of other points
            self._undo.pop(self._state.name, None)
        self._change(session)
        yield from self.rank()

    # ---- effects ----------------------------------------------------------------------------------------------------

    def rank(self) -> LongWork:
        """Rank the effects by what they explain of the residual and test that, where it is not done yet."""
        session = self._session
        stale = self._user_effects.stale(self._state.name, session.user_effects)
        if session.calibration is None or (session.screening is not None and not stale):
            self.show()
            yield from self._test_residual()
            return
        self._panels.missing_effects.say("Ranking what could be missing …")
        yield
        try:
            ranked = yield from self._beside(lambda: self._ranked(session), session)
        except CalibError as error:  # nothing that the user asked for: the tab says it
            self._panels.missing_effects.say(str(error))
            return
        if ranked is None:
            return
        now = self._session
        ranked = sessions.seen_since(ranked, now)
        if ranked.calibration is session.calibration:
            self._state.keep(ranked)
            self.show()
        else:  # own effects that are in the model have changed
            self._change(ranked)
        yield from self._test_residual()
        yield from self.compare()

    def _test_residual(self) -> LongWork:
        """Test the residual, where that is not done yet; the ranking is on show meanwhile."""
        session = self._session
        if session.screening is None or session.residual_tests is not None:
            return
        yield
        tested = yield from self._beside(lambda: sessions.with_residual_tests(session), session)
        if tested is not None and self._session.screening is session.screening:
            known = replace(self._session, residual_tests=tested.residual_tests)
            self._state.keep(replace(known, advice=tested.advice, diagnosis=tested.diagnosis))
            self._panels.missing_effects.judge(self._session)
            self._panels.residuals.update(self._state.now)

    def _ranked(self, session: Session) -> Session:
        session = self._with_user_effects(session)
        return session if session.screening is not None else sessions.with_ranking(session)

    def _with_user_effects(self, session: Session) -> Session:
        effects = self._user_effects.families(self._state.name, session.measured)
        return session if effects is session.user_effects else sessions.with_user_effects(session, effects)

    def compare(self) -> LongWork:
        """Where the chosen candidate and its nearest rival differ most, worked out in the background."""
        session, name = self._session, self._panels.missing_effects.chosen
        self._panels.missing_effects.update_choice(self._state.now)
        if session.screening is None or name in session.separations:
            return
        yield
        try:
            found = yield from self._beside(lambda: sessions.separation(session, name), session)
        except CalibError:  # too few poses to fit either one whole: the ranking stands, nothing to compare
            return
        now = self._session
        if found is not None and now.screening is session.screening:
            self._state.keep(replace(now, separations={**now.separations, name: found}))
            if self._panels.missing_effects.chosen == name:
                self._panels.missing_effects.update_next(self._state.now)

    def add(self, name: str) -> LongWork:
        """Add an effect to the model; nothing happens where it is in it already."""
        if any(added.name == name for added in self._session.effects):
            yield from self.rank()
            return
        if self._session.screening is None:
            yield from self.rank()
        self._change(sessions.with_effect(self._session, name))
        yield
        yield from self.rank()

    def follow(self) -> LongWork:
        """Do what the advice says; nothing happens where there is none any more."""
        if self._session.advice is not None:
            self._change(sessions.with_advice_followed(self._session))
            yield
        yield from self.rank()

    def remove(self, name: str) -> LongWork:
        """Take an effect out of the model; nothing happens where it is not in it."""
        if all(added.name != name for added in self._session.effects):
            yield from self.rank()
            return
        self._change(sessions.without_effect(self._session, name))
        yield
        yield from self.rank()

    def move(self, by: int) -> LongWork:
        """Go back by so many changes of the model (below 0), or forward again."""
        session = self._steps.move(self._session, by)
        if session is not self._session:
            self._show_model(sessions.seen_since(session, self._session))
        yield
        yield from self.rank()

    def find(self) -> LongWork:
        """The whole diagnosis, from the link errors alone."""
        session = self._session
        stop, said = threading.Event(), ["fitting the geometry"]

        def on_step(words: str) -> None:
            if stop.is_set():
                raise Stopped
            said.append(words)

        shown = ""
        self._panels.missing_effects.finding(True)
        try:
            work = self._beside(
                lambda: sessions.with_diagnosis(self._with_user_effects(session), on_step), session
            )
            while True:
                if said[-1] != shown:
                    shown = said[-1]
                    self._panels.missing_effects.say(f"Looking for what is missing: {shown} …")
                try:
                    next(work)
                except StopIteration as end:
                    found = end.value
                    break
                yield
            if found is not None:
                self._change(sessions.seen_since(found, self._session))
        finally:
            stop.set()
            self._panels.missing_effects.finding(False)
            self.show()
        yield from self.rank()  # where another change came in between

    def _beside(self, compute: Callable[[], T], started: Session) -> Generator[None, None, T | None]:
        """The result, once it is there; None where the model on show is not the one it began with any more."""
        return self._background.run(compute, lambda: self._session.calibration is started.calibration)
