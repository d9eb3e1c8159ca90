"""Residuals as points coloured by error, and arrows of the worst, at one scale for all versions of a dataset's model.

The nominal robot's errors choose lengths and colours, so that both shrink as the model gets better. Arrows go from the
measured to the predicted point of the worst poses and of those selected. Of poses measured again under another
condition: those before or after the change alone, or what the change moved.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import viser

from calib import frames
from calib.array_types import Array, BoolArray, ByteArray, IndexArray
from calib.calibration.model_versions import EFFECTS, Version
from calib.fitting.observations import Observations
from calib.rendering import numbers
from inspector.markup.legend import error_limit_mm
from inspector.markup.parts.colour_scale import ERROR, coloured
from inspector.markup.parts.palette import CHANGED, MODEL_BEFORE, MODEL_COLOURS, rgb
from inspector.scene.scene_view import M_PER_MM, Nodes, Pen, SceneView, to_scene
from inspector.scene.shapes import dot_mm, facing, unit_cylinder, unit_sphere, upright
from inspector.session.view import BEFORE, DIFFERENCE, FACTORS, WORST, View

USUAL_SHARE = 1 / 6  # of the field: most of the nominal robot's arrows are at most so long
LONGEST_SHARE = 0.6  # of the field: the longest that any arrow is drawn
MOST = 90.0  # in 100 arrows count for the factor: a wild one does not
NEAR_MM = 400.0  # the least field: sockets of a plate are a hand's breadth apart
ARROW_SHARE = 0.0014  # of the field: radius of a residual's arrow
TIP_SHARE = 0.8  # of a measured point: diameter of a predicted one
TOUCH = 3.0  # of what is drawn: how much wider is what takes its clicks, which is not seen
_MOVING = (viser.ArrowsHandle, viser.PointCloudHandle)


# ---- lengths --------------------------------------------------------------------------------------------------------


def field_mm(points_mm: Array) -> float:
    """Diagonal of the bounding box of the measured points (K, 3), mm; of one place that of what is near it."""
    return max(float(np.linalg.norm(np.ptp(points_mm, axis=0))), NEAR_MM) if len(points_mm) else 0.0


def fitting_arrows(view: View) -> float:
    """Default enlargement of residuals, by the nominal robot's alone, so that arrows shrink as the model improves."""
    versions = view.session.versions
    if view.shown_pairs is not None and view.shows_difference:
        moved = view.shown_pairs[1]
        return _fitting(moved.longest_mm, field_mm(moved.place_mm))
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


def longest_words(longest_mm: Mapping[str, float], cut: int = 0) -> str:
    """Words on the arrows for the legend: the longest error of each version, and the number of shortened arrows."""
    several = len(longest_mm) > 1
    named = "; ".join(f"{f'{name} ' if several else ''}{numbers.length(mm)}" for name, mm in longest_mm.items())
    return f"longest {named}" + (f"; {cut} cut" if cut else "")


# ---- arrows ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Arrows:
    """Arrows of one version, in the frame of the selected pose's scanner placement."""

    start_mm: Array  # (K, 3) measured points
    error_mm: Array  # (K, 3) predicted minus measured, true to scale
    tip_mm: Array  # (K, 3) ends of the enlarged arrows
    cut: BoolArray  # (K,) whether the arrow was shortened
    pose: IndexArray  # (K,) pose of each point
    chosen: BoolArray  # (K,) whether an arrow is drawn


def _arrows_of(version: Version, view: View) -> _Arrows:
    dataset = version.calibration.dataset
    measured = Observations.of_all(dataset).points
    if view.shown_pairs is None:
        here = dataset.poses.setup[measured.pose] == dataset.poses.setup[view.pose]
    else:
        part, pairs = view.shown_pairs
        here = np.isin(measured.pose, pairs.before if part == BEFORE else pairs.after)
    pose, error = measured.pose[here], version.evaluation.error_mm[here]
    arrows = _drawn(measured.xyz_mm[here], error, pose, version, view)
    length_mm = np.linalg.norm(error, axis=1)
    worst = np.argsort(-length_mm, kind="stable")[:WORST]
    selected = np.isin(pose, (view.pose, *view.boxed))
    chosen = (length_mm > 0) & (selected | np.isin(np.arange(len(pose)), worst))
    return replace(arrows, chosen=chosen)


def _differences_of(view: View) -> tuple[_Arrows, _Arrows] | None:
    """Arrows of what a change moved, measured and as the proven causes explain it; None where these are not shown."""
    if view.shown_pairs is None or view.version is None or not view.shows_difference:
        return None
    pairs = view.shown_pairs[1]
    moved, explained = (
        _drawn(pairs.place_mm, vectors_mm, pairs.before, view.version, view)
        for vectors_mm in (pairs.moved_mm, pairs.explained_mm)
    )
    return moved, explained


def _drawn(start_mm: Array, error_mm: Array, pose: IndexArray, version: Version, view: View) -> _Arrows:
    """Arrows of errors (K, 3) at points (K, 3) of poses, brought to the frame of the selected pose's setup."""
    dataset = version.calibration.dataset
    elsewhere = dataset.poses.setup[pose] != dataset.poses.setup[view.pose]
    if elsewhere.any():
        here_T_there = version.scanner_T_base[view.pose] @ np.linalg.inv(version.scanner_T_base[pose[elsewhere]])
        start_mm, error_mm = start_mm.copy(), error_mm.copy()
        start_mm[elsewhere] = frames.apply(here_T_there, start_mm[elsewhere])
        error_mm[elsewhere] = (here_T_there[:, :3, :3] @ error_mm[elsewhere][:, :, None])[..., 0]
    arrows, cut = drawn_as(error_mm, view, field_mm(start_mm))
    return _Arrows(start_mm, error_mm, start_mm + arrows, cut, pose, np.linalg.norm(error_mm, axis=1) > 0)


class ResidualArrows:
    """Drawing of each compared version's predictions, with arrows from the measured points, enlarged by `View.arrows`.

    One version alone has its points coloured by error, over thin lines of the model before it, from which `between`
    moves both. Where what
    a change moved is shown (`View.pairs`), arrows are of that, over thin lines of what the proven causes explain.

    on_click: called with the index of the pose whose arrow or predicted point was clicked.
    """

    def __init__(self, scene: SceneView, on_click: Callable[[int], None]) -> None:
        self._scene, self._on_click = scene, on_click
        self._last: _Arrows | None = None  # those of the only version on show
        self._before: _Arrows | None = None  # those of the version before it
        self._nodes: tuple[viser.SceneNodeHandle, ...] = ()  # arrows and points that follow `between`
        self._limit_mm = 1.0  # end of the colour scale
        self.words = ""  # how long they are, for the legend

    def draw(self, view: View) -> None:
        """Draw the compared versions, or what a change moved."""
        self._last, self._before, self._nodes = None, None, ()
        differences = _differences_of(view)
        if differences is not None:
            self._draw_differences(view, *differences)
            return
        drawn = {v.name: _arrows_of(v, view) for v in view.versions if v.name in view.compared}
        self._last = next(iter(drawn.values())) if len(drawn) == 1 else None
        if view.version is not None and view.version_before is not None and set(drawn) == {view.version.name}:
            before, now = _arrows_of(view.version_before, view), drawn[view.version.name]
            self._before = replace(before, chosen=now.chosen) if len(before.pose) == len(now.pose) else before
        self._limit_mm = error_limit_mm(view)
        self._draw(view, drawn)

    def between(self, share: float) -> None:
        """Draw arrows, colours and words interpolated from the version before (share 0) to that on show (share 1)."""
        now, before = self._last, self._before
        if now is None or before is None or now.tip_mm.shape != before.tip_mm.shape:
            return
        tips = before.tip_mm + share * (now.tip_mm - before.tip_mm)
        length_mm = np.linalg.norm(before.error_mm + share * (now.error_mm - before.error_mm), axis=1)
        for node in self._nodes:
            if isinstance(node, viser.ArrowsHandle):
                node.points = to_scene(np.stack([now.start_mm, tips], axis=1)[now.chosen])
            elif isinstance(node, viser.PointCloudHandle):
                node.points = to_scene(tips)
                node.colors = coloured(length_mm, 0.0, self._limit_mm, ERROR)
        self.words = longest_words({"": float(length_mm.max(initial=0.0))})

    def _draw(self, view: View, drawn: Mapping[str, _Arrows]) -> None:
        start = np.concatenate([a.start_mm for a in drawn.values()]) if drawn else np.zeros((0, 3))
        if not len(start):
            self._scene.clear("residuals", "predicted", "before")
            return
        longest = {name: float(np.linalg.norm(a.error_mm, axis=1).max(initial=0.0)) for name, a in drawn.items()}
        self.words = longest_words(longest, sum(int(a.cut.sum()) for a in drawn.values()))
        made: list[viser.SceneNodeHandle] = []

        def kept(nodes: Nodes) -> Nodes:
            made.extend(node for node in nodes if isinstance(node, _MOVING))
            return nodes

        self._scene.draw("residuals", lambda pen: kept(self._residuals(pen, drawn, MODEL_COLOURS, start)))
        self._scene.draw("predicted", lambda pen: kept(self._predicted(pen, drawn, start)))
        before = self._before
        self._scene.draw("before", lambda pen: [] if before is None else [_thin_lines(pen, before, MODEL_BEFORE)])
        if len(drawn) == 1:
            self._nodes = tuple(made)

    def _draw_differences(self, view: View, moved: _Arrows, explained: _Arrows) -> None:
        longest_mm = float(np.linalg.norm(moved.error_mm, axis=1).max(initial=0.0))
        self.words = longest_words({DIFFERENCE: longest_mm}, int(moved.cut.sum()))
        drawn, colours = {DIFFERENCE: moved}, {DIFFERENCE: CHANGED}
        self._scene.draw("residuals", lambda pen: self._residuals(pen, drawn, colours, moved.start_mm))
        self._scene.clear("predicted")
        self._scene.draw("before", lambda pen: [_thin_lines(pen, explained, MODEL_COLOURS[EFFECTS])])

    def _residuals(self, pen: Pen, drawn: Mapping[str, _Arrows], by_name: Mapping[str, str], start_mm: Array) -> Nodes:
        """Nodes of arrows from measured to predicted points, clickable."""
        arrows_mm, colours, pose = _joined(drawn, by_name)
        if not len(arrows_mm):
            return []
        radius_mm = ARROW_SHARE * (field_mm(start_mm) + 50.0)
        size = radius_mm * M_PER_MM
        along = arrows_mm[:, 1] - arrows_mm[:, 0]
        length = np.linalg.norm(along, axis=1)
        width = np.full_like(length, TOUCH * radius_mm)
        return [
            pen.api.add_arrows(
                pen.of("arrows"), to_scene(arrows_mm), colours, shaft_radius=size, head_radius=2.5 * size,
                head_length=5.0 * size,
            ),
            pen.touched(
                "touch", unit_cylinder(), facing(along / length[:, None]), arrows_mm.mean(axis=1),
                np.stack([width, width, length], axis=1), lambda k: self._on_click(int(pose[k])),
            ),
        ]  # fmt: skip

    def _predicted(self, pen: Pen, drawn: Mapping[str, _Arrows], start_mm: Array) -> Nodes:
        """Nodes of the predicted points of each model in its colour, clickable."""
        size_mm = TIP_SHARE * dot_mm(start_mm)
        tips, pose = (np.concatenate([getattr(a, of) for a in drawn.values()]) for of in ("tip_mm", "pose"))
        size = np.full((len(tips), 3), TOUCH / 2 * size_mm)
        of_models = enumerate(drawn.items())
        return [
            *(
                pen.points(str(k), a.tip_mm, self._colours(name, a), size_mm)
                for k, (name, a) in of_models
                if len(a.pose)
            ),
            pen.touched(
                "touch", unit_sphere(6, 8), upright(len(tips)), tips, size, lambda k: self._on_click(int(pose[k]))
            ),
        ]

    def _colours(self, name: str, arrows: _Arrows) -> Any:
        """Colours of a model's predicted points: by their errors where it is drawn alone, else the model's own."""
        if self._last is None:
            return rgb(MODEL_COLOURS[name])
        return coloured(np.linalg.norm(arrows.error_mm, axis=1), 0.0, self._limit_mm, ERROR)


def _thin_lines(pen: Pen, arrows: _Arrows, colour: str) -> viser.SceneNodeHandle:
    """Node of thin lines along arrows that are drawn."""
    lines_mm = np.stack([arrows.start_mm, arrows.tip_mm], axis=1)[arrows.chosen]
    return pen.lines("lines", lines_mm, rgb(colour), 1.0)


def _joined(drawn: Mapping[str, _Arrows], by_name: Mapping[str, str]) -> tuple[Array, ByteArray, IndexArray]:
    """Arrows (K, 2, 3) that are drawn, with colours (K, 3), by name, and poses (K,)."""
    arrows, colours, poses = [], [], []
    for name, each in drawn.items():
        arrows.append(np.stack([each.start_mm, each.tip_mm], axis=1)[each.chosen])
        colours.append(np.tile(np.array(rgb(by_name[name]), dtype=np.uint8), (int(each.chosen.sum()), 1)))
        poses.append(each.pose[each.chosen])
    return np.concatenate(arrows), np.concatenate(colours), np.concatenate(poses)
