"""Tab Take away: files that can be downloaded, each for the browser that requests it."""

from __future__ import annotations

from functools import partial

import viser

from inspector.markup.parts import elements
from inspector.panels.base import Actions

NOTE = (
    "Each is made when you press and goes to your browser's downloads; nothing is written where the server runs. "
    "The command that does the same is given with each."
)
SCREENSHOT = "Screenshot (PNG)"
ITEMS: dict[str, tuple[str, str]] = {  # what the button is called: icon, what the file holds
    "Report (HTML)": (
        viser.Icon.FILE_DESCRIPTION,
        "One page to send to someone: verdict, figures that can be hovered, parameters, method, versions. "
        "Opens without a network. Command: inspector report",
    ),
    "Calibrated robot (TOML)": (
        viser.Icon.ROBOT,
        "The table that is best without effects as robot.toml, unless the test poses got worse; its first line tells "
        "its own error where the model has effects. "
        "Command: inspector calibrate --out",
    ),
    "Full model (JSON)": (
        viser.Icon.BRACES,
        "Table, effects, scanner frames, covariance and errors as model.json, for correct --model, validate --model "
        "and calib.load_model. Command: inspector calibrate --model-out",
    ),
    "Session (JSON)": (
        viser.Icon.DEVICE_FLOPPY,
        "The dataset's name and content, the steps of the model, what is on show. Open it again with "
        "inspector serve --session; made by the command inspector calibrate --session",
    ),
    "Residuals (CSV)": (
        viser.Icon.TABLE,
        "A row a pose: role, error, predicted and measured point in mm, every input. "
        "Command: inspector calibrate --residuals",
    ),
    "Measured points (CSV)": (
        viser.Icon.TABLE,
        "In the form of points.csv: what was measured, in mm in the scanner's frame with covariance. "
        "Command: inspector corners --out",
    ),
    "Redundancy (CSV)": (
        viser.Icon.TABLE,
        "Pearson's r of all pairs of parameters. Command: inspector redundancy --out",
    ),
    "3D scene (GLB)": (
        viser.Icon.CUBE,
        "For Blender and the like, in metres: the arm at this pose, measured and predicted points, residuals as "
        "long as on show. Command: inspector calibrate --scene",
    ),
    SCREENSHOT: (viser.Icon.CAMERA, "Your 3D view as it is now, as large as your window."),
}


class DownloadsPanel:
    """A button for each file, with a description of it."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        gui.add_html(elements.note(NOTE))
        self._doing = gui.add_html("")
        for name, (icon, holds) in ITEMS.items():
            button = gui.add_button(name, icon=icon, hint=holds)  # type: ignore[arg-type]
            button.on_click(partial(_pressed, actions, name))
            gui.add_html(elements.note(holds))

    def say(self, words: str) -> None:
        """Show which file is being made; "" clears the line."""
        self._doing.content = elements.alert(words, colour="#56B4E9") if words else ""


def _pressed(actions: Actions, what: str, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
    if event.client is not None:  # pressed by a page, not by this program
        actions.take(what, event.client)
