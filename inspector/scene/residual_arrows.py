"""Residuals as points coloured by error, and arrows of the worst, at one scale for all versions of a dataset's model.

The nominal robot's errors choose lengths and colours, so that both shrink as the model gets better. Arrows go from the
measured to the predicted point of the worst poses and of those selected.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import viser

from calib.array_types import Array, BoolArray, IndexArray
from calib.calibration.model_versions import Version
from calib.fitting.observations import Observations
from calib.rendering import numbers
from inspector.markup.legend import error_limit_mm
from inspector.markup.parts.colour_scale import ERROR, coloured
from inspector.markup.parts.palette import MODEL_BEFORE, MODEL_COLOURS, rgb
from inspector.scene.scene_view import M_PER_MM, Nodes, Pen, SceneView, to_scene
from inspector.scene.shapes import dot_mm, facing, unit_cylinder, unit_sphere, upright
from inspector.session.view import FACTORS, WORST, View

USUAL_SHARE = 1 / 6  # of the field: most of the nominal robot's arrows are at most so long
LONGEST_SHARE = 0.6  # of the field: the longest that any arrow is drawn
MOST = 90.0  # in 100 arrows count for the factor: a wild one does not
NEAR_MM = 400.0  # the least field: sockets of a plate are a hand's breadth apart
ARROW_SHARE = 0.0014  # of the field: radius of a residual's arrow
TIP_SHARE = 0.8  # of a measured point: diameter of a predicted one
TOUCH = 3.0  # of what is drawn: how much wider is what takes its clicks, which is not seen


# ---- lengths --------------------------------------------------------------------------------------------------------


def field_mm(points_mm: Array) -> float:
    """Diagonal of the bounding box of the measured points (K, 3), mm; of one place that of what is near it."""
    return max(float(np.linalg.norm(np.ptp(points_mm, axis=0))), NEAR_MM) if len(points_mm) else 0.0


def fitting_arrows(view: View) -> float:
    """Default enlargement of residuals, by the nominal robot's alone, so that arrows shrink as the model improves."""
    versions = view.session.versions
    if not versions or versions[0].calibration.dataset.points is None:
        return view.arrows
    lengths = np.linalg.norm(versions[0].evaluation.error_mm, axis=1)
    long_mm = float(np.percentile(lengths, MOST)) if len(lengths) else 0.0
    return _fitting(long_mm, field_mm(versions[0].calibration.dataset.points.xyz_mm))


def _fitting(error_mm: float, field: float) -> float:
    return float(max((f for f in FACTORS if f * error_mm <= USUAL_SHARE * field), default=FACTORS[0]))


def drawn_as(error_mm: Array, view: View, field: float) -> tuple[Array, BoolArray]:
    """Arrows (K, 3) for errors (K, 3), enlarged by `view.arrows`, and a mask (K,) of those that were shortened."""
    arrows = view.arrows * error_mm
    most = LONGEST_SHARE * field
    lengths = np.linalg.norm(arrows, axis=1)
    cut = lengths > most * (1 + 1e-9)
    return np.where(cut[:, None], arrows * (most / np.maximum(lengths, 1e-12))[:, None], arrows), cut


def longest_words(longest_mm: float, cut: int = 0) -> str:
    """Words on the arrows for the legend: the longest error, and the number of shortened arrows."""
    return f"longest {numbers.length(longest_mm)}" + (f"; {cut} cut" if cut else "")


# ---- arrows ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Arrows:
    """Arrows of one version, in the frame of the selected pose's scanner placement."""

    start_mm: Array  # (K, 3) measured points
    error_mm: Array  # (K, 3) predicted minus measured, true to scale
    tip_mm: Array  # (K, 3) ends of the enlarged arrows
    cut: BoolArray  # (K,) whether the arrow was shortened
    pose: IndexArray  # (K,) pose of each point

    @property
    def length_mm(self) -> Array:
        """Lengths (K,) of the errors."""
        return np.linalg.norm(self.error_mm, axis=1)

    @property
    def longest_mm(self) -> float:
        """Length of the longest error; 0 where nothing was measured."""
        return float(self.length_mm.max(initial=0.0))


def _arrows_of(version: Version, view: View) -> _Arrows:
    dataset = version.calibration.dataset
    measured = Observations.of_all(dataset).points
    here = dataset.poses.setup[measured.pose] == dataset.poses.setup[view.pose]
    start_mm, error_mm = measured.xyz_mm[here], version.evaluation.error_mm[here]
    arrows, cut = drawn_as(error_mm, view, field_mm(start_mm))
    return _Arrows(start_mm, error_mm, start_mm + arrows, cut, measured.pose[here])


class ResidualArrows:
    """Drawing of what the version on show predicts, with arrows from the measured points, enlarged by `View.arrows`.

    Points are coloured by error, over thin lines of the model before it, from which `between` moves both.

    on_click: called with the index of the pose whose arrow or predicted point was clicked.
    """

    def __init__(self, scene: SceneView, on_click: Callable[[int], None]) -> None:
        self._scene, self._on_click = scene, on_click
        self._now: _Arrows | None = None
        self._before: _Arrows | None = None  # those of the version before it
        self._chosen = np.zeros(0, dtype=bool)  # which have an arrow
        self._arrows: viser.ArrowsHandle | None = None
        self._points: viser.PointCloudHandle | None = None
        self._limit_mm = 1.0  # end of the colour scale
        self.words = ""  # how long they are, for the legend

    def draw(self, view: View) -> None:
        """Draw the version on show."""
        now = None if view.version is None else _arrows_of(view.version, view)
        before = None if view.version_before is None else _arrows_of(view.version_before, view)
        self._now, self._arrows, self._points = now, None, None
        if now is None or not len(now.pose):
            self._scene.clear("residuals", "predicted", "before")
            return
        same = before is not None and len(before.pose) == len(now.pose)
        self._before = before if same else None
        worst = np.argsort(-now.length_mm, kind="stable")[:WORST]
        selected = np.isin(now.pose, (view.pose, *view.boxed))
        self._chosen = (now.length_mm > 0) & (selected | np.isin(np.arange(len(now.pose)), worst))
        self._limit_mm = error_limit_mm(view)
        self.words = longest_words(now.longest_mm, int(now.cut.sum()))
        colour = rgb(MODEL_COLOURS[view.version.name if view.version is not None else ""])
        self._scene.draw("residuals", lambda pen: self._residuals(pen, now, colour))
        self._scene.draw("predicted", lambda pen: self._predicted(pen, now))
        self._scene.draw("before", self._lines_before)

    def between(self, share: float) -> None:
        """Draw arrows, colours and words interpolated from the version before (share 0) to that on show (share 1)."""
        now, before = self._now, self._before
        if now is None or before is None or self._points is None:
            return
        tips = before.tip_mm + share * (now.tip_mm - before.tip_mm)
        length_mm = np.linalg.norm(before.error_mm + share * (now.error_mm - before.error_mm), axis=1)
        if self._arrows is not None:
            self._arrows.points = to_scene(np.stack([now.start_mm, tips], axis=1)[self._chosen])
        self._points.points = to_scene(tips)
        self._points.colors = coloured(length_mm, 0.0, self._limit_mm, ERROR)
        self.words = longest_words(float(length_mm.max(initial=0.0)))

    def _lines_before(self, pen: Pen) -> Nodes:
        if self._before is None:
            return []
        lines_mm = np.stack([self._before.start_mm, self._before.tip_mm], axis=1)[self._chosen]
        return [pen.lines("lines", lines_mm, rgb(MODEL_BEFORE), 1.0)]

    def _residuals(self, pen: Pen, now: _Arrows, colour: tuple[int, int, int]) -> Nodes:
        """Nodes of arrows from measured to predicted points, clickable."""
        arrows_mm, pose = np.stack([now.start_mm, now.tip_mm], axis=1)[self._chosen], now.pose[self._chosen]
        if not len(arrows_mm):
            return []
        radius_mm = ARROW_SHARE * (field_mm(now.start_mm) + 50.0)
        size = radius_mm * M_PER_MM
        along = arrows_mm[:, 1] - arrows_mm[:, 0]
        length = np.linalg.norm(along, axis=1)
        width = np.full_like(length, TOUCH * radius_mm)
        self._arrows = pen.api.add_arrows(
            pen.of("arrows"), to_scene(arrows_mm), np.tile(np.array(colour, dtype=np.uint8), (len(arrows_mm), 1)),
            shaft_radius=size, head_radius=2.5 * size, head_length=5.0 * size,
        )  # fmt: skip
        touched = pen.touched(
            "touch", unit_cylinder(), facing(along / length[:, None]), arrows_mm.mean(axis=1),
            np.stack([width, width, length], axis=1), lambda k: self._on_click(int(pose[k])),
        )  # fmt: skip
        return [self._arrows, touched]

    def _predicted(self, pen: Pen, now: _Arrows) -> Nodes:
        """Nodes of the predicted points, coloured by error, clickable."""
        size_mm = TIP_SHARE * dot_mm(now.start_mm)
        size = np.full((len(now.pose), 3), TOUCH / 2 * size_mm)
        colours = coloured(now.length_mm, 0.0, self._limit_mm, ERROR)
        self._points = pen.points("0", now.tip_mm, colours, size_mm)
        touched = pen.touched(
            "touch", unit_sphere(6, 8), upright(len(size)), now.tip_mm, size,
            lambda k: self._on_click(int(now.pose[k])),
        )  # fmt: skip
        return [self._points, touched]
