"""Nodes of the arm, for `SceneView.draw`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import viser
import viser.transforms

from calib.array_types import Array, ByteArray, IndexArray
from calib.workcell.bodies.link_mesh import LinkMesh
from inspector.markup.parts.palette import ARM, HIGHLIGHT, JOINT, SLIDE, rgb
from inspector.scene.arm_shape import ArmShape
from inspector.scene.scene_view import M_PER_MM, Nodes, Pen, to_scene
from inspector.scene.shapes import facing, unit_cylinder, unit_sphere, upright

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


def arm(
    pen: Pen,
    solids: Solids,
    shape: ArmShape,
    tool_colour: str,
    text: str,
    meshed: Sequence[int] = (),
    selected: int | None = None,
    all_in: str = "",
) -> Nodes:
    """Nodes of an arm's solids in the scanner's frame, except links drawn as meshes, with words at the tip, if any.

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
        *([pen.label("label", text, shape.tip_mm, "top-center")] if text else []),
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


def base(pen: Pen, scanner_T_base: Array) -> Nodes:
    """Nodes of the axes of the robot's base: x red, y green, z blue."""
    wxyz, position = pose_of(scanner_T_base)
    axes = pen.api.add_frame(
        pen.of("base"), axes_length=AXIS_MM * M_PER_MM, axes_radius=3.0 * M_PER_MM, wxyz=wxyz, position=position
    )
    return [axes, pen.label("base_label", "base", scanner_T_base[:3, 3], "top-center", 0.8)]


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
