"""Which layers are on show, and where the camera stands."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calib.array_types import Array
from inspector.panels.review import ReviewPanel
from inspector.scene.draw_scan import middle_of
from inspector.scene.scene_view import BESIDE, LAYERS, SceneView
from inspector.session.view import VIEW_LAYERS, VIEWS, WIDE_VIEWS, View, corner_of

VIEW_DISTANCE_MM = {"Scan": 330.0, "Planes": 240.0, "Corner": 170.0, "Distance": 200.0}
CLOSE_BESIDE = np.array([0.10, -0.08, 0.0])  # of the scanner, near enough to see all that it saw
WHOLE_SCAN_MM = 600.0  # where no corner tells what to look at
ARM_DISTANCE = 2.0  # of the radius that holds arm and points
ARM_BESIDE, ARM_ABOVE = 1.1, 0.45  # where the arm is looked at from: to the scanner's right, and above


class Camera:
    """The layers of the view on show; the user may switch each of them."""

    def __init__(self, scene: SceneView, review: ReviewPanel) -> None:
        self._scene, self._review = scene, review
        self.name = VIEWS[0]
        self.visible = set(VIEW_LAYERS[self.name])
        self._show()

    def choose(self, name: str) -> None:
        """The layers of a view, where another one was on show."""
        if name != self.name:
            self.name = name
            self.visible = set(VIEW_LAYERS[name])
            self._show()

    def layer(self, name: str, visible: bool) -> None:
        """Show or hide one layer."""
        self.visible = self.visible | {name} if visible else self.visible - {name}
        self._scene.show(name, visible)

    def _show(self) -> None:
        self._review.show_layers(self.visible)
        for name in LAYERS:
            self._scene.show(name, name in self.visible)

    def at(self, view: View, medians: Mapping[int, Array]) -> None:
        """Put the camera where this view is seen well. medians: the middle (3,) of each scan loaded, by pose, mm."""
        self.focus(view, medians)
        placed = arm_frame(view) if self.name == "Arm" else None
        if placed is not None:
            middle, radius = arm_middle(view, placed, medians)
            up = placed[:3, 2]
            right = np.cross(-middle, up)
            right /= max(float(np.linalg.norm(right)), 1e-9)
            beside = ARM_BESIDE * right + ARM_ABOVE * up
            self._scene.aim_camera(ARM_DISTANCE * radius, middle, down=-up, beside=beside)
            return
        middle, radius = middle_of(view, medians)
        away = VIEW_DISTANCE_MM.get(self.name, max(450.0, 2.2 * radius + 250.0))
        if self.name not in WIDE_VIEWS and corner_of(view, view.pose) is None:
            away = WHOLE_SCAN_MM
        self._scene.aim_camera(away, middle, beside=BESIDE if self.name in WIDE_VIEWS else close_beside(view))

    def focus(self, view: View, medians: Mapping[int, Array]) -> None:
        """The middle of everything for an overview, else the corner of the selected pose, in the middle of the view."""
        found = corner_of(view, view.pose)
        placed = arm_frame(view) if self.name == "Arm" else None
        if placed is not None:
            self._scene.focus(arm_middle(view, placed, medians)[0])
        elif self.name in WIDE_VIEWS:
            self._scene.focus(middle_of(view, medians)[0])
        elif found is not None:
            self._scene.focus(found[0])
        elif view.pose in medians and np.isfinite(medians[view.pose]).all():
            self._scene.focus(medians[view.pose])


def close_beside(view: View) -> Array:
    """Where one scan is looked at from, beside the scanner (3,): where all three faces of the jig can be seen."""
    corner = None if view.search is None else view.search.corner
    if corner is None:
        return CLOSE_BESIDE
    all_three = np.sum([face.normal for face in corner.faces], axis=0)
    return np.asarray(all_three / np.linalg.norm(all_three))


def arm_frame(view: View) -> Array | None:
    """scanner_T_base (4, 4) as the chosen version of the model has it; None before there is one."""
    if view.version is None:
        return None
    setup = str(view.session.dataset.poses.setup[view.pose])
    return view.version.evaluation.scanner_T_base.get(setup)


def arm_middle(view: View, scanner_T_base: Array, medians: Mapping[int, Array]) -> tuple[Array, float]:
    """The middle (3,) of the smallest ball about the robot's base and the ball of the points, and its radius, mm."""
    points, radius = middle_of(view, medians)
    away = scanner_T_base[:3, 3] - points
    distance = max(float(np.linalg.norm(away)), 1e-9)
    outside = max(distance - radius, 0.0)  # how far the base stands out of the points' ball
    return points + 0.5 * outside * away / distance, radius + 0.5 * outside
