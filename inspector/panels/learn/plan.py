"""Tab Plan: poses to measure next, their predicted gain, and their files."""

from __future__ import annotations

from functools import partial

import viser

from calib.planning.purpose import CALIBRATION, purposes
from calib.present.plans.plans import assumptions, plan_head, poses_table
from calib.rendering import html, numbers
from calib.rendering.blocks import Bullets, Section
from inspector.figures.plots import error_by_count
from inspector.markup.parts import elements
from inspector.markup.parts.palette import FAILED
from inspector.panels.base import Actions, hidden_plot, offer, put
from inspector.panels.input_checks import clamped
from inspector.plugins import PlanFile, contributions
from inspector.session.planned import Planned

NOTE = (
    "The next poses to measure, of those that instrument and cell allow. Choose what they are for and press the "
    "button; a click on a row shows the arm there. Command: inspector plan"
)
NOT_YET = "Nothing to plan for yet: poses are planned from a fit."
STALE = "The model has changed since; plan again."
MAKE = "Plan the poses"
NONE = "–"
TABLE = PlanFile("Download", "poses.csv", "planned_poses.csv", "inspector.export.plan_files:files_of_plan")
MOST = 60


class PlanPanel:
    """Widgets of the tab Plan: purpose and number of poses, the plan, its poses and files."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        gui.add_html(elements.note(NOTE))
        self.aim = gui.add_dropdown("For", (NONE,), hint="the purpose of the poses")
        self.count = gui.add_number("Poses", 5, min=1, max=MOST, step=1, hint="how many to measure")
        self.payload = gui.add_number(
            "Payload, kg", 0.0, min=0.0, max=1000.0, step=0.5, hint="a known mass that some poses may carry; 0: none"
        )
        self.make = gui.add_button(MAKE, icon=viser.Icon.ROUTE)
        self._doing = gui.add_html("")
        self._promise = gui.add_html("")
        self._plot = hidden_plot(gui, 0.6, "predicted error")
        self._poses = gui.add_html("")
        rows: dict[str, list[PlanFile]] = {}
        for file in plan_files():
            rows.setdefault(file.group, []).append(file)
        self.files = [
            gui.add_button_group(group, [file.name for file in row], visible=False, hint=row[-1].hint or None)
            for group, row in rows.items()
        ]
        self._notes = gui.add_html("")
        self._words: dict[str, str] = {}  # by what the dropdown shows, the word of --for
        self.make.on_click(lambda _: actions.plan())
        for row in self.files:
            row.on_click(partial(_pressed, actions))

    @property
    def asked(self) -> tuple[str, int, float | None]:
        """Chosen purpose (a word of --for), number of poses, and payload."""
        aim = self._words.get(str(self.aim.value), CALIBRATION)
        payload_kg = clamped(self.payload.value, 0.0, 1000.0, 0.0)
        return aim, int(clamped(self.count.value, 1, MOST, 5)), payload_kg or None

    def offer(self, aims: tuple[str, ...]) -> None:
        """Update the purposes that can be planned for; the choice is kept if it is still listed."""
        known = purposes()
        self._words = {known[aim].words if aim in known else f"the size of {aim}": aim for aim in aims}
        offer(self.aim, tuple(self._words) or (NONE,))
        self.make.disabled = not aims

    def choose(self, aim: str) -> None:
        """Choose a purpose, if it is listed."""
        words = next((words for words, name in self._words.items() if name == aim), None)
        if words is not None:
            put(self.aim, words)

    def say(self, words: str, *, bad: bool = False) -> None:
        """Show the current task, or why it is impossible; "" clears the line."""
        self._doing.content = elements.alert(words, colour=FAILED if bad else "#56B4E9")

    def clear(self, words: str = "") -> None:
        """Remove the plan from the tab."""
        self.say("")
        self._promise.content = elements.note(words)
        self._poses.content = self._notes.content = ""
        self._plot.visible = False
        self._show_files(False)

    def _show_files(self, shown: bool) -> None:
        for row in self.files:
            row.visible = shown

    def update(self, planned: Planned) -> None:
        """Show a plan for the model on show."""
        plan = planned.plan
        self.say("")
        carried_kg = plan.poses.payload_kg
        if carried_kg is not None and float(carried_kg.max(initial=0.0)) > 0.0:
            put(self.payload, float(carried_kg.max()))  # the box says what the rows say
        self._promise.content = html.panel(plan_head(plan))
        self._plot.figure = error_by_count(plan)
        self._plot.visible = True
        self._show_files(True)
        self._poses.content = html.panel([poses_table(plan, compact=True, mark=planned.pose)])
        notes = assumptions(plan)
        notes += _unfit(plan.start.dataset.robot.is_revolute.tolist())
        self._notes.content = html.panel([Section("What was assumed", [Bullets(notes)])])


def plan_files() -> tuple[PlanFile, ...]:
    """Files of a plan that can be taken: the table of poses, and what plug-ins write."""
    return (TABLE, *contributions(PlanFile))


def _unfit(is_revolute: list[bool]) -> list[str]:
    """Note on the files that cannot hold an arm, with those that can; none where all can."""
    unfit = [file for file in plan_files() if file.turning_joints and is_revolute != [True] * file.turning_joints]
    if not unfit:
        return []
    names = numbers.listing([file.name for file in unfit])
    others = " or ".join(file.name for file in plan_files() if file not in unfit)
    return [f"{names} take {unfit[0].turning_joints} turning joints; for this arm take {others}"]


def _pressed(actions: Actions, event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
    if event.client is not None:  # pressed by a page, not by this program
        actions.take_plan(str(event.target.value), event.client)
