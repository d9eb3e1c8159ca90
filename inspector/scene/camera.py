"""Visible layers, the camera's position for each view, and its scale: a grid on the floor and a bar of known length."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.workcell.bodies.arm_bodies import reach_mm
from inspector.markup.parts.palette import MEASURE, rgb
from inspector.scene.arm_shape import arm_of
from inspector.scene.draw_model import pose_of
from inspector.scene.draw_scan import middle_of
from inspector.scene.scene_view import BESIDE, DOWN, LAYERS, M_PER_MM, Nodes, Pen, SceneView
from inspector.session.view import FRONT, RESET, SIDE, VIEW_LAYERS, VIEWS, WIDE_VIEWS, View, corner_of

VIEW_DISTANCE_MM = {"Scan": 330.0, "Planes": 240.0, "Corner": 170.0, "Distance": 200.0}
CLOSE_BESIDE = np.array([0.10, -0.08, 0.0])  # of the scanner, near enough to see all that it saw
WHOLE_SCAN_MM = 600.0  # where no corner tells what to look at
ARM_SHARE = 0.55  # of the reach: radius that holds an arm which carries the scanner
ARM_DISTANCE = 2.0  # of the radius that holds arm and points
ARM_BESIDE, ARM_ABOVE = 1.1, 0.45  # where the arm is looked at from: to the scanner's right, and above
STRAIGHT_DOWN = 0.02  # how far from it a look from the top is, so that it is known what is up
FIELD = 0.6  # of the camera's distance: the radius of what it sees well
SCALE_BEFORE = 0.35  # of that radius: how far before the arm's base its scale lies
SCALE_BELOW = 0.55  # of that radius: how far below the middle of a scan its scale stands


@dataclass(frozen=True)
class Field:
    """Region that a view shows, with the camera's distance and directions, unit vectors (3,) in the scanner's frame."""

    middle_mm: Array  # (3,)
    distance_mm: float  # of the camera
    usual: Array  # towards the camera, at first
    front: Array
    side: Array
    up: Array

    def towards(self, side: str) -> Array:
        """Camera position (3,) for a direction of view."""
        if side == RESET:
            return self.usual
        if side == FRONT:
            return self.front
        return self.side if side == SIDE else self.up + STRAIGHT_DOWN * self.side


class Camera:
    """Controller of the layers and the camera's position for the view on show.

    show_layers: called with the names of the visible layers whenever another view is chosen.
    """

    def __init__(self, scene: SceneView, show_layers: Callable[[set[str]], None]) -> None:
        self._scene, self._show_layers = scene, show_layers
        self.name = VIEWS[0]
        self.visible = set(VIEW_LAYERS[self.name])
        self.kept = False  # whether the user wants the view still
        self.settled = False  # whether the user has chosen what to look at in this dataset
        self._show()

    def choose(self, name: str) -> None:
        """Make the layers of a view visible, where another view was on show."""
        if name != self.name:
            self.name = name
            self.visible = set(VIEW_LAYERS[name])
            self._show()

    def layer(self, name: str, visible: bool) -> None:
        """Show or hide one layer."""
        self.visible = self.visible | {name} if visible else self.visible - {name}
        self._scene.show(name, visible)

    def _show(self) -> None:
        self._show_layers(self.visible)
        for name in LAYERS:
            self._scene.show(name, name in self.visible)

    def at(self, view: View, medians: Mapping[int, Array], side: str = RESET) -> None:
        """Move the camera to a position suited to a view. `medians`: centre (3,) of each loaded scan, by pose, mm."""
        if self.name == VIEWS[0] and view.session.dataset.robot.carries_scanner and "corners" in self.visible:
            self.layer("corners", visible=False)  # in the scanner's field, while the scans lie in the room
            self._show_layers(self.visible)
        field = self._field(view, medians)
        self._scene.focus(self._middle(view, medians, field))
        self._scene.aim_camera(field.distance_mm, field.towards(side), up=field.up)
        self._measure(view, medians, field)

    def turn_to(self, view: View, medians: Mapping[int, Array]) -> None:
        """Turn the camera to the middle of an overview, else to the selected pose's corner."""
        field = self._field(view, medians)
        self._scene.focus(self._middle(view, medians, field))
        self._measure(view, medians, field)

    def _field(self, view: View, medians: Mapping[int, Array]) -> Field:
        placed = arm_frame(view) if self.name in WIDE_VIEWS else None
        if placed is not None and self.name == "Arm":
            middle, radius = arm_middle(view, placed, medians)
            up = placed[:3, 2]
            distance, beside = ARM_DISTANCE * radius, arm_beside(middle, up)
        else:
            middle, radius = middle_of(view, medians)
            corner = corner_of(view, view.pose)
            if self.name == VIEWS[0] and view.session.dataset.robot.carries_scanner and corner is not None:
                middle, radius = corner[0], 0.0  # in the room all scans are of the one jig
            up = -np.array(DOWN) if placed is None else placed[:3, 2]
            distance = VIEW_DISTANCE_MM.get(self.name, max(450.0, 2.2 * radius + 250.0))
            if self.name not in WIDE_VIEWS and corner_of(view, view.pose) is None:
                distance = WHOLE_SCAN_MM
            beside = np.array(BESIDE) if self.name in WIDE_VIEWS else close_beside(view)
        back = unit(-middle) if np.linalg.norm(middle) > 0 else np.array([0.0, 0.0, -1.0])
        usual = unit(back + beside)
        if placed is not None:  # as the arm itself stands
            front, right = placed[:3, 0], -placed[:3, 1]
        else:
            front, right = unit(back - (back @ up) * up), unit(np.cross(up, back))
        return Field(middle, distance, usual, front, right, up)

    def measure(self, view: View, medians: Mapping[int, Array]) -> None:
        """Draw the floor's grid and the scale bar, where the view shows them."""
        self._measure(view, medians, self._field(view, medians))

    def _measure(self, view: View, medians: Mapping[int, Array], field: Field) -> None:
        placed = arm_frame(view)
        reach = reach_mm(view.session.dataset.robot)
        draw_floor(self._scene, placed, reach)
        radius = FIELD * field.distance_mm
        if placed is not None and self.name in WIDE_VIEWS:
            # On the floor, at the side of the base that the camera stands at.
            right = unit(np.cross(field.up, field.usual))
            at_mm = placed[:3, 3] + SCALE_BEFORE * radius * np.cross(right, field.up)
            draw_scale(self._scene, at_mm, right, field.up, radius)
            return
        middle = self._middle(view, medians, field)
        along = unit(np.cross(field.up, field.usual))
        draw_scale(self._scene, middle - SCALE_BELOW * radius * field.up, along, field.up, radius)

    def _middle(self, view: View, medians: Mapping[int, Array], field: Field) -> Array:
        """Point (3,) in the middle of the view."""
        if self.name in WIDE_VIEWS:
            return field.middle_mm
        found = corner_of(view, view.pose)
        if found is not None:
            return found[0]
        known = medians.get(view.pose)
        return known if known is not None and np.isfinite(known).all() else field.middle_mm


def unit(vector: Array) -> Array:
    """Unit vector in the same direction."""
    return vector / max(float(np.linalg.norm(vector)), 1e-9)


def arm_beside(middle_mm: Array, up: Array) -> Array:
    """Direction (3,) from which the arm is viewed, close to the scanner's direction."""
    return ARM_BESIDE * unit(np.cross(-middle_mm, up)) + ARM_ABOVE * up


def close_beside(view: View) -> Array:
    """Direction (3,) close to the scanner's, from which all three faces of the jig in one scan can be seen."""
    corner = None if view.search is None else view.search.corner
    if corner is None:
        return CLOSE_BESIDE
    all_three = np.sum([face.normal for face in corner.faces], axis=0)
    return all_three / np.linalg.norm(all_three)


def arm_frame(view: View) -> Array | None:
    """scanner_T_base (4, 4) of the chosen version of the model; None before there is one."""
    if view.version is None:
        return None
    placed = view.version.scanner_T_base[view.pose]
    return placed if np.isfinite(placed).all() else None


def arm_middle(view: View, scanner_T_base: Array, medians: Mapping[int, Array]) -> tuple[Array, float]:
    """Centre (3,) and radius, mm, of a ball around the arm at the selected pose and the measured points."""
    points, radius = middle_of(view, medians)
    robot = view.session.dataset.robot
    shape = None if view.version is None else arm_of(view.version, view.pose)
    if robot.carries_scanner:  # at the frame's origin, above the points; the arm is between it and the base
        ends = np.array([scanner_T_base[:3, 3], points, np.zeros(3)])
        middle = 0.5 * (ends.min(axis=0) + ends.max(axis=0))
        reach = ARM_SHARE * reach_mm(robot)
        return middle, max(float(np.linalg.norm(ends - middle, axis=1).max()), reach)
    arm = scanner_T_base[None, :3, 3] if shape is None else shape.base_T_link[:, :3, 3]
    around = np.vstack([scanner_T_base[:3, 3], arm, points - radius, points + radius])
    middle = 0.5 * (around.min(axis=0) + around.max(axis=0))
    of_points = float(np.linalg.norm(points - middle)) + radius
    return middle, max(of_points, float(np.linalg.norm(arm - middle, axis=1).max()))


CELL_MM, SECTION_MM = 100.0, 500.0
LENGTHS_MM = (10, 20, 50, 100, 200, 500, 1000, 2000, 5000)
BAR_SHARE = 0.4  # of the field's radius: the longest that a bar may be
TICK_SHARE = 0.08  # of the bar


def draw_floor(scene: SceneView, scanner_T_base: Array | None, reach_mm: float) -> None:
    """Draw the x-y plane of the base up to the arm's reach; nothing before the base's place is known."""
    half_mm = SECTION_MM * max(1.0, float(np.ceil(reach_mm / SECTION_MM)))

    def make(pen: Pen) -> Nodes:
        if scanner_T_base is None:
            return []
        wxyz, position = pose_of(scanner_T_base)
        size = 2.0 * half_mm * M_PER_MM
        return [
            pen.api.add_grid(
                pen.of("grid"), width=size, height=size, plane="xy", cell_size=CELL_MM * M_PER_MM,
                section_size=SECTION_MM * M_PER_MM, cell_color=rgb(MEASURE), section_color=rgb(MEASURE),
                cell_thickness=0.4, section_thickness=0.9, shadow_opacity=0.0, wxyz=wxyz, position=position,
            )
        ]  # fmt: skip

    key = None if scanner_T_base is None else (scanner_T_base.tobytes(), half_mm)
    scene.draw("floor", make, key=key)


def draw_scale(scene: SceneView, middle_mm: Array, along: Array, up: Array, field_mm: float) -> None:
    """Draw a bar of known length about a middle (3,); `along` and `ticks` are unit vectors (3,)."""
    length_mm = max((length for length in LENGTHS_MM if length <= BAR_SHARE * field_mm), default=LENGTHS_MM[0])
    ends = middle_mm + 0.5 * length_mm * np.outer([-1.0, 1.0], along)
    ticks = [np.stack([end, end + TICK_SHARE * length_mm * up]) for end in ends]
    scene.draw(
        "scale",
        lambda pen: [
            pen.lines("bar", np.stack([ends, *ticks]), rgb(MEASURE), 3.0),
            pen.label("label", scale_words(length_mm), middle_mm, "top-center", 0.8),
        ],
        key=(ends.tobytes(), up.tobytes()),
    )


def scale_words(length_mm: int) -> str:
    """Label of the bar: "100 mm", "2 m"."""
    return f"{length_mm} mm" if length_mm < 1000 else f"{length_mm // 1000} m"
