"""The tabs of the right panel: the steps of the work, each with its own tabs, so that two short rows hold them all."""

from __future__ import annotations

import viser

STEPS: dict[str, tuple[str, ...]] = {  # a step without tabs of its own is one itself
    "Measure": ("Scans", "Planes", "Corner"),
    "Model": ("Compare", "Fit", "Redundancy"),
    "Learn": ("What is missing", "Where it fails"),
    "Take away": (),
}
ICONS = {
    "Measure": viser.Icon.RULER_MEASURE,
    "Model": viser.Icon.ROBOT,
    "Learn": viser.Icon.BULB,
    "Take away": viser.Icon.DOWNLOAD,
}
MODEL_FIRST = ("Learn", "Model", "Measure")


def add_tabs(gui: viser.GuiApi, *, scans_first: bool) -> dict[str, viser.GuiTabHandle]:
    """A tab for each name in STEPS, to be filled.

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
