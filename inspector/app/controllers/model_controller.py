"""All changes of the model: fits, effects added and removed, undo and redo. Runs on the worker's thread only.

A fit is quick and done at once. Ranking the effects and the whole diagnosis take seconds: they are done in the
background, while the worker goes on with what else is asked for. Their result counts only if the model is still the
one they began with.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass, replace
from typing import TypeVar

from calib.calibration.result import Calibration
from calib.diagnosis.moves import AddEffect
from calib.errors import CalibError
from calib.measurement.face_labels import FaceLabels
from inspector.app.page.page_state import PageState
from inspector.app.page.tabs import Panels
from inspector.server.background import Background, until_done
from inspector.server.worker import LongWork
from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.planned import aims_of
from inspector.session.reopening import reopened
from inspector.session.session import Session, tests_of
from inspector.session.session_file import Saved, Shown
from inspector.session.undo import Undo
from inspector.session.user_effects import UserEffects

T = TypeVar("T")

POSITION = "position"  # what any measured points can be fitted by
AHEAD_POSES = 2000  # more are not judged before somebody asks: it takes the processor from the page


class Stopped(Exception):
    """Exception inside background work whose result is no longer needed."""


@dataclass(frozen=True)
class _Ahead:
    """The advised model, judged while the user still reads the verdict on the one before."""

    calibration: Calibration  # the advised fit
    judged: Future[Session]


class ModelController:
    """Controller that changes the calibration of the session on show, and updates the model's tabs.

    redraw: draws the model in the 3D view and in the tab Compare; told whether it is the dataset's first.
    recount: shows which poses are left out; told of which that has changed.
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
        recount: Callable[[frozenset[str]], None],
        draw_as: Callable[[Shown], None],
    ) -> None:
        self._state, self._panels, self._user_effects = state, panels, user_effects
        self._redraw, self._recount, self._draw_as = redraw, recount, draw_as
        self._undo: dict[str, Undo] = {}  # by dataset
        self._background, self._ahead_work = Background("model"), Background("ahead")
        self._ahead: _Ahead | None = None
        self.saved = dict(saved)  # sessions to open again once their dataset is there, by its name
        self._labelling = Background("labelling")  # so that a fit of full poses need not wait for other work
        self._labelled: tuple[Session, Future[FaceLabels]] | None = None  # asked for last, and of what corners

    def close(self) -> None:
        """End the threads."""
        self._background.close()
        self._ahead_work.close()
        self._labelling.close()

    @property
    def steps(self) -> Undo:
        """Undo and redo of the model on show."""
        return self._undo.setdefault(self._state.name, Undo())

    @property
    def _session(self) -> Session:
        return self._state.session

    def choose(self, name: str = "") -> None:
        """Choose an effect, if one is named, and show the one that is chosen."""
        if name:
            self._panels.missing_effects.choose(name)
        self._panels.missing_effects.update_choice(self._state.now)

    # ---- the first fit ---------------------------------------------------------------------------------------------

    def start(self, residual: str) -> LongWork:
        """Long work that makes a dataset's first fits: as in its saved session, else a fit of the link errors.

        What can wait, names of the jig's faces that no fit has asked for yet, comes last.
        """
        saved = self.saved.pop(self._state.name, None)
        try:
            yield from self._first_fit(residual) if saved is None else self._reopen(saved, residual)
        except CalibError:  # full poses may still be fitted
            yield from self._try_labels()
            raise
        yield from self._try_labels()

    def _first_fit(self, residual: str) -> LongWork:
        """Long work that fits the link errors, to positions if these data do not allow the chosen residual."""
        try:
            yield from self.calibrate(residual)
        except CalibError:
            if residual == POSITION or self._session.calibration is not None:
                raise
            yield from self.calibrate(POSITION)
            raise

    def _reopen(self, saved: Saved, residual: str) -> LongWork:
        session = self._session
        self._panels.say("Opening the saved session …")
        yield
        try:
            again = yield from self._beside(lambda: reopened(self._with_user_effects(session), saved), session)
        except CalibError:
            if self._session.calibration is None:
                yield from self._first_fit(residual)
            raise
        if again is not None and again[0].calibration is not None:
            labels = again[0].face_labels or self._session.face_labels
            self._change(replace(sessions.seen_since(again[0], self._session), face_labels=labels))
            self._undo[self._state.name] = Undo.of(again[0])
            self._draw_as(saved.shown)
        if again is not None:
            self._panels.review.show_problem(" ".join(again[1]))
        if self._session.calibration is None:
            yield from self._first_fit(residual)
        yield from self.rank()

    # ---- the link errors --------------------------------------------------------------------------------------------

    def calibrate(self, residual: str) -> LongWork:
        """Long work that fits the parameters with a kind of residual, then ranks what could be missing."""
        dataset = self._session.dataset
        self._panels.fit.busy(True)
        self._panels.headline.doing(problem="")
        try:
            if residual == "pose":
                yield from self._require_labels()
                if self._session.dataset is not dataset:  # another one is on show now
                    return
            session = sessions.with_calibration(self._session, residual)
        except CalibError as error:
            self._panels.fit.update(self._state.now, waiting=str(error))
            self._panels.headline.doing(problem=str(error))
            raise
        finally:
            self._panels.fit.busy(False)
        if self._session.calibration is None:  # points were found since: earlier models are of other points
            self._forget_steps()
        self._change(session)
        yield from self.rank()

    def _require_labels(self) -> LongWork:
        """Long work that adds face labels to the session, once for all requests. Raises CalibError."""
        session = self._state.session
        if not (session.unlabelled and session.searches):
            return
        if self._labelled is None or self._labelled[0].searches is not session.searches:
            self._labelled = session, self._labelling.submit(lambda: measuring.find_face_labels(session))
        future = self._labelled[1]
        labels = yield from until_done(future, lambda: self._state.session.searches is session.searches)
        if labels is not None:
            self._state.keep(replace(self._state.session, face_labels=labels))
            self._labelled = None

    def _try_labels(self) -> LongWork:
        """Long work that labels the faces; on failure the tab Fit shows why full poses cannot be fitted."""
        try:
            yield from self._require_labels()
        except CalibError as error:  # nothing that the user asked for: no notification
            self._panels.fit.update_faces(self._state.now, str(error))
        else:
            self._panels.fit.update_faces(self._state.now)

    # ---- poses ------------------------------------------------------------------------------------------------------

    def leave_out(self, pose_id: str, out: bool) -> LongWork:
        """Long work that leaves a pose out, or uses it again; skipped where nothing would change."""
        if out:
            yield from self.leave_out_poses((pose_id,))
            return
        if pose_id in self._session.uncounted:
            self._with_other_poses(sessions.with_pose_taken_in(self._session, pose_id))
            yield
        yield from self.rank()

    def leave_out_poses(self, pose_ids: Sequence[str]) -> LongWork:
        """Long work that leaves several poses out as one change, those that the dataset has and that are in use."""
        session = self._session
        ids = [i for i in pose_ids if i in session.dataset.poses.ids and i not in session.uncounted]
        if ids:
            self._with_other_poses(sessions.with_poses_left_out(session, *ids))
            yield
        yield from self.rank()

    def new_setup(self, pose_id: str) -> LongWork:
        """Long work that gives the instrument another place from a pose on, and fits the links anew."""
        if pose_id not in self._session.dataset.new_setups:
            session = sessions.with_new_setup(self._session, pose_id)
            self._forget_steps()  # earlier models are of an instrument that stood still
            self._replace(session)
            yield
        yield from self.rank()

    def _with_other_poses(self, session: Session) -> None:
        """Show a session in which other poses count: a change of the model where there is one."""
        (self._replace if self._session.calibration is None else self._change)(session)

    # ---- effects ----------------------------------------------------------------------------------------------------

    def add(self, name: str) -> LongWork:
        """Long work that adds an effect to the model, unless the model has it already."""
        has = any(added.name == name for added in self._session.effects)
        if not has and self._session.screening is None:
            yield from self.rank()
        yield from self._changed(None if has else sessions.with_effect(self._session, name))

    def remove(self, name: str) -> LongWork:
        """Long work that removes an effect from the model, if the model has it."""
        has = any(added.name == name for added in self._session.effects)
        return self._changed(sessions.without_effect(self._session, name) if has else None)

    def follow(self) -> LongWork:
        """Long work that makes the advised change of the model, where there is one."""
        if self._session.advice is not None:
            self._change(sessions.with_advice_followed(self._session))
            self._choose_last()
            yield
        yield from self.rank()

    def _changed(self, session: Session | None) -> LongWork:
        """Long work that shows a changed model, if any, and ranks what could be missing."""
        if session is not None:
            self._change(session)
            yield
        yield from self.rank()

    def _choose_last(self) -> None:
        """Select the effect added last, in the tables of the tab."""
        if self._session.effects:
            self._panels.missing_effects.choose(self._session.effects[-1].name)
            self.show()

    def move(self, by: int) -> LongWork:
        """Long work that undoes (for a negative number) or redoes a number of changes of the model."""
        session = self.steps.move(self._session, by)
        if session is not self._session:
            self._replace(sessions.seen_since(session, self._session))
        yield
        yield from self.rank()

    def _finding(self, running: bool) -> None:
        self._panels.missing_effects.finding(running)
        self._panels.headline.doing(finding=running)

    def find(self) -> LongWork:
        """Long work that runs the whole diagnosis, starting from the link errors alone."""
        session = self._session
        stop, said = threading.Event(), ["fitting the geometry"]

        def on_step(words: str) -> None:
            if stop.is_set():
                raise Stopped
            said.append(words)

        shown = ""
        self._finding(True)
        try:
            work = self._beside(lambda: sessions.with_diagnosis(self._with_user_effects(session), on_step), session)
            while True:
                if said[-1] != shown:
                    shown = said[-1]
                    self._panels.say(f"Looking for what is missing: {shown} …")
                try:
                    next(work)
                except StopIteration as end:
                    found = end.value
                    break
                yield
            if found is not None:
                self._change(sessions.seen_since(found, self._session))
                self._choose_last()
        finally:
            stop.set()
            self._finding(False)
            self.show()
        yield from self.rank()  # where another change came in between

    # ---- what could be missing --------------------------------------------------------------------------------------

    def rank(self) -> LongWork:
        """Long work that ranks the effects and tests the residual, unless both are done."""
        session = self._session
        stale = self._user_effects.stale(self._state.name, session.user_effects)
        if session.calibration is None or (session.screening is not None and not stale):
            self.show()
            yield from self._test_residual()
            self._look_ahead()
            return
        self._panels.say("Ranking what could be missing …")
        yield
        try:
            ranked = None if stale else (yield from self._judged_ahead(session))
            if ranked is None:
                ranked = yield from self._beside(lambda: self._ranked(session), session)
        except CalibError as error:  # nothing that the user asked for: the tab says it
            self._panels.say(str(error))
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
        self._look_ahead()

    def _look_ahead(self) -> None:
        """Begin to judge the model that the advice leads to, so that its verdict is there once it is asked for."""
        session = self._session
        move = None if session.advice is None else session.advice.move
        if not isinstance(move, AddEffect) or len(session.dataset.poses) > AHEAD_POSES:
            return
        if self._ahead is None or self._ahead.calibration is not move.calibration:
            if self._ahead is not None:
                self._ahead.judged.cancel()
            self._ahead = _Ahead(move.calibration, self._ahead_work.submit(lambda: sessions.after_advised(session)))

    def _judged_ahead(self, session: Session) -> Generator[None, None, Session | None]:
        """Long work that ends with a session judged as it was ahead; None where it was not, or is no longer shown."""
        ahead, self._ahead = self._ahead, None
        if ahead is None or ahead.calibration is not session.calibration:
            return None
        try:
            known = yield from until_done(ahead.judged, lambda: self._session.calibration is session.calibration)
        except (CalibError, CancelledError):  # an error is told where the model itself is judged
            return None
        return None if known is None else sessions.judged_as(session, known)

    def _test_residual(self) -> LongWork:
        """Long work that tests the residual, unless done; the ranking is displayed meanwhile."""
        session = self._session
        if session.screening is None or session.residual_tests is not None:
            return
        yield
        tested = yield from self._beside(lambda: sessions.with_residual_tests(session), session)
        if tested is not None and self._session.screening is session.screening:
            self._state.keep(replace(self._session, **tests_of(tested)))
            self._panels.missing_effects.judge(self._session)
            self._panels.missing_effects.update_choice(self._state.now)
            self._panels.plan.offer(aims_of(self._session))
            self._panels.residuals.update(self._state.now)

    def _ranked(self, session: Session) -> Session:
        session = self._with_user_effects(session)
        return session if session.screening is not None else sessions.with_ranking(session)

    def _with_user_effects(self, session: Session) -> Session:
        """Session with the user's own effects read anew from their file."""
        effects = self._user_effects.families(self._state.name, session.measured)
        return session if effects is session.user_effects else sessions.with_user_effects(session, effects)

    # ---- the model on show ------------------------------------------------------------------------------------------

    def _forget_steps(self) -> None:
        """Clear undo and redo of the dataset on show."""
        self._undo.pop(self._state.name, None)

    def show(self) -> None:
        """Redraw the tabs "What is missing" and "Where it fails"."""
        steps = self.steps
        self._panels.missing_effects.update(
            self._state.now, undo=len(steps.past), redo=len(steps.future), own=self._user_effects.problem
        )
        self._panels.residuals.update(self._state.now)
        self._panels.plan.offer(aims_of(self._session))
        self._panels.headline.doing(words="")

    def _change(self, session: Session) -> None:
        """Show a changed model, and keep the previous model for undo."""
        self.steps.changed(self._session)
        self._replace(session)

    def _replace(self, session: Session) -> None:
        """Show another model of the same dataset everywhere."""
        before = self._session
        self._state.keep(sessions.with_versions(session, before))
        self._redraw(before.calibration is None)
        if before.uncounted != session.uncounted:
            self._recount(before.uncounted ^ session.uncounted)
        self._panels.show_model(self._state.now)
        self.show()

    def _beside(self, compute: Callable[[], T], started: Session) -> Generator[None, None, T | None]:
        """Long work that ends with the result of `compute`; None where the model was changed in the meantime."""

        def wanted() -> bool:
            now = self._session
            return now.calibration is started.calibration and now.dataset is started.dataset

        return self._background.run(compute, wanted)
