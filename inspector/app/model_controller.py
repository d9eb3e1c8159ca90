"""Every change of the model: fits, effects added and removed, undo and redo. Runs on the worker's thread only.

A fit is quick and done at once. Ranking the effects and the whole diagnosis take seconds: they are done aside, while
the worker goes on with what else is asked for. Their result counts only if the model is still the one they began with.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeVar

from calib.diagnosis.pose_recommendation import nearest_rival, poses_between
from calib.errors import CalibError
from calib.measurement.labels import FaceLabels
from inspector.panels.missing_effects import LearnPanel
from inspector.server.worker import LongWork
from inspector.session import transitions as sessions
from inspector.session.session import Session
from inspector.session.session_file import Saved, reopened
from inspector.session.user_effects import OwnEffects

if TYPE_CHECKING:
    from inspector.app.stage import Stage

T = TypeVar("T")
POSITION = "position"  # what any measured points can be fitted by
POSES = 3  # at which two causes are compared
TURN_S = 0.02  # how long a look at work done aside takes; nothing else is done meanwhile


class Stopped(Exception):
    """Raised inside work aside that nobody waits for any more."""


@dataclass
class _Undo:
    """The sessions before and after the one on show, of one dataset."""

    past: list[Session] = field(default_factory=list)
    future: list[Session] = field(default_factory=list)


class Modelling:
    """What changes the calibration of the session on show."""

    def __init__(self, stage: Stage, learn: LearnPanel) -> None:
        self._stage, self._learn = stage, learn
        self._undo: dict[str, _Undo] = {}  # by dataset
        self.saved: dict[str, Saved] = {}  # sessions to open again once their dataset is there, by its name
        self.own = OwnEffects()  # none, until the app has a file of them
        self._aside = ThreadPoolExecutor(1, thread_name_prefix="inspector-aside")
        # Who asks for full poses does not wait until a ranking or a diagnosis is through.
        self._naming = ThreadPoolExecutor(1, thread_name_prefix="inspector-naming")
        self._names: tuple[Session, Future[FaceLabels]] | None = (
            None  # the last that were asked for, and of what
        )

    def close(self) -> None:
        """Let go of the threads."""
        for pool in (self._aside, self._naming):
            pool.shutdown(wait=False, cancel_futures=True)

    @property
    def _session(self) -> Session:
        return self._stage.now.session

    @property
    def _steps(self) -> _Undo:
        return self._undo.setdefault(self._stage.name, _Undo())

    def show(self) -> None:
        """The learning tab, as the session stands."""
        steps = self._steps
        self._learn.update(self._stage.now, undo=len(steps.past), redo=len(steps.future), own=self.own.words)
        self._stage.failure.update(self._stage.now)

    def _change(self, session: Session) -> None:
        """A new model, with the way back to the one before."""
        steps = self._steps
        if self._session.calibration is not None:
            steps.past.append(self._session)
        steps.future.clear()
        self._stage.show_model(session)

    # ---- the first fit ---------------------------------------------------------------------------------------------

    def start(self, residual: str) -> LongWork:
        """The first fits of a dataset: those of a saved session where one waits for it, else the link errors.

        What can wait, names of the jig's faces that no fit has asked for yet, comes last.
        """
        saved = self.saved.pop(self._stage.name, None)
        try:
            yield from self._first_fit(residual) if saved is None else self._reopen(saved, residual)
        except CalibError:  # full poses may tell what positions did not
            yield from self.label_faces()
            raise
        yield from self.label_faces()

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
        self._learn.say("Opening the saved session …")
        yield
        try:
            again = yield from self._beside(lambda: reopened(self._with_own(session), saved), session)
        except CalibError:
            yield from self._first_fit(residual)
            raise
        if again is not None and again[0].calibration is not None:
            named = again[0].face_labels or self._session.face_labels
            self._change(replace(sessions.seen_since(again[0], self._session), face_labels=named))
            self._stage.show_saved(saved.shown)
        if again is not None:
            self._stage.review.show_problem(" ".join(again[1]))
        if self._session.calibration is None:
            yield from self._first_fit(residual)
        yield from self.rank()

    # ---- the link errors --------------------------------------------------------------------------------------------

    def calibrate(self, residual: str) -> LongWork:
        """Fit the parameters to this kind of residual, then rank what could be missing."""
        dataset = self._session.dataset
        self._stage.fit.busy(True)
        try:
            if residual == "pose":
                yield from self._named()
                if self._session.dataset is not dataset:  # another one is on show now
                    return
            session = sessions.with_calibration(self._session, residual)
        except CalibError as error:
            self._stage.fit.update(self._stage.now, waiting=str(error))
            raise
        finally:
            self._stage.fit.busy(False)
        if self._session.calibration is None:  # points were found since: what was learnt before is of no use
            self._undo.pop(self._stage.name, None)
        self._change(session)
        yield from self.rank()

    def label_faces(self) -> LongWork:
        """Name the jig's faces where nothing has yet, so that full poses can be fitted at once, or why not is said."""
        try:
            yield from self._named()
        except CalibError as error:  # nothing that the user asked for: the tab says it
            self._stage.fit.update_faces(self._stage.now, str(error))
        else:
            self._stage.fit.update_faces(self._stage.now)

    def _named(self) -> LongWork:
        """The session with its names, worked out aside; the same work for all who ask for the same corners."""
        session = self._session
        if not (session.unnamed and session.searches):
            return
        if self._names is None or self._names[0].searches is not session.searches:
            self._names = session, self._naming.submit(sessions.face_names, session)
        future = self._names[1]
        while not future.done():
            wait([future], TURN_S)
            yield
            if self._session.searches is not session.searches:
                return
        self._stage.keep(replace(self._session, face_labels=future.result()))
        self._names = None

    # ---- effects ----------------------------------------------------------------------------------------------------

    def rank(self) -> LongWork:
        """Rank the effects against what is left, and judge that, where it is not known yet."""
        session = self._session
        stale = self.own.stale(self._stage.name, session.own)
        if session.calibration is None or (session.screening is not None and not stale):
            self.show()
            yield from self._judge()
            return
        self._learn.say("Ranking what could be missing …")
        yield
        try:
            ranked = yield from self._beside(lambda: self._ranked(session), session)
        except CalibError as error:  # nothing that the user asked for: the tab says it
            self._learn.say(str(error))
            return
        if ranked is None:
            return
        now = self._session
        ranked = sessions.seen_since(ranked, now)
        if ranked.calibration is session.calibration:
            self._stage.keep(ranked)
            self.show()
        else:  # own effects that are in the model have changed
            self._change(ranked)
        yield from self._judge()
        yield from self.compare()

    def _judge(self) -> LongWork:
        """Judge what is left, where that is not known yet; the ranking is on show meanwhile."""
        session = self._session
        if session.screening is None or session.remains is not None:
            return
        yield
        judged = yield from self._beside(lambda: sessions.with_judgement(session), session)
        if judged is not None and self._session.screening is session.screening:
            self._stage.keep(replace(self._session, remains=judged.remains))
            self._learn.advise(self._session)
            self._stage.failure.update(self._stage.now)

    def _ranked(self, session: Session) -> Session:
        session = self._with_own(session)
        return session if session.screening is not None else sessions.with_ranking(session)

    def _with_own(self, session: Session) -> Session:
        own = self.own.families(self._stage.name, session.measured)
        return session if own is session.own else sessions.with_own(session, own)

    def compare(self) -> LongWork:
        """Where the chosen candidate and its nearest rival differ most, worked out aside."""
        view, name = self._stage.now, self._learn.chosen
        self._learn.update_choice(view)
        session = view.session
        if (
            session.calibration is None
            or session.screening is None
            or self._learn.compared(session.screening)
        ):
            return
        calibration, screening = session.calibration, session.screening
        rival = nearest_rival(screening, name)
        chosen = next((c for c in screening.candidates if c.name == name), None)
        if rival is None or chosen is None:
            return
        yield
        try:
            poses = yield from self._beside(
                lambda: poses_between(calibration, (chosen, rival), count=POSES), session
            )
        except CalibError:  # too few poses to fit either one whole: the ranking stands, nothing to compare
            return
        if poses is not None and self._learn.chosen == name:
            self._learn.show_comparison(self._stage.now, screening, rival.name, poses)

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
        steps = self._steps
        session = self._session
        for _ in range(abs(by)):
            source, other = (steps.past, steps.future) if by < 0 else (steps.future, steps.past)
            if not source:
                break
            other.append(session)
            session = source.pop()
        if session is not self._session:
            self._stage.show_model(sessions.seen_since(session, self._session))
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
        self._learn.finding(True)
        try:
            work = self._beside(lambda: sessions.with_diagnosis(self._with_own(session), on_step), session)
            while True:
                if said[-1] != shown:
                    shown = said[-1]
                    self._learn.say(f"Looking for what is missing: {shown} …")
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
            self._learn.finding(False)
            self.show()
        yield from self.rank()  # where another change came in between

    def _beside(self, compute: Callable[[], T], started: Session) -> Generator[None, None, T | None]:
        """The result, once it is there; None where the model on show is not the one it began with any more."""
        future: Future[T] = self._aside.submit(compute)
        try:
            while not future.done():
                wait([future], TURN_S)
                yield
                if self._session.calibration is not started.calibration:
                    return None
            return future.result()
        finally:
            future.cancel()
