"""The panels of the page: the left one, and the tabs of the right one, which are the steps of the work.

Each step has its own tabs, so that two short rows hold them all.
"""

from __future__ import annotations

from dataclasses import dataclass

import viser

from inspector.panels.base import Actions
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
from inspector.panels.model.watch import WatchPanel
from inspector.panels.review import ReviewPanel
from inspector.panels.your_data import OwnDataButton

STEPS: dict[str, tuple[str, ...]] = {  # a step without tabs of its own is one itself
    "Measure": ("Scans", "Planes", "Corner"),
    "Model": ("Compare", "Fit", "Redundancy", "Beside", "Watch"),
    "Learn": ("What is missing", "Where it fails", "Plan"),
    "Take away": (),
}
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
    """All panels of the page."""

    headline: HeadlinePanel
    own_data: OwnDataButton
    review: ReviewPanel
    scans: ScansPanel
    planes: PlanesPanel
    corner: CornerPanel
    compare: ComparePanel
    redundancy: RedundancyPanel
    side_by_side: SideBySidePanel
    watch: WatchPanel
    fit: FitPanel
    missing_effects: MissingEffectsPanel
    residuals: ResidualsPanel
    plan: PlanPanel
    downloads: DownloadsPanel

    def say(self, words: str) -> None:
        """Show what is being done with the model, or why it cannot be done."""
        self.missing_effects.say(words)
        self.headline.doing(words=words)


def add_panels(
    gui: viser.GuiApi,
    actions: Actions,
    datasets: tuple[str, ...],
    *,
    scans_first: bool,
    takes_data: bool = False,
) -> Panels:
    """Create the page's panels in reading order."""
    left = gui.add_panel()
    with left.add_tab("Review", icon=viser.Icon.LIST_SEARCH):
        own_data = OwnDataButton(gui, takes_data=takes_data)
        review = ReviewPanel(gui, actions, datasets)
    headline = HeadlinePanel(gui)
    tab = add_tabs(gui, scans_first=scans_first)
    with tab["Scans"]:
        scans = ScansPanel(gui, actions)
    with tab["Planes"]:
        planes = PlanesPanel(gui, actions)
    with tab["Corner"]:
        corner = CornerPanel(gui, actions)
    with tab["Compare"]:
        compare = ComparePanel(gui, actions)
    with tab["Redundancy"]:
        redundancy = RedundancyPanel(gui, actions)
    with tab["Beside"]:
        side_by_side = SideBySidePanel(gui, actions)
    with tab["Watch"]:
        watch = WatchPanel(gui, actions)
    with tab["Fit"]:
        fit = FitPanel(gui, actions)
    with tab["What is missing"]:
        missing_effects = MissingEffectsPanel(gui, actions)
    with tab["Where it fails"]:
        residuals = ResidualsPanel(gui, actions)
    with tab["Plan"]:
        plan = PlanPanel(gui, actions)
    with tab["Take away"]:
        downloads = DownloadsPanel(gui, actions)
    left.dock_left()
    left.set_width(LEFT_WIDTH)
    gui.main_panel.dock_right()
    gui.main_panel.set_width(RIGHT_WIDTH)
    return Panels(
        headline,
        own_data,
        review,
        scans,
        planes,
        corner,
        compare,
        redundancy,
        side_by_side,
        watch,
        fit,
        missing_effects,
        residuals,
        plan,
        downloads,
    )


def add_tabs(gui: viser.GuiApi, *, scans_first: bool) -> dict[str, viser.GuiTabHandle]:
    """Create a tab for each name in STEPS, still empty.

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
