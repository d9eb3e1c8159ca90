"""Selection of a joint and of a step of the model. Runs on the worker's thread only."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib.array_types import Array, BoolArray
from inspector.app.controllers.stage import ARM, SceneController
from inspector.app.page.page_state import PageState
from inspector.app.page.tabs import Panels
from inspector.session.view import corner_of

MODEL_VIEWS = (ARM, "All corners")  # where the model's errors are seen


class Selection:
    """Controller that selects a joint everywhere on the page, and shows the model as it was after a step."""

    def __init__(self, state: PageState, panels: Panels, stage: SceneController) -> None:
        self._state, self._panels, self._stage = state, panels, stage

    def joint(self, number: int | None) -> None:
        """Select a joint, counted from 1; the selected one again, or None, deselects."""
        view = self._state.now
        joint = None if number is None or number - 1 == view.joint else number - 1
        if joint == view.joint or (joint is not None and not 0 <= joint < view.session.dataset.robot.n_joints):
            return
        self._state.change(joint=joint)
        view = self._state.now
        self._stage.comparison.draw()
        self._panels.review.update(view)
        self._panels.residuals.choose_joint(view)

    def box(self, is_in_box: Callable[[Array], BoolArray] | None) -> None:
        """Select the poses whose measured points lie in a box on the screen; None clears the box."""
        view = self._state.now
        poses = view.session.dataset.poses
        boxed: tuple[int, ...] = ()
        if is_in_box is not None:
            here = [i for i in range(len(poses)) if poses.setup[i] == poses.setup[view.pose]]
            found = [(i, point[0]) for i in here if (point := corner_of(view, i)) is not None]
            inside = is_in_box(np.array([place for _, place in found]).reshape(-1, 3))
            boxed = tuple(i for (i, _), is_in in zip(found, inside, strict=True) if is_in)
        if boxed != view.boxed:
            self._state.change(boxed=boxed)
            self._stage.comparison.draw()
        self._panels.review.show_box(self._state.now)

    def step(self, number: int) -> None:
        """Show the arm and errors of the nominal robot (0), or of the model after a step, counted from 1.

        In 3D, too, where something else is looked at.
        """
        view = self._state.now.at_step(number)
        self._state.change(chosen=view.chosen, compared=view.compared, step=view.step)
        self._stage.comparison.draw()
        self._show_version()
        if self._stage.view_name not in MODEL_VIEWS:
            self._stage.follow(ARM)

    def version(self, name: str) -> None:
        """Show the arm, errors and arrows of a version of the model."""
        self._stage.comparison.choose(name)
        self._show_version()

    def _show_version(self) -> None:
        """Redraw plots and tables for the version on show."""
        self._panels.show_model(self._state.now)
