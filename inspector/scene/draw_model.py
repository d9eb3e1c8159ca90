"""Drawing of the model: the arm, its versions' predictions, and the jig's model over the scan."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import viser
import viser.transforms

from calib.array_types import Array, ByteArray, IndexArray
from calib.corners.jig_distance import face_distances, jig_outline
from calib.dataset.dataset import Dataset
from calib.errors import CalibError
from calib.scans.scan import Scan
from calib.served_process import within_limits
from calib.workcell.bodies.link_mesh import LinkMesh, load_link_mesh
from inspector.markup.legend import distance_limit_mm
from inspector.markup.parts import colour_scale
from inspector.markup.parts.palette import (
    ARM,
    FACE_COLOURS,
    HIGHLIGHT,
    JOINT,
    LEFT_OUT,
    MODEL_COLOURS,
    SLIDE,
    rgb,
    role_colour,
)
from inspector.scene.arm_shape import ArmShape, arm_of
from inspector.scene.scene_view import M_PER_MM, Nodes, Pen, SceneView, to_scene
from inspector.scene.shapes import facing, loops, unit_cylinder, unit_sphere, upright
from inspector.session.view import View

AXIS_MM = 150.0  # length of the base's axes
AXIS_OVER = 1.2  # of a joint's length: how far the selected one's axis stands out on either side
PARTS = {"revolute": JOINT, "prismatic": SLIDE, "link": ARM}


@dataclass
class Solids:
    """Nodes of an arm's cylinders and balls, moved from pose to pose instead of being sent again.

    Adding a batch again under its name makes pages build it anew, and now and then they then draw nothing of it.

    on_joint: told of a click on a solid, by the joint, from 1, that moves it; the tool belongs to none.
    """

    on_joint: Callable[[int], None]
    joints: int = 0
    links: dict[str, Sequence[int]] = field(default_factory=dict)  # of each node's solids
    nodes: dict[str, viser.BatchedMeshHandle] = field(default_factory=dict)

    def put(
        self,
        pen: Pen,
        part: str,
        shape: tuple[Array, IndexArray],
        wxyz: Array,
        at_mm: Array,
        size_mm: Array,
        colours: ByteArray,
        links: Sequence[int],
    ) -> Nodes:
        """Show K copies of a mesh at wxyz (K, 4), places (K, 3), scales (K, 3), colours (K, 3), links (K,)."""
        name = pen.of(part)
        self.links[name] = links
        node = self.nodes.get(name)
        if node is not None and len(np.reshape(node.batched_positions, (-1, 3))) == len(at_mm):
            node.batched_wxyzs, node.batched_positions = wxyz.astype(np.float32), to_scene(at_mm)
            node.batched_scales, node.batched_colors = to_scene(size_mm), colours
            return [node]
        self.nodes.pop(name, None)
        if not len(at_mm):
            return []
        self.nodes[name] = pen.copies(part, shape, wxyz, at_mm, size_mm, colours)
        self.nodes[name].on_click(lambda event: self._clicked(name, event.instance_index))
        return [self.nodes[name]]

    def _clicked(self, name: str, instance: int | None) -> None:
        links = self.links[name]
        if instance is not None and 0 <= instance < len(links) and links[instance] < self.joints:
            self.on_joint(links[instance] + 1)


def arm_nodes(
    pen: Pen,
    solids: Solids,
    shape: ArmShape,
    tool_colour: str,
    meshed: Sequence[int] = (),
    selected: int | None = None,
    all_in: str = "",
) -> Nodes:
    """Nodes of an arm's solids in the scanner's frame, except links drawn as meshes.

    selected: the joint, from 0, that stands out. all_in: one colour for all of it.

    All cylinders are one node and all balls another: another pose costs a few hundred numbers.
    """
    shown = ~np.isin(shape.link, meshed)
    along = (shape.end_mm - shape.start_mm)[shown]
    length, radius = np.linalg.norm(along, axis=1), shape.radius_mm[shown]
    solids.joints = len(shape.base_T_link)
    link = shape.link[shown]
    stands_out = (link == selected) & np.isin(shape.part[shown], ("revolute", "prismatic"))
    colours = [
        rgb(all_in or (HIGHLIGHT if out else PARTS.get(str(part), tool_colour)))
        for part, out in zip(shape.part[shown], stands_out, strict=True)
    ]
    balls = ~np.isin(shape.ball_link, meshed)
    size = np.repeat(shape.ball_radius_mm[balls][:, None], 3, axis=1)
    return [
        *solids.put(
            pen, "cylinders", unit_cylinder(), facing(along / length[:, None]),
            0.5 * (shape.start_mm + shape.end_mm)[shown], np.stack([radius, radius, length], axis=1),
            np.array(colours, dtype=np.uint8).reshape(-1, 3), link.tolist(),
        ),
        *solids.put(
            pen, "balls", unit_sphere(10, 16), upright(len(size)), shape.ball_mm[balls], size,
            np.tile(np.array(rgb(all_in or ARM), dtype=np.uint8), (len(size), 1)), shape.ball_link[balls].tolist(),
        ),
    ]  # fmt: skip


def joint_axis(pen: Pen, shape: ArmShape, joint: int | None) -> Nodes:
    """Nodes of the selected joint's axis and name, joints counted from 0; nothing where none is selected."""
    at = np.flatnonzero((shape.link == joint) & np.isin(shape.part, ("revolute", "prismatic")))
    if joint is None or not len(at):
        return []
    start, end = shape.start_mm[at[0]], shape.end_mm[at[0]]
    reach = AXIS_OVER * (end - start)
    return [
        pen.lines("axis", np.array([[start - reach, end + reach]]), rgb(HIGHLIGHT), 3.0),
        pen.label("axis_label", f"joint {joint + 1}", end + reach, "bottom-left"),
    ]


def base_nodes(pen: Pen, scanner_T_base: Array) -> Nodes:
    """Node of the axes of the robot's base: x red, y green, z blue."""
    wxyz, position = pose_of(scanner_T_base)
    return [
        pen.api.add_frame(
            pen.of("base"), axes_length=AXIS_MM * M_PER_MM, axes_radius=3.0 * M_PER_MM, wxyz=wxyz, position=position
        )
    ]


def pose_of(transform: Array) -> tuple[Array, Array]:
    """Quaternion wxyz (4,) and position (3,) in the scene's unit of a transform (4, 4) in mm."""
    wxyz = viser.transforms.SO3.from_matrix(transform[:3, :3]).wxyz
    return np.asarray(wxyz, dtype=float), to_scene(transform[:3, 3]).astype(np.float64)


def link_mesh(pen: Pen, part: str, mesh: LinkMesh, on_click: Callable[[], None]) -> viser.MeshHandle:
    """Node of a link's mesh in the link's own frame."""
    handle = pen.api.add_mesh_simple(
        pen.of(part), to_scene(mesh.vertices_mm), mesh.triangles.astype(np.uint32), color=rgb(ARM), side="double",
        cast_shadow=False, receive_shadow=False,
    )  # fmt: skip
    handle.on_click(lambda _: on_click())
    return handle


def pose_colours(view: View) -> ByteArray:
    """Colour (N, 3) of each pose's measured point, by role; poses selected by a box have one of their own."""
    poses = range(len(view.session.dataset.poses))
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
        self._solids = Solids(on_joint)
        self.problems: tuple[str, ...] = ()  # meshes that cannot be drawn, and why

    def draw(self, view: View) -> None:
        """Draw the chosen version's arm at the pose where that version places it in the scanner's frame."""
        version = view.version
        arm = None if version is None else arm_of(version, view.pose)
        # A placement of the scanner of which every pose is left out has no frame.
        if version is None or arm is None:
            self._scene.clear("arm")
            self._of, self._meshes, self._solids = None, {}, Solids(self._on_joint)
            return
        dataset = view.session.dataset
        placed = version.scanner_T_base[view.pose]

        def make(pen: Pen) -> Nodes:
            self._load(pen, dataset)
            for joint, handle in self._meshes.items():
                handle.wxyz, handle.position = pose_of(arm.base_T_link[joint])
                handle.color = rgb(HIGHLIGHT if joint == view.joint else ARM)
            colour, meshed = MODEL_COLOURS[version.name], tuple(self._meshes)
            return [
                *arm_nodes(pen, self._solids, arm, colour, meshed, view.joint),
                *joint_axis(pen, arm, view.joint),
                *base_nodes(pen, placed),
                *self._meshes.values(),
            ]

        self._scene.draw("arm", make)

    def _load(self, pen: Pen, dataset: Dataset) -> None:
        if self._of is dataset.robot:
            return
        self._of, self._meshes, problems = dataset.robot, {}, []
        for joint in range(dataset.robot.n_joints):
            try:
                named = dataset.robot.joints[joint].mesh
                mesh = None if named is None else within_limits(named, load_link_mesh, dataset, joint)
            except CalibError as error:
                problems.append(str(error))
                continue
            if mesh is not None:
                clicked = partial(self._on_joint, joint + 1)
                self._meshes[joint] = link_mesh(pen, f"mesh{joint}", mesh, clicked)
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
