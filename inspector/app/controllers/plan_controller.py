"""Plans of poses, made in the background and displayed. Runs on the worker's thread only."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import viser

from calib.errors import CalibError
from calib.planning.purpose import SPLIT
from calib.plugins import load
from inspector.app.page.page_state import PageState
from inspector.panels.learn.plan import NOT_YET, STALE, PlanPanel, plan_files
from inspector.scene.draw_plan import PlanDrawing
from inspector.scene.scene_view import SceneView
from inspector.server.background import Background
from inspector.server.worker import LongWork
from inspector.session.planned import Planned, aims_of, planned_for


class PlanController:
    """Holder of the last plan of each dataset, which it displays."""

    def __init__(self, state: PageState, scene: SceneView, panel: PlanPanel) -> None:
        self._state, self._panel = state, panel
        self._drawing = PlanDrawing(scene)
        self._plans: dict[str, Planned] = {}  # by dataset
        self._background = Background("plan")
        self._opened = False  # whether the plan is drawn: not over other tabs

    def close(self) -> None:
        """End the thread."""
        self._background.close()

    @property
    def _planned(self) -> Planned | None:
        """The plan for the model on show; None where there is none."""
        known = self._plans.get(self._state.name)
        return known if known is not None and known.is_of(self._state.session) else None

    def show(self) -> None:
        """Show the purposes that can be planned for, and the plan of the model on show."""
        view, planned = self._state.now, self._planned
        self._panel.offer(aims_of(view.session))
        self._draw()
        if planned is not None:
            self._panel.update(planned)
        elif view.session.calibration is None:
            self._panel.clear(NOT_YET)
        else:
            self._panel.clear(STALE if self._state.name in self._plans else "")

    def opened(self, opened: bool) -> None:
        """Draw the plan while its tab is open."""
        self._opened = opened
        self._draw()

    def _draw(self) -> None:
        self._drawing.draw(self._state.now, self._planned if self._opened else None)

    def make(self) -> LongWork:
        """Long work that plans poses as chosen in the tab, and draws them."""
        self._opened = True
        name, session = self._state.name, self._state.session
        aim, count, payload_kg = self._panel.asked
        self._panel.say("Planning …")
        try:
            made = yield from self._background.run(
                lambda: planned_for(session, aim, count, payload_kg),
                lambda: self._state.name == name and self._state.session.calibration is session.calibration,
            )
        except CalibError as error:
            self._panel.say(str(error), bad=True)
            return
        self._panel.say("")
        if made is not None:
            self._plans[name] = made
            self.show()

    def settle(self) -> LongWork:
        """Long work that plans the poses that discriminate between the effects left open."""
        self._panel.offer(aims_of(self._state.session))
        self._panel.choose(SPLIT)
        yield from self.make()

    def select(self, pose: int | None) -> None:
        """Select one of the planned poses; the selected one again deselects."""
        planned = self._planned
        if planned is not None and pose is not None and pose < len(planned.plan.poses):
            again = pose == planned.pose
            self._plans[self._state.name] = replace(planned, pose=None if again else pose)
            self.show()

    def take(self, what: str, client: viser.ClientHandle) -> None:
        """Send a file of the plan to the page. Raises CalibError where the file's format cannot describe the arm."""
        planned = self._planned
        if planned is None:
            return
        file = next(file for file in plan_files() if file.name == what)
        for path, text in load(file.writer)(Path(file.file), planned.plan).items():
            client.send_file_download(path.name, text.encode(), save_immediately=True)
