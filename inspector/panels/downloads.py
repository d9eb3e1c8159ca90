"""Tab Take away: files that can be downloaded, each for the browser that asks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import viser

from calib.calibration.plausibility import implausibility_reason
from calib.errors import CalibError
from calib.models.exported_table import exported_table
from calib.present.diagnosis.actions import what_to_do
from calib.present.fit.errors import table_alone
from calib.rendering.blocks import Bullets, Section, Verdict
from calib.rendering.html import panel
from calib.robot_formats.calibrated_file import kept_template
from inspector.markup.parts import elements
from inspector.markup.parts.palette import BAD, DOUBT
from inspector.panels.base import SECONDARY, Actions, FollowsModel
from inspector.plugins import Download, TargetFile, contributions
from inspector.session.view import View

NOTE = "Each file is made when you press and goes to your browser's downloads; the server keeps nothing."
NOT_YET = "Nothing to take away yet: the model is fitted when the search has ended."
REPORT, OWN_FILE, TABLE, MODEL = (
    "Report (HTML)", "Your robot's file, calibrated", "Calibrated robot (TOML)", "Full model (JSON)",
)  # fmt: skip
TO_DO = "What to do now"
SESSION = "Session (JSON)"
_CORRECTION = "calib.present.plans.correction"
RESIDUALS, POINTS, REDUNDANCY = "Residuals (CSV)", "Measured points (CSV)", "Redundancy (CSV)"


@dataclass(frozen=True)
class Item:
    """A file that can be downloaded."""

    icon: viser.IconName
    holds: str  # a sentence
    command: str  # the same at the terminal


GROUPS: dict[str, dict[str, Item]] = {
    "Robot": {
        OWN_FILE: Item(
            viser.Icon.FILE_CODE,
            "The URDF or YAML that the robot was imported from with calibrated origins, all else byte for byte.",
            "inspector calibrate --urdf-out",
        ),
        TABLE: Item(
            viser.Icon.ROBOT,
            "The table for a controller: the calibrated links that are best without effects, as robot.toml.",
            "inspector calibrate --out",
        ),
        MODEL: Item(
            viser.Icon.BRACES,
            "Table, effects, frames and covariance, for the commands correct and validate and for calib.load_model.",
            "inspector calibrate --model-out",
        ),
    },
    "Report": {
        REPORT: Item(
            viser.Icon.FILE_DESCRIPTION,
            "One page for whoever owns the arm: verdict, figures, parameters, method. It opens without a network "
            "and prints on A4.",
            "inspector report",
        ),
    },
    "Data": {
        RESIDUALS: Item(
            viser.Icon.TABLE,
            "A row a pose: role, error, predicted and measured point in mm, every input.",
            "inspector calibrate --residuals",
        ),
        POINTS: Item(
            viser.Icon.TABLE,
            "The measured points as points.csv, mm in the instrument's frame, with covariance where it is known.",
            "inspector corners --out",
        ),
        REDUNDANCY: Item(
            viser.Icon.TABLE, "Pearson's r of all pairs of parameters.", "inspector redundancy --out"
        ),
    },
    "Session": {
        SESSION: Item(
            viser.Icon.DEVICE_FLOPPY,
            "The steps of the model and what is on show, to go on later: inspector serve --session FILE.",
            "inspector calibrate --session",
        )
    },
}  # fmt: skip
CONTRIBUTED = {brought.name: brought for brought in contributions(Download)}
for _brought in CONTRIBUTED.values():
    GROUPS.setdefault(_brought.group, {})[_brought.name] = Item(
        viser.IconName(_brought.icon), _brought.holds, _brought.command
    )
CORRECTED = {
    suffix: brought
    for brought in (
        TargetFile((".csv",), f"{_CORRECTION}:read_table", f"{_CORRECTION}:correct_table"),
        *contributions(TargetFile),
    )
    for suffix in brought.suffixes
}
"""How files of targets are corrected, by suffix."""
ITEMS = {name: item for group in GROUPS.values() for name, item in group.items()}
PRIMARY = REPORT
TARGETS = "Correct my targets …"
TARGETS_HINT = (
    f"A table of joint targets with columns as poses.csv has them ({', '.join(sorted(CORRECTED))}): it comes back "
    "corrected by the model on show, as the command correct does it; what is not reached is told."
)


class DownloadsPanel(FollowsModel):
    """Download buttons in groups, with notes on what each file is for and on the use of a robot's file."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self._to_do = gui.add_html(elements.note(NOT_YET))
        gui.add_html(elements.note(NOTE))
        self._doing = gui.add_html("")
        self._buttons: dict[str, viser.GuiButtonHandle] = {}
        self._notes: dict[str, viser.GuiHtmlHandle] = {}
        for group, items in GROUPS.items():
            gui.add_html(elements.heading(group))
            for name, item in items.items():
                button = gui.add_button(
                    name,
                    icon=item.icon,
                    hint=item.command or None,
                    visible=name != OWN_FILE,
                    color=None if name == PRIMARY else SECONDARY,
                )
                button.on_click(partial(_pressed, actions, name))
                self._buttons[name], self._notes[name] = button, gui.add_html(elements.note(item.holds))
            if group == "Robot":
                self.targets = gui.add_upload_button(
                    TARGETS, icon=viser.Icon.TARGET, color=SECONDARY, hint=TARGETS_HINT, visible=False
                )
                self._corrected = gui.add_html("")

    def update(self, view: View) -> None:
        """Show the downloads that this dataset allows, and what to know before a robot's file is used."""
        own = kept_template(view.session.dataset.folder) is not None
        self.offer(OWN_FILE, own)
        self._to_do.content = to_do_html(view)
        self.tell_corrected("")

    def offer(self, name: str, offered: bool) -> None:
        """Show or hide the button and the note of one of `ITEMS`."""
        self._buttons[name].visible = self._notes[name].visible = offered

    def tell_corrected(self, content: str) -> None:
        """Show what came of targets that a page brought."""
        self._corrected.content = content

    def say(self, words: str) -> None:
        """Show what is being made; "" clears it."""
        self._doing.content = elements.alert(words, colour="#56B4E9")


def to_do_html(view: View) -> str:
    """HTML on what to do with the model: what the table alone reaches, what it leaves, and reasons against its use."""
    session = view.session
    if session.calibration is None:
        return elements.note(NOT_YET)
    table = exported_table(session.calibration, session.links_alone)
    try:
        table.require_improvement()
    except CalibError as error:
        return elements.alert(str(error), colour=BAD)
    doubt = implausibility_reason(session.calibration)
    diagnosis, told = session.diagnosis, session.headline
    outliers = () if diagnosis is None else diagnosis.outlier_poses
    actions = [] if told is None else what_to_do(told, table, None, diagnosis, session.next_poses, outliers)
    return panel([Section(TO_DO, [Verdict(doubt, DOUBT), Bullets(actions), *table_alone(table)])])


def _pressed(actions: Actions, what: str, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
    if event.client is not None:  # pressed by a page, not by this program
        actions.take(what, event.client)
