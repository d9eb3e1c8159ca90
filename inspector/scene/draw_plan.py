"""Drawing of a plan: planned places of the jig, lines of sight, the scanner's field, the arm at one planned pose."""

from __future__ import annotations

from itertools import product

import numpy as np
import viser

from calib import frames
from calib.array_types import Array, ByteArray
from calib.calibration.evaluation import scanner_T_base_of_poses
from calib.calibration.model_versions import Version
from calib.dataset.dataset import Poses
from calib.workcell.scan_field import BoxField, ScanField
from inspector.markup.parts.palette import GOOD, HIGHLIGHT, MEASURE, rgb
from inspector.scene import model_nodes
from inspector.scene.arm_shape import ArmShape, arm_shape
from inspector.scene.scene_view import SceneView, cloud, to_scene
from inspector.session.planned import Planned
from inspector.session.view import View

PLAN = "plan"  # the layer
_POINT_MM = 14.0


class PlanDrawing:
    """Drawing of planned poses in the frame of the scanner that is to measure them."""

    def __init__(self, scene: SceneView) -> None:
        self._scene = scene
        self._solids = model_nodes.Solids(lambda joint: None)

    def draw(self, view: View, planned: Planned | None) -> None:
        """Draw a plan; nothing for None, or where the scanner has another place at the pose on show."""
        version = view.version
        setup = str(view.session.dataset.poses.setup[view.pose])
        if planned is None or version is None or setup != planned.plan.start.setup:
            self._scene.draw(PLAN, lambda api, name: [])
            self._solids = model_nodes.Solids(lambda joint: None)
            return
        plan, placed = planned.plan, planned.scanner_T_base
        at_mm = frames.apply(placed, version.model.predict(version.x, plan.poses))
        k = planned.pose
        shape = None if k is None else _planned_arm(version, plan.poses, k)
        edges_mm = field_edges(plan.start.cell.field)

        def make(api: viser.SceneApi, name: str) -> list[viser.SceneNodeHandle]:
            rays = np.stack([np.zeros_like(at_mm), at_mm], axis=1)
            nodes: list[viser.SceneNodeHandle] = [
                cloud(api, f"{name}/points", at_mm, _colours(len(at_mm), k), _POINT_MM),
                api.add_line_segments(
                    f"{name}/rays", to_scene(rays), np.repeat(_colours(len(at_mm), k)[:, None], 2, axis=1),
                    thickness=1.5, thickness_units="screen",
                ),
                *(
                    api.add_label(
                        f"{name}/label{i}", text, position=tuple(to_scene(point).astype(float)),
                        font_screen_scale=0.75, anchor="bottom-center",
                    )
                    for i, (text, point) in enumerate(zip(plan.poses.ids, at_mm, strict=True))
                ),
            ]  # fmt: skip
            if len(edges_mm):
                nodes.append(
                    api.add_line_segments(
                        f"{name}/field", to_scene(edges_mm), rgb(MEASURE), thickness=1.5, thickness_units="screen"
                    )
                )
            if shape is not None and k is not None:
                text = f"{plan.poses.ids[k]}, planned"
                nodes += model_nodes.arm(api, f"{name}/arm", self._solids, shape, GOOD, text, all_in=GOOD)
            return nodes

        self._scene.draw(PLAN, make)
        if shape is None:
            self._solids = model_nodes.Solids(lambda joint: None)


def _planned_arm(version: Version, poses: Poses, pose: int) -> ArmShape:
    """Solids of the arm at a planned pose, in the frame of the scanner that measures it there."""
    placed = scanner_T_base_of_poses(version.evaluation, version.model, version.x, poses)[pose]
    scanner_T_flange = version.evaluation.scanner_T_base[str(poses.setup[pose])]
    carried = frames.invert(scanner_T_flange) if version.model.robot.carries_scanner else None
    return arm_shape(version.model, version.x, poses, pose, carried).moved(placed)


def _colours(count: int, selected: int | None) -> ByteArray:
    colours = np.tile(np.array(rgb(GOOD), dtype=np.uint8), (count, 1))
    if selected is not None:
        colours[selected] = rgb(HIGHLIGHT)
    return colours


def field_edges(field: ScanField | BoxField | None) -> Array:
    """Edges (K, 2, 3) of the scanner's field, in the scanner's frame; for a camera with its lines of sight."""
    if field is None:
        return np.zeros((0, 2, 3))
    sides = np.array(list(product((0, 1), repeat=3)))  # (8, 3)
    pairs = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.sum(sides[a] != sides[b]) == 1]
    if isinstance(field, BoxField):
        corners = np.where(sides == 1, field.high_mm, field.low_mm)
        return np.array([[corners[a], corners[b]] for a, b in pairs])
    depth_mm = field.distance_mm + field.depth_mm * (sides[:, 2] - 0.5)
    half_mm = 0.5 * np.array([field.width_mm, field.height_mm])
    across = (np.where(sides[:, :2] == 1, half_mm, -half_mm) + np.array(field.middle_mm)) / field.distance_mm
    corners = np.column_stack([across * depth_mm[:, None], depth_mm])
    sight = [[np.zeros(3), corner] for corner, side in zip(corners, sides, strict=True) if side[2] == 0]
    return np.array([*([corners[a], corners[b]] for a, b in pairs), *sight])
