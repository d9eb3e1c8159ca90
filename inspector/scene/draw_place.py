"""Drawing of a place that is tried: a control to drag the tool, the arm there, its error as delivered as an arrow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import viser
import viser.transforms

from calib import frames
from calib.array_types import Array
from calib.compensation.tool_place import ToolPlace
from calib.rendering import numbers
from calib.workcell.bodies.arm_bodies import reach_mm
from inspector.markup.parts.palette import FAILED, MODEL_COLOURS, PROPOSAL, rgb
from inspector.scene import model_nodes
from inspector.scene.arm_shape import arm_shape
from inspector.scene.scene_view import M_PER_MM, SceneView, to_scene

PLACE = "place"  # the layer
CANNOT = "cannot be reached"
_CONTROL_SHARE = 0.22  # of the arm's reach: size of the control
_ARROW_SHARE = 0.005  # of the arm's reach: radius of the arrow
_THICKER = 1.04  # than the arm itself, which this one hides where both stand alike

Moved = Callable[[Array, bool], None]
"""Told of the tool's frame scanner_T_tool (4, 4), mm, while it is dragged, and whether it was let go."""


class PlaceDrawing:
    """Drawing of the tool at a tried place; the control stays where the user holds it."""

    def __init__(self, scene: SceneView, on_moved: Moved) -> None:
        self._scene, self._on_moved = scene, on_moved
        self._solids = model_nodes.Solids(lambda joint: None)
        self._control: viser.TransformControlsHandle | None = None

    def clear(self) -> None:
        """Remove the control and what was drawn with it."""
        if self._control is not None:
            self._scene.draw(PLACE, lambda api, name: [])
            self._solids, self._control = model_nodes.Solids(lambda joint: None), None

    def draw(self, place: ToolPlace, scanner_T_tool: Array, scanner_T_base: Array, enlarged: float) -> None:
        """Draw the arm at a place, and its error there as delivered, `enlarged` times, from the tool point."""
        calibration, error = place.calibration, place.error
        shape = arm_shape(calibration.model, calibration.fit.x, place.poses, 0).moved(scanner_T_base)
        shape = replace(shape, radius_mm=_THICKER * shape.radius_mm, ball_radius_mm=_THICKER * shape.ball_radius_mm)
        reach = reach_mm(calibration.dataset.robot)
        text, said_at = CANNOT, scanner_T_tool[:3, 3]
        arrows = np.zeros((0, 2, 3))
        if error is not None:
            length = numbers.with_sigma(float(error.length_mm[0]), float(error.sigma_mm[0]), "mm")
            text = f"as delivered off by {length}, arrow × {enlarged:g}"
            along = scanner_T_base[:3, :3] @ error.error_mm[0]
            said_at = shape.tip_mm + enlarged * along
            arrows = np.array([[shape.tip_mm, said_at]])

        def make(api: viser.SceneApi, name: str) -> list[viser.SceneNodeHandle]:
            if self._control is None:
                self._control = self._controlled(api, f"{name}/control", scanner_T_tool, place, reach)
            colour = FAILED if error is None else PROPOSAL
            nodes = model_nodes.arm(api, f"{name}/arm", self._solids, shape, colour, "", all_in=colour)
            nodes.append(model_nodes.tip_label(api, name, text, said_at, "bottom-center"))
            if len(arrows):
                radius = _ARROW_SHARE * reach * M_PER_MM
                nodes.append(
                    api.add_arrows(
                        f"{name}/error", to_scene(arrows), rgb(MODEL_COLOURS["nominal"]), shaft_radius=radius,
                        head_radius=2.5 * radius, head_length=5.0 * radius,
                    )
                )  # fmt: skip
            return [self._control, *nodes]

        self._scene.draw(PLACE, make)

    def _controlled(
        self, api: viser.SceneApi, name: str, scanner_T_tool: Array, place: ToolPlace, reach: float
    ) -> viser.TransformControlsHandle:
        wxyz, position = model_nodes.pose_of(scanner_T_tool)
        control = api.add_transform_controls(
            name, scale=_CONTROL_SHARE * reach * M_PER_MM, disable_rotations=not place.has_attitude, depth_test=False,
            wxyz=wxyz, position=position,
        )  # fmt: skip

        # Not a plain function, which viser calls on several threads: a release could be overtaken by a move.
        @control.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            frame = tool_frame_of(event.target)
            if frame is not None:
                self._on_moved(frame, event.phase == "end")

        return control


def tool_frame_of(control: viser.TransformControlsHandle) -> Array | None:
    """Frame (4, 4), mm, at which a control stands; None where a page sent what is no frame."""
    wxyz, place = np.asarray(control.wxyz, dtype=float), np.asarray(control.position, dtype=float)
    if wxyz.shape != (4,) or place.shape != (3,) or not np.isfinite([*wxyz, *place]).all() or not np.any(wxyz):
        return None
    rotation = viser.transforms.SO3(wxyz / np.linalg.norm(wxyz)).as_matrix()
    return frames.make_transform(np.asarray(rotation, dtype=float), place / M_PER_MM)
