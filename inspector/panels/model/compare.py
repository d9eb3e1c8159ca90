"""Tab Compare: the versions of the model side by side, and the jig's model over the scan."""

from __future__ import annotations

import numpy as np
import viser

from calib.array_types import Array
from calib.calibration.model_versions import VERSIONS
from calib.present.fit.errors import errors_by_version, pose_error_by_version
from calib.rendering import numbers
from calib.rendering.blocks import Block, Facts, Paragraph, Section
from calib.rendering.colours import DOUBT
from calib.rendering.html import panel
from calib.statistics import rms
from inspector.markup.legend import distance_bar
from inspector.markup.parts import elements
from inspector.markup.parts.palette import FACE_COLOURS, MODEL_COLOURS
from inspector.panels.base import Actions, ChangedValues, on_page, put, relist
from inspector.panels.input_checks import one_of
from inspector.session.view import FACTORS, View

NOTE = (
    "The same measured points against the arm as delivered, with calibrated links, and with the effects that were "
    "added. Arrows go from measured to predicted. Look for arrows that point alike or grow with the reach: "
    "noise does neither."
)
AUTOMATIC = "automatic"
SHOW_ARM, SHOW_DISTANCE = "Arm and arrows", "Jig over scan"
RMSE, ROLES_NOTE = "3D errors, mm: RMSE and largest", "Training poses are fitted; test poses are only predicted."
ERROR_OF_NONE = "This pose is left out of fits and tests, so it has no error."
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
        self.arrows = gui.add_dropdown(
            "Residuals ×", (*(str(f) for f in FACTORS), AUTOMATIC), initial_value="100",
            hint="enlargement of the residuals, drawn from measured to predicted; a number that you "
            f"choose stays, {AUTOMATIC} goes back to what suits the arrows on show",
        )  # fmt: skip
        self._pose = gui.add_html("")
        self._distance = gui.add_html("")
        self._problems = gui.add_html("")
        self._changed = ChangedValues()
        self._connect(actions)

    def _connect(self, a: Actions) -> None:
        on_page(self.version, lambda value: a.version(str(value)))
        on_page(self.arrows, lambda value: a.arrows(_factor(value)))

    def update(self, view: View, problems: tuple[str, ...] = ()) -> None:
        """Show everything except distances, which come with the scan; `problems` lists what cannot be drawn."""
        names = [version.name for version in view.versions]
        has_scans = view.session.dataset.scan_folder is not None
        self._show.options = (SHOW_ARM, SHOW_DISTANCE) if has_scans else (SHOW_ARM,)
        relist(self.version, tuple(names or VERSIONS))
        if view.version is not None:
            self._changed.put(self.version, view.version.name)
        if self.arrows.value == AUTOMATIC:
            put(self.arrows, f"{view.arrows:g}")
        self._changed.put(self.arrows, f"{view.arrows:g}")
        table = errors_by_version(view.versions, MODEL_COLOURS) if names else None
        self._figures.content = _section(RMSE, ROLES_NOTE, table) if table else elements.note(NOT_YET)
        self._pose.content = pose_html(view)
        self._problems.content = "".join(elements.alert(p, colour=DOUBT) for p in problems)

    def update_distance(self, view: View, distances_mm: Array | None) -> None:
        """Show distances (N,) of the selected scan to the jig's faces, mm, NaN off the jig; None without a corner."""
        self._distance.content = distance_html(view, distances_mm)


def _factor(value: object) -> float | None:
    """Chosen enlargement of residuals; None for the default."""
    return None if value == AUTOMATIC else float(one_of(value, [str(f) for f in FACTORS], "100"))


def pose_html(view: View) -> str:
    """HTML on the selected pose's error in each version."""
    table = pose_error_by_version(view.versions, view.pose, MODEL_COLOURS)
    if not table.rows:
        why = ERROR_OF_NONE if view.pose_id in view.session.uncounted else "No measured point to compare with."
        return _section(f"Pose {view.pose_id}", why)
    note = "In the instrument's frame, mean over the pose's points."
    return _section(f"Pose {view.pose_id}: predicted − measured, mm", note, table)


def distance_html(view: View, distances_mm: Array | None) -> str:
    """HTML on the scan's distances to the three faces found in it, with their colour scale."""
    if view.session.dataset.scan_folder is None:
        return ""
    title = f"Jig over scan {view.pose_id}"
    if distances_mm is None:
        return _section(title, "No corner was found in this scan, so there is no place for the jig's model.")
    known = distances_mm[np.isfinite(distances_mm)]
    if not len(known):
        return _section(title, "No point of this scan lies on the jig's faces.")
    facts = Facts(
        [
            ("points on the jig", f"{len(known):,} of {len(distances_mm):,}"),
            ("rms distance", numbers.length(rms(known))),
            ("19 in 20 within", f"±{numbers.length(float(np.percentile(np.abs(known), 95)))}"),
        ]
    )
    told = "Positive is outside the jig, towards the scanner. Look for patches of one colour: a bent face."
    faces = elements.legend((FACE_COLOURS[i], f"model's face {i + 1}") for i in range(3))
    return _section(title, told, facts) + distance_bar(distances_mm) + faces


def _section(title: str, note: str, *blocks: Block) -> str:
    return panel([Section(title, [*blocks, Paragraph(note, soft=True)])])
