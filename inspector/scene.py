"""Draws plain arrays in viser. The only file that turns millimetres into viser's units (metres).

Everything hangs under one frame that is moved so that the point looked at lies in viser's origin: the view orbits
around the corner of the selected pose, also after the next pose is chosen, without a word about cameras. What is big is
sent once under a fixed name; a layer is a node name, so showing and hiding sends no points again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray

from inspector.palette import FACE_COLOURS, REJECTED, SCAN_ON_DARK, SCAN_ON_LIGHT, rgb
from inspector.shapes import disc, ellipsoids, facing, shaded, thin, unit_sphere

M_PER_MM = 1e-3
DETAIL_POINTS = 200_000  # of the selected scan; 3 MB at single precision
OVERVIEW_POINTS = 3_000  # of each other scan, at most
OVERVIEW_TOTAL = 200_000
DRAWN_SETS = 2_000
DOT_MM = 5.0  # diameter of a corner in the scene
DOT_SHARE = 0.005  # of the field that the corners lie in, where that is more
DRAWN_GROUPS = 40
NUMBERED_GROUPS = 6  # and the chosen ones

ROOT = "/scene"
LAYERS = (
    "overview",
    "scan",
    "faces",
    "sets",
    "rejected",
    "groups",
    "corner",
    "corners",
    "residuals",
    "scanner",
)


def to_scene(points_mm: ArrayLike) -> NDArray:
    """Metres, single precision: 0.06 um at 1 m. points_mm  # (..., 3)"""
    return (np.asarray(points_mm, dtype=np.float64) * M_PER_MM).astype(np.float32)


class SceneView:
    """What is on show. Every method replaces what it drew before."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._scene = server.scene
        self._scene.set_up_direction((0.0, -1.0, 0.0))  # a scanner's frame is a camera's: y points down
        self._scene.world_axes.visible = False
        self._root = self._scene.add_frame(ROOT, show_axes=False)
        self._layers = {name: self._scene.add_frame(f"{ROOT}/{name}", show_axes=False) for name in LAYERS}
        self._overview: dict[int, viser.PointCloudHandle] = {}
        self._hidden_overview: int | None = None
        self._drawn: dict[str, list[viser.SceneNodeHandle]] = {name: [] for name in LAYERS}
        self._point_m = 1.2 * M_PER_MM
        self._scan_colour = SCAN_ON_LIGHT
        self._draw_scanner()

    def _replace(self, layer: str, nodes: Sequence[viser.SceneNodeHandle]) -> None:
        """Nodes of a layer that were not drawn again under the same name go away."""
        names = {node.name for node in nodes}
        for old in self._drawn[layer]:
            if old.name not in names:
                old.remove()
        self._drawn[layer] = list(nodes)

    def draw(
        self, layer: str, make: Callable[[viser.SceneApi, str], Sequence[viser.SceneNodeHandle]]
    ) -> None:
        """Fill a layer with the nodes that `make` adds below the name it is given."""
        with self._server.atomic():
            self._replace(layer, make(self._scene, f"{ROOT}/{layer}"))

    def _cloud(
        self, name: str, points_mm: NDArray, colours: ArrayLike, size_m: float
    ) -> viser.PointCloudHandle:
        return self._scene.add_point_cloud(
            name, to_scene(points_mm), np.asarray(colours, dtype=np.uint8), point_size=size_m, precision="float32",
            point_shape="circle", point_shading="flat",
        )  # fmt: skip

    # ---- the view ---------------------------------------------------------------------------------------------------

    def show(self, layer: str, visible: bool) -> None:
        """Show or hide a layer; nothing is sent again."""
        self._layers[layer].visible = visible

    def focus(self, point_mm: ArrayLike) -> None:
        """Bring this point to the middle of the view."""
        self._root.position = tuple(-to_scene(point_mm).astype(float))

    def look(self, distance_mm: float, focus_mm: ArrayLike) -> None:
        """Look at the focus from the scanner's side, a little from above and beside, in every page open or to come."""
        back = -np.asarray(focus_mm, dtype=float)
        length = float(np.linalg.norm(back))
        back = np.array([0.0, 0.0, -1.0]) if length < 1e-9 else back / length
        direction = back + np.array([0.35, -0.30, 0.0])
        eye = direction / np.linalg.norm(direction) * distance_mm * M_PER_MM
        start = self._server.initial_camera
        start.position, start.look_at, start.up = tuple(eye), (0.0, 0.0, 0.0), (0.0, -1.0, 0.0)
        start.near = 0.001
        for client in self._server.get_clients().values():
            with client.atomic():
                client.camera.position = eye
                client.camera.look_at = np.zeros(3)
                client.camera.up_direction = np.array([0.0, -1.0, 0.0])

    def dark(self, dark: bool) -> None:
        """The selected scan stands out from a dark or a light background."""
        self._scan_colour = SCAN_ON_DARK if dark else SCAN_ON_LIGHT
        for node in self._drawn["scan"]:
            if isinstance(node, viser.PointCloudHandle):
                node.colors = np.array(rgb(self._scan_colour), dtype=np.uint8)

    def point_size(self, size_mm: float) -> None:
        """Diameter of the points of all clouds."""
        self._point_m = size_mm * M_PER_MM
        for layer in ("scan", "faces"):
            for node in self._drawn[layer]:
                if isinstance(node, viser.PointCloudHandle):
                    node.point_size = self._point_m * (1.25 if layer == "faces" else 1.0)
        for cloud in self._overview.values():
            cloud.point_size = self._point_m

    def _draw_scanner(self) -> None:
        name = f"{ROOT}/scanner"
        self._scene.add_frame(f"{name}/axes", axes_length=0.06, axes_radius=0.0015)
        self._scene.add_label(f"{name}/label", "scanner (z: view)", font_screen_scale=0.8)

    # ---- scans ------------------------------------------------------------------------------------------------------

    def draw_overview(
        self, index: int, points_mm: NDArray, colour: str, scans: int, normals: NDArray | None = None
    ) -> None:
        """One of so many scans, in few points, lit from the side where their normals are known."""
        kept = thin(points_mm, max(200, min(OVERVIEW_POINTS, OVERVIEW_TOTAL // max(scans, 1))))
        colours = shaded(np.array(rgb(colour)), normals[kept]) if normals is not None else rgb(colour)
        cloud = self._cloud(f"{ROOT}/overview/{index}", points_mm[kept], colours, self._point_m)
        cloud.visible = index != self._hidden_overview
        self._overview[index] = cloud

    def hide_in_overview(self, index: int | None, apart: Callable[[int], bool] = lambda _: False) -> None:
        """Leave out the scan that is drawn in full, and those for which `apart` holds."""
        self._hidden_overview = index
        for i, cloud in self._overview.items():
            visible = i != index and not apart(i)
            if cloud.visible != visible:
                cloud.visible = visible

    def clear_overview(self) -> None:
        """Forget the scans of the dataset before."""
        for cloud in self._overview.values():
            cloud.remove()
        self._overview.clear()

    def draw_scan(self, points_mm: NDArray, faces: Sequence[NDArray] = ()) -> int:
        """The selected scan; `faces` are index arrays into it. Returns how many points are drawn."""
        face_of = np.full(len(points_mm), -1)
        for number, inliers in enumerate(faces):
            face_of[inliers] = number
        kept = thin(points_mm, DETAIL_POINTS)
        points, face_of = points_mm[kept], face_of[kept]
        rest, on_face = face_of < 0, face_of >= 0
        colours = np.array([rgb(c) for c in FACE_COLOURS], dtype=np.uint8)
        with self._server.atomic():
            on_none, ink = [], rgb(self._scan_colour)
            if rest.any():
                on_none = [self._cloud(f"{ROOT}/scan/points", points[rest], ink, self._point_m)]
            self._replace("scan", on_none)
            on_faces = []
            if on_face.any():
                inks = colours[face_of[on_face]]
                on_faces = [self._cloud(f"{ROOT}/faces/points", points[on_face], inks, self._point_m * 1.25)]
            self._replace("faces", on_faces)
        return len(kept)

    # ---- sample sets and plane groups -------------------------------------------------------------------------------

    def draw_sets(
        self, points_mm: NDArray, normals: NDArray, colours: Sequence[str | None], rejected_mm: NDArray
    ) -> None:
        """Passing sets as quadrilaterals with a normal, in their group's colour; rejected ones as grey points.

        points_mm  # (K, 4, 3); normals (K, 3); colours (K,), None: in no group; rejected_mm (R, 3) centroids.
        """
        step = max(1, -(-len(points_mm) // DRAWN_SETS))
        points, normals = points_mm[::step], normals[::step]
        nodes: list[viser.SceneNodeHandle] = []
        if len(points):
            rgbs = np.array([rgb(c or REJECTED) for c in colours[::step]], dtype=np.uint8)
            loop = np.stack([points, np.roll(points, -1, axis=1)], axis=2).reshape(-1, 2, 3)
            centre = points.mean(axis=1)
            tick = np.stack([centre, centre + 4.0 * normals], axis=1)
            nodes.append(
                self._scene.add_line_segments(
                    f"{ROOT}/sets/lines",
                    to_scene(np.concatenate([loop, tick])),
                    np.repeat(np.concatenate([np.repeat(rgbs, 4, axis=0), rgbs])[:, None], 2, axis=1),
                    thickness=1.5,
                    thickness_units="screen",
                )
            )
        with self._server.atomic():
            self._replace("sets", nodes)
            kept = rejected_mm[:: max(1, -(-len(rejected_mm) // 5000))]
            self._replace(
                "rejected",
                [self._cloud(f"{ROOT}/rejected/points", kept, rgb(REJECTED), 0.8 * M_PER_MM)]
                if len(kept)
                else [],
            )

    def draw_groups(
        self,
        centres_mm: NDArray,
        normals: NDArray,
        radii_mm: NDArray,
        colours: Sequence[str],
        chosen: Sequence[bool],
    ) -> None:
        """Each plane group as a disc, the chosen ones stronger, with its number. (G, 3), (G, 3), (G,), G, G."""
        centres, normals, radii = centres_mm[:DRAWN_GROUPS], normals[:DRAWN_GROUPS], radii_mm[:DRAWN_GROUPS]
        nodes: list[viser.SceneNodeHandle] = []
        if len(centres):
            scale = np.maximum(radii, 1.0) * M_PER_MM
            vertices, faces = disc()
            nodes.append(
                self._scene.add_batched_meshes_simple(
                    f"{ROOT}/groups/discs", vertices, faces, facing(normals), to_scene(centres),
                    batched_scales=np.stack([scale, scale, scale], axis=1),
                    batched_colors=np.array([rgb(c) for c in colours[:DRAWN_GROUPS]], dtype=np.uint8),
                    opacity=0.5, batched_opacities=np.where(chosen[:DRAWN_GROUPS], 1.0, 0.3), side="double", lod="off",
                    cast_shadow=False, receive_shadow=False,
                )
            )  # fmt: skip
            for i in [i for i in range(len(centres)) if chosen[i] or i < NUMBERED_GROUPS]:
                nodes.append(
                    self._scene.add_label(
                        f"{ROOT}/groups/label{i}", str(i + 1), position=tuple(to_scene(centres[i]).astype(float)),
                        font_screen_scale=0.75, anchor="center-center",
                    )
                )  # fmt: skip
        with self._server.atomic():
            self._replace("groups", nodes)

    # ---- corners ----------------------------------------------------------------------------------------------------

    def draw_corner(
        self,
        xyz_mm: NDArray | None,
        covariance_mm2: NDArray | None,
        factor: float,
        edges_mm: NDArray | None,
        text: str,
    ) -> None:
        """The selected corner: its 1-sigma ellipsoid enlarged by `factor`, the jig's three edges, a label."""
        nodes: list[viser.SceneNodeHandle] = []
        if xyz_mm is not None:
            at = to_scene(xyz_mm)
            name = f"{ROOT}/corner"
            if edges_mm is not None:
                nodes.append(
                    self._scene.add_line_segments(
                        f"{name}/edges",
                        to_scene(edges_mm),
                        (230, 60, 60),
                        thickness=2.5,
                        thickness_units="screen",
                    )
                )
            if covariance_mm2 is not None:
                wxyz, half = ellipsoids(covariance_mm2[None], factor)
                nodes.append(
                    self._ellipsoid_node(
                        f"{name}/ellipsoid", at[None], wxyz, to_scene(half), np.array([[230, 60, 60]])
                    )
                )
            nodes.append(
                self._scene.add_label(
                    f"{name}/label",
                    text,
                    position=tuple(at.astype(float)),
                    font_screen_scale=0.85,
                    anchor="bottom-left",
                )
            )
        with self._server.atomic():
            self._replace("corner", nodes)

    def draw_corners(
        self,
        xyz_mm: NDArray,
        covariance_mm2: NDArray | None,
        colours: Sequence[str],
        factor: float,
        on_click: Callable[[int], None],
    ) -> None:
        """All corners as dots with their enlarged ellipsoids; a click tells which. (N, 3), (N, 3, 3), N."""
        nodes: list[viser.SceneNodeHandle] = []
        if len(xyz_mm):
            rgbs = np.array([rgb(c) for c in colours], dtype=np.uint8)
            at = to_scene(xyz_mm)
            dot_mm = max(DOT_MM, DOT_SHARE * float(np.linalg.norm(np.ptp(xyz_mm, axis=0))))
            unit = np.tile([1.0, 0, 0, 0], (len(at), 1))
            nodes.append(self._cloud(f"{ROOT}/corners/points", xyz_mm, rgbs, dot_mm * M_PER_MM))
            # Points cannot be clicked, and a lit sphere this small is mostly highlight: unseen spheres take the clicks.
            radius = np.full((len(at), 3), 0.8 * dot_mm * M_PER_MM)
            dots = self._scene.add_batched_meshes_simple(
                f"{ROOT}/corners/dots", *unit_sphere(6, 8), unit, at, batched_scales=radius, opacity=0.004, lod="off",
                cast_shadow=False, receive_shadow=False,
            )  # fmt: skip

            @dots.on_click
            def _(event: viser.SceneNodePointerEvent[viser.BatchedMeshHandle]) -> None:
                if event.instance_index is not None and 0 <= event.instance_index < len(at):
                    on_click(event.instance_index)

            nodes.append(dots)
            if covariance_mm2 is not None:
                wxyz, half = ellipsoids(covariance_mm2, factor)
                nodes.append(
                    self._ellipsoid_node(
                        f"{ROOT}/corners/ellipsoids", at, wxyz, to_scene(half), rgbs, opacity=0.35
                    )
                )
        with self._server.atomic():
            self._replace("corners", nodes)

    def _ellipsoid_node(
        self,
        name: str,
        at: NDArray,
        wxyz: NDArray,
        half_m: NDArray,
        rgbs: NDArray,
        opacity: float | None = None,
    ) -> viser.BatchedMeshHandle:
        vertices, faces = unit_sphere()
        return self._scene.add_batched_meshes_simple(
            name, vertices, faces, wxyz, at, batched_scales=half_m, batched_colors=np.asarray(rgbs, dtype=np.uint8),
            opacity=opacity, lod="off", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
