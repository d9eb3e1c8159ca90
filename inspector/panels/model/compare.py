"""Tab Compare: the versions of the model side by side, and the jig's model over the scan."""

from __future__ import annotations

from functools import partial

import viser

from calib.array_types import Array
from calib.calibration.model_versions import VERSIONS
from inspector.markup.model.comparison import distance_html, exaggeration, figures_html, pose_html
from inspector.markup.parts import elements
from inspector.panels.base import Actions, ChangedValues, by_page, put
from inspector.panels.input_checks import one_of
from inspector.session.view import ALL_POSES, COLOURINGS, FACTORS, View

NOTE = (
    "The same measured points against the nominal robot, the calibrated link errors, and the model with the effects "
    "that were added. Arrows go from measured to predicted. Look for arrows that point alike or grow with the reach: "
    "noise does neither."
)
AUTOMATIC = "automatic"
SHOW_ARM, SHOW_DISTANCE = "Arm and arrows", "Jig over scan"
NOT_YET = "Nothing to compare yet: the model is fitted when the search has ended. The tab Fit says what it lacks."


class ComparePanel:
    """Choice of displayed versions, their key figures, and the legends of the drawing."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        gui.add_html(elements.note(NOTE))
        self._show = gui.add_button_group("In 3D", (SHOW_ARM, SHOW_DISTANCE))
        self._show.on_click(lambda e: actions.show_view("Distance" if e.target.value == SHOW_DISTANCE else "Arm"))
        self._figures = gui.add_html(elements.note(NOT_YET))
        self.version = gui.add_dropdown(
            "Model shown", VERSIONS, hint="the version of the model whose arm and errors are shown"
        )
        with gui.add_folder("Arrows to what these predict", expand_by_default=True):
            self.shown = {name: gui.add_checkbox(name, False) for name in VERSIONS}
        self.pairs = gui.add_dropdown(
            "Paired poses",
            (ALL_POSES,),
            visible=False,
            hint="of poses measured again under another condition: errors of those before or after the change alone, "
            "or what the change moved, without geometry, instrument and tool; thin lines: what is proven",
        )
        self.arrows = gui.add_dropdown(
            "Residuals ×", (*(str(f) for f in FACTORS), AUTOMATIC), initial_value="100",
            hint="enlargement of the residuals, drawn from measured to predicted; a number that you "
            f"choose stays, {AUTOMATIC} goes back to what suits the arrows on show",
        )  # fmt: skip
        self.colouring = gui.add_dropdown("Measured points", COLOURINGS)
        self._legend = gui.add_html("")
        self._pose = gui.add_html("")
        self._distance = gui.add_html("")
        self._problems = gui.add_html("")
        self._changed = ChangedValues()
        self._connect(actions)

    def _connect(self, a: Actions) -> None:
        self.version.on_update(lambda e: a.version(str(e.target.value)) if by_page(e) else None)
        self.colouring.on_update(lambda e: a.colouring(str(e.target.value)) if by_page(e) else None)
        for name, box in self.shown.items():
            box.on_update(partial(_ticked, a, name))
        self.pairs.on_update(lambda e: a.pairs(str(e.target.value)) if by_page(e) else None)
        self.arrows.on_update(lambda e: a.arrows(_factor(e.target.value)) if by_page(e) else None)

    def update(self, view: View, problems: tuple[str, ...] = ()) -> None:
        """Show everything except distances, which come with the scan; `problems` lists what cannot be drawn."""
        names = [version.name for version in view.versions]
        for name, box in self.shown.items():
            box.disabled = name not in names
            self._changed.put(box, name in names and name in view.compared)
        has_scans = view.session.dataset.scan_folder is not None
        self._show.options = (SHOW_ARM, SHOW_DISTANCE) if has_scans else (SHOW_ARM,)
        if tuple(names or VERSIONS) != tuple(self.version.options):
            self.version.options = tuple(names or VERSIONS)
        if view.version is not None:
            self._changed.put(self.version, view.version.name)
        choices = (ALL_POSES, *view.pair_choices)
        if choices != tuple(self.pairs.options):
            self.pairs.options = choices
        self.pairs.visible = len(choices) > 1
        self._changed.put(self.pairs, view.pairs if view.pairs in choices else ALL_POSES)
        if self.arrows.value == AUTOMATIC:
            put(self.arrows, f"{view.arrows:g}")
        self._changed.put(self.arrows, f"{view.arrows:g}")
        self._changed.put(self.colouring, view.colouring)
        self._figures.content = figures_html(view) if names else elements.note(NOT_YET)
        self._legend.content = exaggeration(view)
        self._pose.content = pose_html(view)
        self._problems.content = "".join(elements.alert(p, colour="#E69F00") for p in problems)

    def update_distance(self, view: View, distances_mm: Array | None) -> None:
        """Show distances (N,) of the selected scan to the jig's faces, mm, NaN off the jig; None without a corner."""
        self._distance.content = distance_html(view, distances_mm)


def _factor(value: object) -> float | None:
    """Chosen enlargement of residuals; None for the default."""
    return None if value == AUTOMATIC else float(one_of(value, [str(f) for f in FACTORS], "100"))


def _ticked(actions: Actions, name: str, event: viser.GuiEvent[viser.GuiCheckboxHandle]) -> None:
    if by_page(event):
        actions.prediction(name, bool(event.target.value))
