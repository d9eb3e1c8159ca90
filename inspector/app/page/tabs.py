"""The panels of the page: the left one, and the tabs of the right one, in the order of the work.

Each step has its own tabs, so that two short rows hold them all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, get_type_hints

import viser

from inspector.panels.base import Actions, FollowsModel
from inspector.panels.downloads import DownloadsPanel
from inspector.panels.headline import HeadlinePanel
from inspector.panels.learn.missing_effects import MissingEffectsPanel
from inspector.panels.learn.plan import PlanPanel
from inspector.panels.learn.residuals import ResidualsPanel
from inspector.panels.measure.corner import CornerPanel
from inspector.panels.measure.live import LivePanel
from inspector.panels.measure.planes import PlanesPanel
from inspector.panels.measure.scans import ScansPanel
from inspector.panels.model.compare import ComparePanel
from inspector.panels.model.fit import FitPanel
from inspector.panels.model.redundancy import RedundancyPanel
from inspector.panels.model.side_by_side import SideBySidePanel
from inspector.panels.model.watch import WatchPanel
from inspector.panels.review import ReviewPanel
from inspector.panels.your_data import OwnDataButton
from inspector.session.view import View

ICONS = {
    "Measure": viser.Icon.RULER_MEASURE,
    "Model": viser.Icon.ROBOT,
    "Learn": viser.Icon.BULB,
    "Take away": viser.Icon.DOWNLOAD,
}
MODEL_FIRST = ("Learn", "Model", "Measure")
LEFT_WIDTH, RIGHT_WIDTH = 290, 440  # pixels


@dataclass(frozen=True)
class Tab:
    """The tab that contains a panel."""

    step: str  # of the work, to which the tab belongs
    name: str  # that of the step where the step is a single tab
    view: str = ""  # what the 3D view shows once the tab is opened; "" leaves the view as it is


@dataclass(frozen=True)
class Panels:
    """All panels of the page: those in tabs, in the tabs' order, then the others."""

    scans: Annotated[ScansPanel, Tab("Measure", "Scans", view="Scan")]
    planes: Annotated[PlanesPanel, Tab("Measure", "Planes", view="Planes")]
    corner: Annotated[CornerPanel, Tab("Measure", "Corner", view="Corner")]
    live: Annotated[LivePanel, Tab("Measure", "Live")]
    compare: Annotated[ComparePanel, Tab("Model", "Compare", view="Arm")]
    fit: Annotated[FitPanel, Tab("Model", "Fit", view="Arm")]
    redundancy: Annotated[RedundancyPanel, Tab("Model", "Redundancy")]
    side_by_side: Annotated[SideBySidePanel, Tab("Model", "Beside", view="Arm")]
    watch: Annotated[WatchPanel, Tab("Model", "Watch", view="Arm")]
    missing_effects: Annotated[MissingEffectsPanel, Tab("Learn", "What is missing", view="Arm")]
    residuals: Annotated[ResidualsPanel, Tab("Learn", "Where it fails", view="Arm")]
    plan: Annotated[PlanPanel, Tab("Learn", "Plan", view="Arm")]
    downloads: Annotated[DownloadsPanel, Tab("Take away", "Take away")]
    headline: HeadlinePanel
    own_data: OwnDataButton
    review: ReviewPanel

    def show_model(self, view: View) -> None:
        """Refresh every panel that follows the model on show."""
        for name in TABS:
            panel = getattr(self, name)
            if isinstance(panel, FollowsModel):
                panel.update(view)

    def say(self, words: str) -> None:
        """Show what the program is doing with the model, or why that is impossible."""
        self.missing_effects.say(words)
        self.headline.doing(words=words)


_PANELS = {
    name: hint for name, hint in get_type_hints(Panels, include_extras=True).items() if hasattr(hint, "__metadata__")
}
TABS: dict[str, Tab] = {name: hint.__metadata__[0] for name, hint in _PANELS.items()}
"""The tab of each panel, in the order in which the tabs are read."""
STEPS: dict[str, tuple[str, ...]] = {  # the tabs of each step; a step that is a single tab has none inside
    step: tuple(tab.name for tab in TABS.values() if tab.step == step != tab.name)
    for step in dict.fromkeys(tab.step for tab in TABS.values())
}
VIEW_OF_TAB = {tab.name: tab.view for tab in TABS.values() if tab.view}


def add_panels(
    gui: viser.GuiApi, actions: Actions, datasets: tuple[str, ...], *, scans_first: bool, takes_data: bool = False
) -> Panels:
    """Create the page's panels in reading order."""
    left = gui.add_panel()
    with left.add_tab("Review", icon=viser.Icon.LIST_SEARCH):
        own_data = OwnDataButton(gui, takes_data=takes_data)
        review = ReviewPanel(gui, actions, datasets)
    headline = HeadlinePanel(gui)
    tab = add_tabs(gui, scans_first=scans_first)
    in_tabs = {}
    for name, in_tab in TABS.items():
        with tab[in_tab.name]:
            in_tabs[name] = _PANELS[name].__origin__(gui, actions)
    left.dock_left()
    left.set_width(LEFT_WIDTH)
    gui.main_panel.dock_right()
    gui.main_panel.set_width(RIGHT_WIDTH)
    return Panels(headline=headline, own_data=own_data, review=review, **in_tabs)


def add_tabs(gui: viser.GuiApi, *, scans_first: bool) -> dict[str, viser.GuiTabHandle]:
    """Create an empty tab for each name in STEPS.

    Tabs cannot be moved or hidden later: where there is no scan to look at first, the model's steps come first.
    """
    order = STEPS if scans_first else (*MODEL_FIRST, *(step for step in STEPS if step not in MODEL_FIRST))
    steps = gui.add_tab_group()
    tabs: dict[str, viser.GuiTabHandle] = {}
    for step in order:
        tab = steps.add_tab(step, icon=ICONS[step])
        if not STEPS[step]:
            tabs[step] = tab
            continue
        with tab:
            inside = gui.add_tab_group()
        tabs |= {name: inside.add_tab(name) for name in STEPS[step]}
    return tabs
