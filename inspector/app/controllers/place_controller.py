"""A place that the user tries with the tool, and the error predicted there. Runs on the worker's thread only."""

from __future__ import annotations

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.compensation.tool_place import ToolPlace, tool_frame, tool_place
from inspector.app.controllers.stage import ARM, Stage
from inspector.app.page.page_state import PageState
from inspector.panels.review import ReviewPanel
from inspector.scene.draw_place import Moved, PlaceDrawing


class PlaceController:
    """Controller of the tool that is dragged to a place of the user's choice.

    on_moved: told, on any thread, of the frame to which the control is dragged.
    """

    def __init__(self, state: PageState, stage: Stage, panel: ReviewPanel, on_moved: Moved) -> None:
        self._state, self._stage, self._panel = state, stage, panel
        self._drawing = PlaceDrawing(stage.scene, on_moved)
        self._on = False
        self._of: tuple[str, int] | None = None  # dataset and pose from which the tool was taken
        self._goal: Array | None = None  # scanner_T_tool (4, 4)
        self._joints: Array | None = None  # of the last place that was reached
        self.place: ToolPlace | None = None  # on show

    def switch(self, on: bool) -> None:
        """Begin at the selected pose, or end."""
        self._on, self._of = on, None
        if on and self._stage.view_name != ARM:
            self._stage.choose_view(ARM)
        self.show()

    def move(self, scanner_T_tool: Array, released: bool) -> None:
        """Show the error at a frame of the tool (4, 4); other postures are tried once it is released."""
        if self._on and self._goal is not None:
            self._goal = scanner_T_tool
            self._predict(everywhere=released)

    def show(self) -> None:
        """Show the tried place for the model on show; another pose or dataset begins anew at its tool."""
        view = self._state.view
        calibration = self._calibration()
        self._panel.offer_place(calibration is not None, on=self._on)
        if view is None or calibration is None or not self._on:
            self.place = self._goal = self._joints = self._of = None
            self._drawing.clear()
            self._panel.show_place(None)
            return
        if self._of != (self._state.name, view.pose):
            self._drawing.clear()
            self._of = (self._state.name, view.pose)
            here = calibration.dataset.poses.select(np.array([view.pose]))
            self._goal = self._placed(calibration) @ tool_frame(calibration, here)[0]
            self._joints = None
        self._predict(everywhere=True)

    def _calibration(self) -> Calibration | None:
        """Fit of the model on show, where its arm stands in a known frame at the selected pose."""
        view = self._state.view
        calibration = None if view is None else view.calibration
        if view is None or calibration is None or calibration.model.robot.carries_scanner:
            return None
        return calibration if str(view.session.dataset.poses.setup[view.pose]) in calibration.trained_setups else None

    def _placed(self, calibration: Calibration) -> Array:
        """Frame scanner_T_base (4, 4) of the setup of the selected pose."""
        view = self._state.now
        return calibration.after.scanner_T_base[str(view.session.dataset.poses.setup[view.pose])]

    def _predict(self, *, everywhere: bool) -> None:
        calibration, view = self._calibration(), self._state.now
        if calibration is None or self._goal is None:
            return
        placed = self._placed(calibration)
        base_T_tool = frames.invert(placed) @ self._goal
        place = tool_place(calibration, base_T_tool, view.pose, self._joints, everywhere=everywhere)
        self._joints = place.q if place.reached else self._joints
        self.place = place
        self._drawing.draw(place, self._goal, placed, view.arrows)
        self._panel.show_place(place)
