"""What widgets ask for about the model: each call returns at once, the worker does the work."""

from __future__ import annotations

import threading

import viser

from inspector.app.controllers.dataset_controller import DatasetController
from inspector.app.controllers.model_controller import ModelController
from inspector.app.controllers.others.side_by_side_controller import SideBySideController
from inspector.app.controllers.others.watch_controller import WatchController
from inspector.app.controllers.plan_controller import PlanController
from inspector.app.page.page_state import PageState
from inspector.app.page.tabs import Panels
from inspector.server.worker import LongWork, Worker
from inspector.session.view import RESIDUALS


class ModelRequests:
    """The part of `App` about fits, effects and what is beside them."""

    state: PageState
    panels: Panels
    worker: Worker
    dataset: DatasetController
    model: ModelController
    side_by_side: SideBySideController
    planning: PlanController
    watching: WatchController

    def __init__(self) -> None:
        self._asking = threading.Lock()
        self._moves = 0  # changes of the model to go back (below 0) or forward

    def failure(self) -> None:
        """Plot the residual against the input that is chosen now."""
        self.worker.submit("failure", lambda: self.panels.residuals.update(self.state.now))

    def beside(self) -> None:
        """Show what is chosen now beside the calibration on show, and against it."""
        if self.state.view is not None:
            self.worker.submit("beside", self.side_by_side.show)
            self.watch()

    def watch(self, forget: bool = False) -> None:
        """Hold what is chosen now against the calibration on show; forget: nothing any more."""
        if self.state.view is not None:
            self.worker.submit("watch", lambda: self.watching.show(forget))

    def plan(self) -> None:
        """Plan the poses that are asked for now."""
        if self.state.view is not None:
            self.worker.submit("plan", self.planning.make)

    def settle(self) -> None:
        """Plan the poses that settle what the diagnosis left open."""
        if self.state.view is not None:
            self.worker.submit("plan", self.planning.settle)

    def show_plan(self) -> None:
        """Show what can be planned for the model on show, and its plan."""
        if self.state.view is not None:
            self.worker.submit("show plan", self.planning.show)

    def select_planned(self, pose: int | None) -> None:
        """Look at a pose of the plan, from 0."""
        self.worker.submit("planned", lambda: self.planning.select(pose))

    def take_plan(self, what: str, client: viser.ClientHandle) -> None:
        """Send a file of the plan to a page."""
        self.worker.submit(("take plan", what, client.client_id), lambda: self.planning.take(what, client))

    def redundancy(self, residual: str) -> None:
        """Analyse the parameters for distances or positions."""
        if residual in RESIDUALS:
            self.worker.submit("redundancy", lambda: self.dataset.analyse(residual))

    def correlation(self) -> None:
        """Show the part of the correlation matrix that is chosen now."""
        self.worker.submit("correlation", lambda: self.panels.redundancy.update(self.state.now))

    def calibrate(self, residual: str) -> None:
        """Fit the robot's parameters to distances or positions."""
        if residual in RESIDUALS:
            self.worker.submit("calibrate", lambda: self.model.calibrate(residual))

    def find(self, start: bool) -> None:
        """Run the whole diagnosis; or stop it."""
        if start:
            self.worker.submit("find", lambda: self.model.find())
        else:
            self.worker.cancel("find")

    def effects(self) -> None:
        """Rank again, with the user's own effects as their file has them now."""
        if self.state.view is not None:
            self.worker.submit("effects", lambda: self.model.rank())

    def candidate(self) -> None:
        """Show what is known of the candidate that is chosen now."""
        self.worker.submit("candidate", lambda: self.model.compare())

    def follow(self) -> None:
        """Do what the advice says."""
        self.worker.submit("follow", lambda: self.model.follow())

    def add_effect(self, name: str) -> None:
        """Add an effect to the model; a second press for the same effect adds nothing."""
        self.worker.submit(("add", name), lambda: self.model.add(name))

    def remove_effect(self, name: str) -> None:
        """Take an effect out of the model."""
        self.worker.submit(("remove", name), lambda: self.model.remove(name))

    def leave_out(self, pose_id: str, out: bool) -> None:
        """Leave a pose out of everything that is fitted and told, or take it in again."""
        view = self.state.view
        if view is not None and pose_id in view.session.dataset.poses.ids:
            self.worker.submit(("leave out", pose_id), lambda: self.model.leave_out(pose_id, out))

    def move(self, by: int) -> None:
        """Undo changes of the model, or redo them; each press counts."""
        with self._asking:
            self._moves += by
        self.worker.submit("move", self._move)

    def _move(self) -> LongWork:
        with self._asking:
            by, self._moves = self._moves, 0
        return self.model.move(by)
