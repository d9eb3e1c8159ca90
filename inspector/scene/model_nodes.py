"""What arm, predictions and the jig's model look like: nodes for `SceneView.draw`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import viser
import viser.transforms

from calib.array_types import Array, ByteArray, IndexArray
from inspector.markup.parts.palette import ARM, JOINT, SLIDE, rgb
from inspector.scene.arm_shape import ArmShape
from inspector.scene.link_mesh import LinkMesh
from inspector.scene.scene_view import M_PER_MM, cloud, to_scene
from inspector.scene.shapes import facing, unit_cylinder, unit_sphere

AXIS_MM = 150.0  # length of the base's axes
PARTS = {"revolute": JOINT, "prismatic": SLIDE, "link": ARM}


@dataclass
class Solids:
    """The nodes of an arm's cylinders and balls, kept from pose to pose: those of one arm only change place.

    Adding a batch again under its name makes pages build it anew, and now and then they then draw nothing of it.
    """

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
    ) -> list[viser.SceneNodeHandle]:
        """K of a shape (vertices, faces) at wxyz (K, 4), places (K, 3), scaled (K, 3), in colours (K, 3)."""
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
        return [self.nodes[name]]


def arm(
    api: viser.SceneApi,
    name: str,
    solids: Solids,
    shape: ArmShape,
    tool_colour: str,
    text: str,
    meshed: Sequence[int] = (),
) -> list[viser.SceneNodeHandle]:
    """The solids of an arm in the scanner's frame, without the links that are drawn as meshes; a label at its tip.

    All cylinders are one node and all balls another: another pose costs a few hundred numbers.
    """
    shown = ~np.isin(shape.link, meshed)
    along = (shape.end_mm - shape.start_mm)[shown]
    length, radius = np.linalg.norm(along, axis=1), shape.radius_mm[shown]
    colours = [rgb(PARTS.get(str(part), tool_colour)) for part in shape.part[shown]]
    balls = ~np.isin(shape.ball_link, meshed)
    size = np.repeat(shape.ball_radius_mm[balls][:, None], 3, axis=1)
    return [
        *solids.put(
            api, f"{name}/cylinders", unit_cylinder(), facing(along / length[:, None]),
            0.5 * (shape.start_mm + shape.end_mm)[shown], np.stack([radius, radius, length], axis=1),
            np.array(colours, dtype=np.uint8).reshape(-1, 3),
        ),
        *solids.put(
            api, f"{name}/balls", unit_sphere(10, 16), np.tile([1.0, 0, 0, 0], (len(size), 1)),
            shape.ball_mm[balls], size, np.tile(np.array(rgb(ARM), dtype=np.uint8), (len(size), 1)),
        ),
        api.add_label(
            f"{name}/label", text, position=tuple(to_scene(shape.tip_mm).astype(float)), font_screen_scale=0.85,
            anchor="top-center",
        ),
    ]  # fmt: skip


def base(api: viser.SceneApi, name: str, scanner_T_base: Array) -> list[viser.SceneNodeHandle]:
    """The axes of the robot's base, x red, y green, z blue."""
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
    """wxyz (4,) and position (3,) in the scene's unit of a transform (4, 4) in mm."""
    wxyz = viser.transforms.SO3.from_matrix(transform[:3, :3]).wxyz
    return np.asarray(wxyz, dtype=float), to_scene(transform[:3, 3]).astype(np.float64)


def link_mesh(api: viser.SceneApi, name: str, mesh: LinkMesh) -> viser.MeshHandle:
    """A link that has a mesh, in its own frame."""
    return api.add_mesh_simple(
        name, to_scene(mesh.vertices_mm), mesh.triangles.astype(np.uint32), color=rgb(ARM), side="double",
        cast_shadow=False, receive_shadow=False,
    )  # fmt: skip


def predicted(
    api: viser.SceneApi,
    name: str,
    points_mm: Mapping[str, Array],
    colours: Mapping[str, str],
    size_mm: float,
) -> list[viser.SceneNodeHandle]:
    """The predicted points (M, 3) of each model, in its colour."""
    return [
        cloud(api, f"{name}/{number}", points_mm[model], rgb(colours[model]), size_mm)
        for number, model in enumerate(points_mm)
        if len(points_mm[model])
    ]


def residuals(
    api: viser.SceneApi,
    name: str,
    arrows_mm: Array,
    colours: ByteArray,
    size_mm: float,
    text: str,
    at_mm: Array,
) -> list[viser.SceneNodeHandle]:
    """Arrows (K, 2, 3) from measured to predicted, in colours (K, 3), and what they are in words."""
    if not len(arrows_mm):
        return []
    size = size_mm * M_PER_MM
    return [
        api.add_arrows(
            f"{name}/arrows", to_scene(arrows_mm), colours, shaft_radius=size, head_radius=2.5 * size,
            head_length=5.0 * size,
        ),
        api.add_label(
            f"{name}/label", text, position=tuple(to_scene(at_mm).astype(float)), font_screen_scale=0.85,
            anchor="bottom-center",
        ),
    ]  # fmt: skip


def jig(
    api: viser.SceneApi, name: str, triangles_mm: Array, colours: Sequence[str]
) -> list[viser.SceneNodeHandle]:
    """The jig's model: a translucent triangle (3, 3) for each face, in the face's colour, with its outline."""
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
