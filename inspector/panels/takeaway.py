"""Tab Take away: everything that can be carried off, each for the browser that asks."""

from __future__ import annotations

from functools import partial
from typing import Protocol

import viser

from inspector import tables

NOTE = (
    "Each is made when you press and goes to your browser's downloads; nothing is written where the server runs. "
    "Behind each stands the command that does the same."
)
SCREENSHOT = "Screenshot"
ITEMS: dict[str, tuple[str, str]] = {  # what the button is called: icon, what the file holds
    "Report": (
        viser.Icon.FILE_DESCRIPTION,
        "HTML, one page to send to someone: verdict, figures that can be hovered, parameters, method, versions. "
        "Opens without a network. inspector report",
    ),
    "Calibrated robot": (
        viser.Icon.ROBOT,
        "robot.toml with the fitted table, unless the test poses got worse; effects have no place in it. "
        "inspector calibrate --out",
    ),
    "Session": (
        viser.Icon.DEVICE_FLOPPY,
        "JSON: the dataset's name and content, the steps of the model, what is on show. Open it again with "
        "inspector serve --session; made by inspector calibrate --session",
    ),
    "Residuals": (
        viser.Icon.TABLE,
        "CSV, a row a pose: role, error, predicted and measured point in mm, every input. "
        "inspector calibrate --residuals",
    ),
    "Measured points": (
        viser.Icon.TABLE,
        "CSV in the form of points.csv: corners in mm in the scanner's frame with covariance. inspector corners --out",
    ),
    "Redundancy": (
        viser.Icon.TABLE,
        "CSV: Pearson's r of all pairs of parameters. inspector redundancy --out",
    ),
    "3D scene": (
        viser.Icon.CUBE,
        "GLB for Blender and the like, in metres: the arm at this pose, measured and predicted points, residuals as "
        "long as on show. inspector calibrate --scene",
    ),
    SCREENSHOT: (viser.Icon.CAMERA, "PNG of your 3D view as it is now, as large as your window."),
}


class Takes(Protocol):
    """Who makes the files."""

    def take(self, what: str, client: viser.ClientHandle) -> None:
        """Make one of ITEMS and send it to this page."""
        ...


class TakeAwayPanel:
    """A button for each file, and what it holds."""

    def __init__(self, gui: viser.GuiApi, takes: Takes) -> None:
        gui.add_html(tables.note(NOTE))
        self._doing = gui.add_html("")
        for name, (icon, holds) in ITEMS.items():
            button = gui.add_button(name, icon=icon, hint=holds)  # type: ignore[arg-type]
            button.on_click(partial(_pressed, takes, name))
            gui.add_html(tables.note(holds))

    def say(self, words: str) -> None:
        """What is being made; "" when nothing is."""
        self._doing.content = tables.alert(words, colour="#56B4E9") if words else ""


def _pressed(takes: Takes, what: str, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
    if event.client is not None:  # pressed by a page, not by this program
        takes.take(what, event.client)
