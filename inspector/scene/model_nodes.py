"""Nodes of arm, predictions and the jig's model, for `SceneView.draw`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import viser
import viser.transforms

from calib.array_types import Array, ByteArray, IndexArray
from calib.workcell.bodies.link_mesh import LinkMesh
from inspector.markup.parts.palette import ARM, HIGHLIGHT, JOINT, SLIDE, rgb
from inspector.scene.arm_shape import ArmShape
from inspector.scene.scene_view import M_PER_MM, cloud, to_scene
from inspector.scene.shapes import facing, unit_cylinder, unit_sphere

AXIS_MM = 150.0  # length of the base's axes
AXIS_OVER = 1.2  # of a joint's length: how far the selected one's axis stands out on either side
TOUCH = 3.0  # of what is drawn: how much wider is what takes its clicks, which is not seen
UNSEEN = 0.004  # opacity: what is not drawn at all takes no clicks
LabelAnchor = Literal["top-center", "bottom-center", "bottom-left"]
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
        api: viser.SceneApi,
        name: str,
        shape: tuple[Array, IndexArray],
        wxyz: Array,
        at_mm: Array,
        size_mm: Array,
        colours: ByteArray,
        links: Sequence[int],
    ) -> list[viser.SceneNodeHandle]:
        """Show K copies of a mesh at wxyz (K, 4), places (K, 3), scales (K, 3), colours (K, 3), links (K,)."""
        self.links[name] = links
        node = self.nodes.get(name)
        if node is not None and len(np.reshape(node.batched_positions, (-1, 3))) == len(at_mm):
            node.batched_wxyzs, node.batched_positions = wxyz.astype(np.float32), to_scene(at_mm)
            node.batched_scales, node.batched_colors = to_scene(size_mm), colours
            return [node]
        self.nodes.pop(name, None)
        if not len(at_mm):
            return []
        self.nodes[name] = api.add_batched_meshes_simple(
            name, *shape, wxyz, to_scene(at_mm), batched_scales=to_scene(size_mm), batched_colors=colours,
            lod="off", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        self.nodes[name].on_click(lambda event: self._clicked(name, event.instance_index))
        return [self.nodes[name]]

    def _clicked(self, name: str, instance: int | None) -> None:
        links = self.links[name]
        if instance is not None and 0 <= instance < len(links) and links[instance] < self.joints:
            self.on_joint(links[instance] + 1)


def arm(
    api: viser.SceneApi,
    name: str,
    solids: Solids,
    shape: ArmShape,
    tool_colour: str,
    text: str,
    meshed: Sequence[int] = (),
    selected: int | None = None,
    all_in: str = "",
) -> list[viser.SceneNodeHandle]:
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
            api, f"{name}/cylinders", unit_cylinder(), facing(along / length[:, None]),
            0.5 * (shape.start_mm + shape.end_mm)[shown], np.stack([radius, radius, length], axis=1),
            np.array(colours, dtype=np.uint8).reshape(-1, 3), link.tolist(),
        ),
        *solids.put(
            api, f"{name}/balls", unit_sphere(10, 16), np.tile([1.0, 0, 0, 0], (len(size), 1)),
            shape.ball_mm[balls], size, np.tile(np.array(rgb(all_in or ARM), dtype=np.uint8), (len(size), 1)),
            shape.ball_link[balls].tolist(),
        ),
        *([tip_label(api, name, text, shape.tip_mm)] if text else []),
    ]  # fmt: skip


def tip_label(
    api: viser.SceneApi, name: str, text: str, at_mm: Array, anchor: LabelAnchor = "top-center"
) -> viser.LabelHandle:
    """Node of words at a place (3,)."""
    place = tuple(to_scene(at_mm).astype(float))
    return api.add_label(f"{name}/label", text, position=place, font_screen_scale=0.85, anchor=anchor)


def joint_axis(api: viser.SceneApi, name: str, shape: ArmShape, joint: int | None) -> list[viser.SceneNodeHandle]:
    """Nodes of the selected joint's axis and name, joints counted from 0; nothing where none is selected."""
    at = np.flatnonzero((shape.link == joint) & np.isin(shape.part, ("revolute", "prismatic")))
    if joint is None or not len(at):
        return []
    start, end = shape.start_mm[at[0]], shape.end_mm[at[0]]
    reach = AXIS_OVER * (end - start)
    return [
        api.add_line_segments(
            f"{name}/axis", to_scene(np.array([[start - reach, end + reach]])), rgb(HIGHLIGHT), thickness=3.0,
            thickness_units="screen",
        ),
        api.add_label(
            f"{name}/axis_label", f"joint {joint + 1}", position=tuple(to_scene(end + reach).astype(float)),
            font_screen_scale=0.85, anchor="bottom-left",
        ),
    ]  # fmt: skip


def base(api: viser.SceneApi, name: str, scanner_T_base: Array) -> list[viser.SceneNodeHandle]:
    """Nodes of the axes of the robot's base: x red, y green, z blue."""
    wxyz, position = pose_of(scanner_T_base)
    return [
        api.add_frame(
            f"{name}/base", axes_length=AXIS_MM * M_PER_MM, axes_radius=3.0 * M_PER_MM, wxyz=wxyz, position=position
        ),
        api.add_label(
            f"{name}/base_label", "base", position=tuple(position), font_screen_scale=0.8, anchor="top-center"
        ),
    ]  # fmt: skip


def pose_of(transform: Array) -> tuple[Array, Array]:
    """Quaternion wxyz (4,) and position (3,) in the scene's unit of a transform (4, 4) in mm."""
    wxyz = viser.transforms.SO3.from_matrix(transform[:3, :3]).wxyz
    return np.asarray(wxyz, dtype=float), to_scene(transform[:3, 3]).astype(np.float64)


def link_mesh(api: viser.SceneApi, name: str, mesh: LinkMesh, on_click: Callable[[], None]) -> viser.MeshHandle:
    """Node of a link's mesh in the link's own frame."""
    handle = api.add_mesh_simple(
        name, to_scene(mesh.vertices_mm), mesh.triangles.astype(np.uint32), color=rgb(ARM), side="double",
        cast_shadow=False, receive_shadow=False,
    )  # fmt: skip
    handle.on_click(lambda _: on_click())
    return handle


def predicted(
    api: viser.SceneApi,
    name: str,
    points_mm: Mapping[str, Array],
    colours: Mapping[str, str],
    size_mm: float,
    on_click: Callable[[int], None],
) -> list[viser.SceneNodeHandle]:
    """Nodes of the predicted points (M, 3) of each model in its colour, selectable by click."""
    everything = np.concatenate(list(points_mm.values()))
    size = np.full((len(everything), 3), TOUCH / 2 * size_mm)
    upright = np.tile([1.0, 0, 0, 0], (len(everything), 1))
    return [
        *(
            cloud(api, f"{name}/{number}", points_mm[model], rgb(colours[model]), size_mm)
            for number, model in enumerate(points_mm)
            if len(points_mm[model])
        ),
        touched(api, f"{name}/touch", unit_sphere(6, 8), upright, everything, size, on_click),
    ]


def touched(
    api: viser.SceneApi,
    name: str,
    shape: tuple[Array, IndexArray],
    wxyz: Array,
    at_mm: Array,
    size_mm: Array,
    on_click: Callable[[int], None],
) -> viser.SceneNodeHandle:
    """K invisible solids that receive clicks in place of points and arrows, which cannot receive them."""
    node = api.add_batched_meshes_simple(
        name, *shape, wxyz, to_scene(at_mm), batched_scales=to_scene(size_mm), opacity=UNSEEN, lod="off",
        cast_shadow=False, receive_shadow=False,
    )  # fmt: skip

    @node.on_click
    def _(event: viser.SceneNodePointerEvent[viser.BatchedMeshHandle]) -> None:
        if event.instance_index is not None and 0 <= event.instance_index < len(at_mm):
            on_click(event.instance_index)

    return node


def residuals(
    api: viser.SceneApi,
    name: str,
    arrows_mm: Array,
    colours: ByteArray,
    size_mm: float,
    text: str,
    at_mm: Array,
    on_click: Callable[[int], None],
    lengths: Sequence[tuple[Array, str]] = (),
) -> list[viser.SceneNodeHandle]:
    """Nodes of arrows (K, 2, 3) from measured to predicted points, in colours (K, 3), clickable, with a legend.

    lengths: places (3,) of arrows whose true lengths stand beside them.
    """
    if not len(arrows_mm):
        return []
    size = size_mm * M_PER_MM
    along = arrows_mm[:, 1] - arrows_mm[:, 0]
    length = np.linalg.norm(along, axis=1)
    width = np.full_like(length, TOUCH * size_mm)
    return [
        api.add_arrows(
            f"{name}/arrows", to_scene(arrows_mm), colours, shaft_radius=size, head_radius=2.5 * size,
            head_length=5.0 * size,
        ),
        touched(
            api, f"{name}/touch", unit_cylinder(), facing(along / length[:, None]), arrows_mm.mean(axis=1),
            np.stack([width, width, length], axis=1), on_click,
        ),
        api.add_label(
            f"{name}/label", text, position=tuple(to_scene(at_mm).astype(float)), font_screen_scale=0.85,
            anchor="bottom-center",
        ),
        *(
            api.add_label(
                f"{name}/length{number}", length, position=tuple(to_scene(tip_mm).astype(float)),
                font_screen_scale=0.75, anchor="bottom-center",
            )
            for number, (tip_mm, length) in enumerate(lengths)
        ),
    ]  # fmt: skip


def jig(api: viser.SceneApi, name: str, triangles_mm: Array, colours: Sequence[str]) -> list[viser.SceneNodeHandle]:
    """Nodes of the jig's model: a translucent triangle (3, 3) for each face, in the face's colour, with its outline."""
    nodes: list[viser.SceneNodeHandle] = [
        api.add_mesh_simple(
            f"{name}/face{number}", to_scene(triangle), np.array([[0, 1, 2]], dtype=np.uint32), color=rgb(colour),
            opacity=0.28, side="double", cast_shadow=False, receive_shadow=False,
        )
        for number, (triangle, colour) in enumerate(zip(triangles_mm, colours, strict=True))
    ]  # fmt: skip
    if len(triangles_mm):
        loop = np.stack([triangles_mm, np.roll(triangles_mm, -1, axis=1)], axis=2).reshape(-1, 2, 3)
        nodes.append(
            api.add_line_segments(
                f"{name}/outline", to_scene(loop), (120, 125, 135), thickness=1.5, thickness_units="screen"
            )
        )
    return nodes
