"""Drawing of a plan: planned places of the jig, lines of sight, the scanner's field, the arm at one planned pose."""

from __future__ import annotations

import numpy as np

from calib import frames
from calib.array_types import Array, ByteArray
from calib.calibration.evaluation import scanner_T_base_of_poses
from calib.calibration.model_versions import Version
from calib.dataset.dataset import Poses
from calib.workcell.scan_field import BoxField, ScanField
from inspector.markup.parts.palette import GOOD, HIGHLIGHT, MEASURE, rgb
from inspector.scene.arm_shape import ArmShape, arm_shape
from inspector.scene.draw_model import Solids, arm_nodes
from inspector.scene.scene_view import Nodes, Pen, SceneView, frustum_edges
from inspector.session.planned import Planned
from inspector.session.view import View

PLAN = "plan"  # the layer
_POINT_MM = 14.0


class PlanDrawing:
    """Drawing of planned poses in the frame of the scanner that is to measure them."""

    def __init__(self, scene: SceneView) -> None:
        self._scene = scene
        self._solids = Solids(lambda joint: None)

    def draw(self, view: View, planned: Planned | None) -> None:
        """Draw a plan; nothing for None, or where the scanner has another place at the pose on show."""
        version = view.version
        setup = str(view.session.dataset.poses.setup[view.pose])
        if planned is None or version is None or setup != planned.plan.start.setup:
            self._scene.clear(PLAN)
            self._solids = Solids(lambda joint: None)
            return
        plan, placed = planned.plan, planned.scanner_T_base
        at_mm = frames.apply(placed, version.model.predict(version.x, plan.poses))
        k = planned.pose
        shape = None if k is None else _planned_arm(version, plan.poses, k)
        edges_mm = field_edges(plan.start.cell.field)

        def make(pen: Pen) -> Nodes:
            colours = _colours(len(at_mm), k)
            rays = np.stack([np.zeros_like(at_mm), at_mm], axis=1)
            nodes = [
                pen.points("points", at_mm, colours, _POINT_MM),
                pen.lines("rays", rays, np.repeat(colours[:, None], 2, axis=1)),
                *([] if k is None else [pen.label("label", f"{plan.poses.ids[k]}, planned", at_mm[k])]),
                *([pen.lines("field", edges_mm, rgb(MEASURE))] if len(edges_mm) else []),
            ]
            if shape is None or k is None:
                return nodes
            of_arm = Pen(pen.api, pen.of("arm"))
            return [*nodes, *arm_nodes(of_arm, self._solids, shape, GOOD, all_in=GOOD)]

        self._scene.draw(PLAN, make)
        if shape is None:
            self._solids = Solids(lambda joint: None)


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
    if isinstance(field, ScanField):
        return frustum_edges(field.corners_mm)
    around, ends = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), np.array([field.low_mm, field.high_mm])
    corners = [[[ends[i, 0], ends[j, 1], end[2]] for i, j in around] for end in ends]
    return frustum_edges(np.array(corners))[:-4]  # without lines of sight
