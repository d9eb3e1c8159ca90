"""Tab Compare: the versions of the model side by side, and how the jig's model lies over the scan."""

from __future__ import annotations

from functools import partial

import numpy as np
import viser
from numpy.typing import NDArray

from calib.calibration.evaluation import Figures
from calib.calibration.model_versions import VERSIONS, Version
from calib.calibration.noise_check import noise_floor_mm
from inspector.markup import colour_scale as colour_map
from inspector.markup import elements as tables
from inspector.markup import numbers as words
from inspector.markup.palette import FACE_COLOURS, MODEL_COLOURS
from inspector.panels.base import BY_ERROR, COLOURINGS, FACTORS, Actions, News, View, by_page
from inspector.panels.review import roles_legend
from inspector.scene.draw_model import distance_limit_mm, error_limit_mm
from inspector.server.viser_server import one_of

NOTE = (
    "The same measured points against the nominal robot, the calibrated link errors, and the model with the effects "
    "that were added. Arrows go from measured to predicted. Look for arrows that point alike or grow with the reach: "
    "noise does neither."
)
SHOW_ARM, SHOW_DISTANCE = "Arm and arrows", "Jig over scan"
NOT_YET = (
    "Nothing to compare yet: the model is fitted when the search has ended. The tab Fit says what it lacks."
)
COLUMNS = ("model", "training", "max", "test", "max")


class ComparePanel:
    """Which versions are shown, their key figures, and the legends of what is drawn."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        gui.add_html(tables.note(NOTE))
        self._show = gui.add_button_group("In 3D", (SHOW_ARM, SHOW_DISTANCE))
        self._show.on_click(lambda e: actions.look("Distance" if e.target.value == SHOW_DISTANCE else "Arm"))
        self._figures = gui.add_html(tables.note(NOT_YET))
        self.version = gui.add_dropdown("Model shown", VERSIONS, hint="whose arm and whose errors are shown")
        with gui.add_folder("Arrows to what these predict", expand_by_default=True):
            self.shown = {name: gui.add_checkbox(name, False) for name in VERSIONS}
        self.arrows = gui.add_dropdown(
            "Residuals ×", tuple(str(f) for f in FACTORS), initial_value="100",
            hint="how many times longer than they are residuals are drawn, measured to predicted",
        )  # fmt: skip
        self.colouring = gui.add_dropdown("Measured points", COLOURINGS)
        self._legend = gui.add_html("")
        self._pose = gui.add_html("")
        self._distance = gui.add_html("")
        self._problems = gui.add_html("")
        self._news = News()
        self._connect(actions)

    def _connect(self, a: Actions) -> None:
        self.version.on_update(lambda e: a.version(str(e.target.value)) if by_page(e) else None)
        self.colouring.on_update(lambda e: a.colouring(str(e.target.value)) if by_page(e) else None)
        for name, box in self.shown.items():
            box.on_update(partial(_ticked, a, name))
        self.arrows.on_update(
            lambda e: (
                a.arrows(float(one_of(e.target.value, [str(f) for f in FACTORS], "100")))
                if by_page(e)
                else None
            )
        )

    def update(self, view: View, problems: tuple[str, ...] = ()) -> None:
        """Everything but the distances, which come with the scan; `problems` with what should be drawn."""
        names = [version.name for version in view.versions]
        for name, box in self.shown.items():
            box.disabled = name not in names
            self._news.put(box, name in names and name in view.compared)
        has_scans = view.session.dataset.scan_folder is not None
        self._show.options = (SHOW_ARM, SHOW_DISTANCE) if has_scans else (SHOW_ARM,)
        if tuple(names or VERSIONS) != tuple(self.version.options):
            self.version.options = tuple(names or VERSIONS)
        if view.version is not None:
            self._news.put(self.version, view.version.name)
        self._news.put(self.arrows, f"{view.arrows:g}")
        self._news.put(self.colouring, view.colouring)
        self._figures.content = figures_html(view) if names else tables.note(NOT_YET)
        self._legend.content = legend_html(view) if names else ""
        self._pose.content = pose_html(view)
        self._problems.content = "".join(tables.alert(p, colour="#E69F00") for p in problems)

    def update_distance(self, view: View, distances_mm: NDArray | None) -> None:
        """The selected scan's distances to the jig's faces (N,), nan beside the jig; None without a corner."""
        self._distance.content = distance_html(view, distances_mm)


def _ticked(actions: Actions, name: str, event: viser.GuiEvent[viser.GuiCheckboxHandle]) -> None:
    if by_page(event):
        actions.prediction(name, bool(event.target.value))


def figures_html(view: View) -> str:
    """The key figures of each version, and what noise alone would leave."""
    rows = [
        (
            tables.named_swatch(MODEL_COLOURS[version.name], version.name),
            *_of(version.evaluation.train),
            *_of(version.evaluation.test),
        )
        for version in view.versions
    ]
    floor = noise_floor_mm(view.versions[-1].calibration)
    noise = "not declared" if floor is None else words.millimetres(floor)
    tested = view.versions[-1].evaluation.test is not None
    return (
        tables.heading("3D errors, mm: RMSE and largest")
        + tables.table(
            COLUMNS, [*rows, ("noise alone", noise, "–", noise if floor is not None and tested else "–", "–")]
        )
        + tables.note("Training poses are fitted; test poses are only predicted.")
    )


def _of(figures: Figures | None) -> tuple[str, str]:
    if figures is None:
        return "–", "–"
    return words.millimetres(figures.rmse_mm), words.millimetres(figures.max_mm)


def legend_html(view: View) -> str:
    """How much is exaggerated, and what the points' colours mean."""
    return exaggeration(view) + points_legend(view)


def exaggeration(view: View) -> str:
    """How many times longer than they are residuals are drawn."""
    return tables.note(
        f"Arrows and predicted points are drawn {view.arrows:g} times farther from the measured points than they are; "
        "the arm is not exaggerated."
    )


def points_legend(view: View) -> str:
    """What the colours of the measured points mean."""
    if view.colouring != BY_ERROR or view.version is None:
        return roles_legend()
    floor = noise_floor_mm(view.version.calibration)
    return colour_map.bar(
        f"Measured points: 3D error of {view.version.name}", 0.0, error_limit_mm(view), colour_map.ERROR,
        mark=None if floor is None else (floor, f"noise alone, {words.length(floor)}"),
    )  # fmt: skip


def distance_bar(distances_mm: NDArray) -> str:
    """The scale of the colours of a scan's points (N,) on the jig."""
    limit = distance_limit_mm(distances_mm)
    return colour_map.bar("Distance to the nearest chosen face", -limit, limit, colour_map.SIGNED)


def pose_html(view: View) -> str:
    """The selected pose's error in each version."""
    rows = [row for version in view.versions if (row := _pose_row(view, version)) is not None]
    if not rows:
        return tables.heading(f"Pose {view.pose_id}") + tables.note("No measured point to compare with.")
    title = tables.heading(f"Pose {view.pose_id}: predicted − measured, mm")
    return (
        title
        + tables.table(("model", "x", "y", "z", "length"), rows)
        + tables.note("In the scanner's frame, mean over the pose's points.")
    )


def _pose_row(view: View, version: Version) -> tuple[object, ...] | None:
    error = version.pose_error_vectors_mm()[view.pose]
    if not np.isfinite(error).all():
        return None
    return (
        tables.named_swatch(MODEL_COLOURS[version.name], version.name),
        *(f"{e:+.4f}" for e in error),
        words.millimetres(float(np.linalg.norm(error))),
    )


def distance_html(view: View, distances_mm: NDArray | None) -> str:
    """How far the scan lies from the three faces that were chosen in it, with the scale of its colours."""
    if view.session.dataset.scan_folder is None:
        return ""
    title = tables.heading(f"Jig over scan {view.pose_id}")
    if distances_mm is None:
        return title + tables.note(
            "No corner was found in this scan, so there is no place for the jig's model."
        )
    known = distances_mm[np.isfinite(distances_mm)]
    if not len(known):
        return title + tables.note("No point of this scan lies on the jig's faces.")
    facts = [
        ("points on the jig", f"{len(known):,} of {len(distances_mm):,}"),
        ("rms distance", words.length(float(np.sqrt(np.mean(known**2))))),
        ("19 in 20 within", f"±{words.length(float(np.percentile(np.abs(known), 95)))}"),
    ]
    return (
        title
        + distance_bar(distances_mm)
        + tables.facts(facts)
        + tables.legend((FACE_COLOURS[i], f"model's face {i + 1}") for i in range(3))
        + tables.note(
            "Positive is outside the jig, towards the scanner. Look for patches of one colour: a bent face."
        )
    )
