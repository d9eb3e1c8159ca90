"""The panels of the page: the left one, and the tabs of the right one, in the order of the work.

Each step has its own tabs, so that two short rows hold them all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, get_type_hints

import viser

from calib.plugins import load
from inspector import plugins
from inspector.panels.base import Actions, FollowsModel
from inspector.panels.downloads import DownloadsPanel
from inspector.panels.headline import HeadlinePanel
from inspector.panels.learn.missing_effects import MissingEffectsPanel
from inspector.panels.learn.plan import PlanPanel
from inspector.panels.learn.residuals import ResidualsPanel
from inspector.panels.measure.corner import CornerPanel
from inspector.panels.measure.planes import PlanesPanel
from inspector.panels.measure.scans import ScansPanel
from inspector.panels.model.compare import ComparePanel
from inspector.panels.model.fit import FitPanel
from inspector.panels.model.redundancy import RedundancyPanel
from inspector.panels.model.side_by_side import SideBySidePanel
from inspector.panels.review import ReviewPanel
from inspector.panels.your_data import OwnDataButton
from inspector.plugins import Tab
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
class Panels:
    """All panels of the page: those in tabs of its own, the others, and those that plug-ins bring."""

    scans: Annotated[ScansPanel, Tab("Measure", "Scans", 10, view="Scan")]
    planes: Annotated[PlanesPanel, Tab("Measure", "Planes", 20, view="Planes")]
    corner: Annotated[CornerPanel, Tab("Measure", "Corner", 30, view="Corner")]
    compare: Annotated[ComparePanel, Tab("Model", "Compare", 10, view="Arm")]
    fit: Annotated[FitPanel, Tab("Model", "Fit", 20, view="Arm")]
    redundancy: Annotated[RedundancyPanel, Tab("Model", "Redundancy", 30)]
    side_by_side: Annotated[SideBySidePanel, Tab("Model", "Beside", 40, view="Arm")]
    missing_effects: Annotated[MissingEffectsPanel, Tab("Learn", "What is missing", 10, view="Arm")]
    residuals: Annotated[ResidualsPanel, Tab("Learn", "Where it fails", 20, view="Arm")]
    plan: Annotated[PlanPanel, Tab("Learn", "Plan", 30, view="Arm")]
    downloads: Annotated[DownloadsPanel, Tab("Take away", "Take away", 10)]
    headline: HeadlinePanel
    own_data: OwnDataButton
    review: ReviewPanel
    contributed: Mapping[str, Any]  # by the tab's name

    def show_model(self, view: View) -> None:
        """Refresh every panel that follows the model on show."""
        for panel in (*(getattr(self, name) for name in _PANELS), *self.contributed.values()):
            if isinstance(panel, FollowsModel):
                panel.update(view)

    def say(self, words: str) -> None:
        """Show what the program is doing with the model, or why that is impossible."""
        self.missing_effects.say(words)
        self.headline.doing(words=words)


_PANELS = {
    name: hint for name, hint in get_type_hints(Panels, include_extras=True).items() if hasattr(hint, "__metadata__")
}
CONTRIBUTED: tuple[Tab, ...] = plugins.contributions(Tab)
_OWN: dict[str, Tab] = {hint.__metadata__[0].name: hint.__metadata__[0] for hint in _PANELS.values()}
_ORDER = list(dict.fromkeys(tab.step for tab in (*_OWN.values(), *CONTRIBUTED)))
TABS: tuple[Tab, ...] = tuple(
    sorted((*_OWN.values(), *CONTRIBUTED), key=lambda tab: (_ORDER.index(tab.step), tab.order))
)
"""The tabs in the order in which they are read, those of plug-ins among the page's own."""
STEPS: dict[str, tuple[str, ...]] = {  # the tabs of each step; a step that is a single tab has none inside
    step: tuple(tab.name for tab in TABS if tab.step == step != tab.name) for step in _ORDER
}
VIEW_OF_TAB = {tab.name: tab.view for tab in TABS if tab.view}


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
    in_tabs, contributed = {}, {}
    for name, hint in _PANELS.items():
        with tab[hint.__metadata__[0].name]:
            in_tabs[name] = hint.__origin__(gui, actions)
    for brought in CONTRIBUTED:
        with tab[brought.name]:
            contributed[brought.name] = load(brought.panel)(gui, actions)
    left.dock_left()
    left.set_width(LEFT_WIDTH)
    gui.main_panel.dock_right()
    gui.main_panel.set_width(RIGHT_WIDTH)
    return Panels(headline=headline, own_data=own_data, review=review, contributed=contributed, **in_tabs)


def add_tabs(gui: viser.GuiApi, *, scans_first: bool) -> dict[str, viser.GuiTabHandle]:
    """Create an empty tab for each name in STEPS.

    Tabs cannot be moved or hidden later: where there is no scan to look at first, the model's steps come first.
    """
    order = STEPS if scans_first else (*MODEL_FIRST, *(step for step in STEPS if step not in MODEL_FIRST))
    steps = gui.add_tab_group()
    tabs: dict[str, viser.GuiTabHandle] = {}
    for step in order:
        tab = steps.add_tab(step, icon=ICONS.get(step, viser.Icon.PUZZLE))
        if not STEPS[step]:
            tabs[step] = tab
            continue
        with tab:
            inside = gui.add_tab_group()
        tabs |= {name: inside.add_tab(name) for name in STEPS[step]}
    return tabs
