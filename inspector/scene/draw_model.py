"""Drawing of the model: the arm, its versions' predictions, and the jig's model over the scan."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import viser

from calib.array_types import Array, ByteArray
from calib.corners.jig_distance import face_distances, jig_outline
from calib.dataset.dataset import Dataset
from calib.errors import CalibError
from calib.scans.scan import Scan
from calib.workcell.bodies.link_mesh import load_link_mesh
from inspector.markup.legend import distance_limit_mm, error_limit_mm
from inspector.markup.parts import colour_scale
from inspector.markup.parts.palette import ARM, FACE_COLOURS, HIGHLIGHT, LEFT_OUT, MODEL_COLOURS, rgb, role_colour
from inspector.scene import model_nodes
from inspector.scene.arm_shape import arm_of
from inspector.scene.scene_view import Nodes, Pen, SceneView, to_scene
from inspector.scene.shapes import loops
from inspector.session.view import BY_ERROR, View


def pose_colours(view: View) -> ByteArray:
    """Colour (N, 3) of each pose's measured point, by role or error; poses selected by a box have one of their own."""
    poses = range(len(view.session.dataset.poses))
    if view.colouring == BY_ERROR and view.version is not None:
        colours = colour_scale.coloured(view.version.pose_errors_mm(), 0.0, error_limit_mm(view), colour_scale.ERROR)
    else:
        colours = np.array([rgb(pose_colour(view, pose)) for pose in poses], dtype=np.uint8)
    colours[list(view.boxed)] = rgb(HIGHLIGHT)
    return colours


def pose_colour(view: View, pose: int) -> str:
    """Colour of a pose's role; grey where the pose is left out."""
    poses = view.session.dataset.poses
    return LEFT_OUT if poses.ids[pose] in view.session.uncounted else role_colour(str(poses.role[pose]))


# ---- the arm --------------------------------------------------------------------------------------------------------


class ArmDrawing:
    """Drawing of the arm at the selected pose; meshes are sent once per dataset and then only moved.

    on_joint: told of a click on a joint or its link, counted from 1.
    """

    def __init__(self, scene: SceneView, on_joint: Callable[[int], None]) -> None:
        self._scene, self._on_joint = scene, on_joint
        self._of: object = None  # what the meshes were loaded for
        self._meshes: dict[int, viser.MeshHandle] = {}  # by joint
        self._solids = model_nodes.Solids(on_joint)
        self.problems: tuple[str, ...] = ()  # meshes that cannot be drawn, and why

    def draw(self, view: View) -> None:
        """Draw the chosen version's arm at the pose where that version places it in the scanner's frame."""
        version = view.version
        arm = None if version is None else arm_of(version, view.pose)
        # A placement of the scanner of which every pose is left out has no frame.
        if version is None or arm is None:
            self._scene.clear("arm")
            self._of, self._meshes, self._solids = None, {}, model_nodes.Solids(self._on_joint)
            return
        dataset = view.session.dataset
        placed = version.scanner_T_base[view.pose]
        text = f"{view.pose_id}, {version.name}"

        def make(pen: Pen) -> Nodes:
            self._load(pen, dataset)
            for joint, handle in self._meshes.items():
                handle.wxyz, handle.position = model_nodes.pose_of(arm.base_T_link[joint])
                handle.color = rgb(HIGHLIGHT if joint == view.joint else ARM)
            colour, meshed = MODEL_COLOURS[version.name], tuple(self._meshes)
            return [
                *model_nodes.arm(pen, self._solids, arm, colour, text, meshed, view.joint),
                *model_nodes.joint_axis(pen, arm, view.joint),
                *model_nodes.base(pen, placed),
                *self._meshes.values(),
            ]

        self._scene.draw("arm", make)

    def _load(self, pen: Pen, dataset: Dataset) -> None:
        if self._of is dataset.robot:
            return
        self._of, self._meshes, problems = dataset.robot, {}, []
        for joint in range(dataset.robot.n_joints):
            try:
                mesh = load_link_mesh(dataset, joint)
            except CalibError as error:
                problems.append(str(error))
                continue
            if mesh is not None:
                clicked = partial(self._on_joint, joint + 1)
                self._meshes[joint] = model_nodes.link_mesh(pen, f"mesh{joint}", mesh, clicked)
        self.problems = tuple(problems)


# ---- the jig over the scan ------------------------------------------------------------------------------------------


def jig_distances(view: View, scan: Scan | None) -> Array | None:
    """Signed distance (N,), mm, of a scan's points to the jig's faces, NaN off the jig; None without a corner."""
    corner = None if view.search is None else view.search.corner
    if scan is None or corner is None:
        return None
    return face_distances(scan.points_mm, corner, view.session.dataset.jig)[0]


def draw_jig(scene: SceneView, view: View) -> None:
    """Draw the jig's model at the corner that was found: a translucent triangle a face, with its outline."""
    corner = None if view.search is None else view.search.corner
    if corner is None:
        scene.clear("jig")
        return
    triangles_mm = jig_outline(corner, view.session.dataset.jig)
    scene.draw(
        "jig",
        lambda pen: [
            *(
                pen.api.add_mesh_simple(
                    pen.of(f"face{k}"), to_scene(triangle), np.array([[0, 1, 2]], dtype=np.uint32), color=rgb(colour),
                    opacity=0.28, side="double", cast_shadow=False, receive_shadow=False,
                )
                for k, (triangle, colour) in enumerate(zip(triangles_mm, FACE_COLOURS * 2, strict=False))
            ),
            *([pen.lines("outline", loops(triangles_mm), (120, 125, 135))] if len(triangles_mm) else []),
        ],
    )  # fmt: skip


def draw_distance(scene: SceneView, scan: Scan | None, distances_mm: Array | None) -> None:
    """Draw the scan's points on the jig, coloured by their distance to its faces."""
    if scan is None or distances_mm is None:
        scene.draw_distance(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.uint8))
        return
    on_jig = np.isfinite(distances_mm)
    limit = distance_limit_mm(distances_mm)
    colours = colour_scale.coloured(distances_mm[on_jig], -limit, limit, colour_scale.SIGNED)
    scene.draw_distance(scan.points_mm[on_jig], colours)
