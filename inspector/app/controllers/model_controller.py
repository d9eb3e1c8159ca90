"""All changes of the model: fits, effects added and removed, undo and redo. Runs on the worker's thread only.

A fit is quick and done at once. Ranking the effects and the whole diagnosis take seconds: they are done in the
background, while the worker goes on with what else is asked for. Their result counts only if the model is still the
one they began with.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from calib.errors import CalibError
from inspector.app.controllers.face_labelling import FaceLabelling
from inspector.app.controllers.ranking import Ranking
from inspector.app.controllers.shown_model import ShownModel
from inspector.app.page.page_state import PageState
from inspector.app.page.tabs import Panels
from inspector.server.worker import LongWork
from inspector.session import transitions as sessions
from inspector.session.reopening import reopened
from inspector.session.session import Session
from inspector.session.session_file import Saved, Shown
from inspector.session.transitions import with_pose_taken_in, with_poses_left_out
from inspector.session.undo import Undo
from inspector.session.user_effects import UserEffects

POSITION = "position"  # what any measured points can be fitted by


class Stopped(Exception):
    """Exception inside background work whose result is no longer needed."""


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
        self._state, self._panels, self._draw_as = state, panels, draw_as
        self._shown = ShownModel(state, panels, user_effects, redraw=redraw, recount=recount)
        self._ranking = Ranking(self._shown)
        self.saved = dict(saved)  # sessions to open again once their dataset is there, by its name
        self._labelling = FaceLabelling(state, panels.fit)

    def close(self) -> None:
        """End the threads."""
        self._shown.close()
        self._ranking.close()
        self._labelling.close()

    @property
    def steps(self) -> Undo:
        """Undo and redo of the model on show."""
        return self._shown.steps

    @property
    def _session(self) -> Session:
        return self._state.session

    def show(self) -> None:
        """Redraw the tabs "What is missing" and "Where it fails"."""
        self._shown.show()

    def rank(self) -> LongWork:
        """Long work that ranks the effects and tests the residual, unless both are done."""
        return self._ranking.rank()

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
            yield from self._labelling.try_it()
            raise
        yield from self._labelling.try_it()

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
            again = yield from self._shown.beside(
                lambda: reopened(self._ranking.with_user_effects(session), saved), session
            )
        except CalibError:
            if self._session.calibration is None:
                yield from self._first_fit(residual)
            raise
        if again is not None and again[0].calibration is not None:
            labels = again[0].face_labels or self._session.face_labels
            self._shown.change(replace(sessions.seen_since(again[0], self._session), face_labels=labels))
            self._shown.reopen_steps(Undo.of(saved))
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
                yield from self._labelling.require()
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
            self._shown.forget_steps()
        self._shown.change(session)
        yield from self.rank()

    # ---- poses ------------------------------------------------------------------------------------------------------

    def leave_out(self, pose_id: str, out: bool) -> LongWork:
        """Long work that leaves a pose out, or uses it again; skipped where nothing would change."""
        if out:
            yield from self.leave_out_poses((pose_id,))
            return
        if pose_id in self._session.uncounted:
            self._with_other_poses(with_pose_taken_in(self._session, pose_id))
            yield
        yield from self.rank()

    def leave_out_poses(self, pose_ids: Sequence[str]) -> LongWork:
        """Long work that leaves several poses out as one change, those that the dataset has and that are in use."""
        session = self._session
        ids = [i for i in pose_ids if i in session.dataset.poses.ids and i not in session.uncounted]
        if ids:
            self._with_other_poses(with_poses_left_out(session, *ids))
            yield
        yield from self.rank()

    def new_setup(self, pose_id: str) -> LongWork:
        """Long work that gives the instrument another place from a pose on, and fits the links anew."""
        if pose_id not in self._session.dataset.new_setups:
            session = sessions.with_new_setup(self._session, pose_id)
            self._shown.forget_steps()  # earlier models are of an instrument that stood still
            self._shown.replace(session)
            yield
        yield from self.rank()

    def _with_other_poses(self, session: Session) -> None:
        """Show a session in which other poses count: a change of the model where there is one."""
        (self._shown.replace if self._session.calibration is None else self._shown.change)(session)

    # ---- effects ----------------------------------------------------------------------------------------------------

    def add(self, name: str) -> LongWork:
        """Long work that adds an effect to the model, unless the model has it already."""
        if any(added.name == name for added in self._session.effects):
            yield from self.rank()
            return
        if self._session.screening is None:
            yield from self.rank()
        self._shown.change(sessions.with_effect(self._session, name))
        yield
        yield from self.rank()

    def follow(self) -> LongWork:
        """Long work that makes the advised change of the model, where there is one."""
        if self._session.advice is not None:
            self._shown.change(sessions.with_advice_followed(self._session))
            self._choose_last()
            yield
        yield from self.rank()

    def _choose_last(self) -> None:
        """Select the effect added last, in the tables of the tab."""
        if self._session.effects:
            self._panels.missing_effects.choose(self._session.effects[-1].name)
            self.show()

    def remove(self, name: str) -> LongWork:
        """Long work that removes an effect from the model, if the model has it."""
        if all(added.name != name for added in self._session.effects):
            yield from self.rank()
            return
        self._shown.change(sessions.without_effect(self._session, name))
        yield
        yield from self.rank()

    def move(self, by: int) -> LongWork:
        """Long work that undoes (for a negative number) or redoes a number of changes of the model."""
        session = self._shown.steps.move(self._session, by)
        if session is not self._session:
            self._shown.replace(sessions.seen_since(session, self._session))
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
            work = self._shown.beside(
                lambda: sessions.with_diagnosis(self._ranking.with_user_effects(session), on_step), session
            )
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
                self._shown.change(sessions.seen_since(found, self._session))
                self._choose_last()
        finally:
            stop.set()
            self._finding(False)
            self.show()
        yield from self.rank()  # where another change came in between
