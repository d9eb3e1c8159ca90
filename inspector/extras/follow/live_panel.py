"""Tab Live: the dataset's folder followed while it is measured."""

from __future__ import annotations

from collections.abc import Callable

import viser

from calib.extras.follow.campaign import Campaign
from calib.extras.follow.present.campaign import campaign_head, latest_first
from calib.rendering import html
from inspector.markup.parts import elements
from inspector.panels.base import SECONDARY, Actions, on_page

NOTE = (
    "While you measure: each pose that arrives in this dataset's folder is judged at once, the error of the fit so far "
    "is predicted, and the next pose is named."
)
FOLLOW = "Follow this folder"
FOLDER = "The folder of {}: what arrives in its points.csv or scans is judged."
SHOW = "Show what has arrived"
WAITING = "Nothing has arrived yet."


class LivePanel:
    """Switch to follow the folder, the campaign so far with its predicted error, and the poses as they were judged."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        gui.add_html(elements.note(NOTE))
        self.on = gui.add_checkbox(FOLLOW, False, hint="look for new measurements several times a second")
        self._state = gui.add_html("")
        self._show = gui.add_button(
            SHOW, color=SECONDARY, hint="read the dataset again, for the 3D view and all other tabs", visible=False
        )
        self._poses = gui.add_html("")
        self.on_switched: Callable[[bool], None] = lambda on: None  # told whether to follow the folder
        on_page(self.on, lambda _: self.on_switched(bool(self.on.value)))
        self._show.on_click(lambda _: actions.open_again())

    def clear(self, dataset: str) -> None:
        """Name the folder, and show nothing of a campaign, as for a dataset that is not followed."""
        self._state.content, self._poses.content = elements.note(FOLDER.format(dataset)), ""
        self._show.visible = False

    def say(self, words: str, *, bad: bool = False) -> None:
        """Show what is wrong with the folder, or that nothing has arrived."""
        self._state.content = elements.alert(words) if bad else elements.note(words)

    def update(self, campaign: Campaign) -> None:
        """Show a campaign."""
        if not campaign.judged:
            self.say(WAITING)
            return
        self._state.content = html.panel(campaign_head(campaign))
        self._poses.content = html.panel([latest_first(campaign)])
        self._show.visible = True
