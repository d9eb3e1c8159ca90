"""Layers of the 3D view in viser. The only file that converts millimetres into viser's metres.

Everything hangs under one frame that is moved so that the point looked at lies in viser's origin: the view orbits
around the corner of the selected pose, also after the next pose is chosen, without a camera message. What is big is
sent once under a fixed name; a layer is a node name, so showing and hiding sends no points again.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import viser
import viser.transforms
from numpy.typing import ArrayLike, NDArray

from calib.array_types import Array, BoolArray, ByteArray, IndexArray
from calib.workcell.scan_field import ScanField
from inspector.markup.parts.palette import FACE_COLOURS, HIGHLIGHT, MODEL_BEFORE, SCAN, rgb
from inspector.scene.shapes import shaded, thin

Nodes = Sequence[viser.SceneNodeHandle]
Make = Callable[["Pen"], Nodes]  # what draws a layer
Anchor = Literal["top-center", "bottom-center", "bottom-left", "center-center"]  # of a label

M_PER_MM = 1e-3
_GREY = rgb(SCAN)
UNSEEN = 0.004  # opacity: what is not drawn at all takes no clicks
DETAIL_POINTS = 200_000  # of the selected scan; 3 MB at single precision
OVERVIEW_POINTS = 3_000  # of each other scan, at most
OVERVIEW_TOTAL = 200_000
ON_FACE = 1.25  # how much larger the points of the jig's faces are drawn

ROOT = "/scene"
LAYERS = (
    "overview",
    "scan",
    "faces",
    "distance",
    "jig",
    "sets",
    "rejected",
    "groups",
    "corner",
    "corners",
    "predicted",
    "before",
    "residuals",
    "arm",
    "scanner",
    "plan",
    "floor",
    "scale",
)
HALO = "halo"  # a part of the layer of corners
POINT_MM = 1.2  # diameter of a scan's point
DOWN = (0.0, 1.0, 0.0)  # in a scanner's frame, which is a camera's: y points down
BESIDE = (0.35, -0.30, 0.0)  # of the scanner, and a little above: where looks come from


def to_scene(points_mm: ArrayLike) -> NDArray[np.float32]:
    """Points (..., 3), mm, converted to metres in single precision (0.06 um at 1 m)."""
    return (np.asarray(points_mm, dtype=np.float64) * M_PER_MM).astype(np.float32)


def frustum_edges(corners: Array) -> Array:
    """Edges (K, 2, 3) of a frustum with corners (2, 4, 3), and lines from the origin to its near end."""
    near, far = corners
    around = [np.stack([end, np.roll(end, -1, axis=0)], axis=1) for end in corners]
    sides, sight = np.stack([near, far], axis=1), np.stack([np.zeros_like(near), near], axis=1)
    return np.concatenate([*around, sides, sight])


@dataclass(frozen=True)
class Pen:
    """What draws the nodes of one layer, below a name, from places and sizes in mm."""

    api: viser.SceneApi
    name: str

    def of(self, part: str) -> str:
        """Name of a node."""
        return f"{self.name}/{part}"

    def points(self, part: str, points_mm: Array, colours: ArrayLike, size_mm: float) -> viser.PointCloudHandle:
        """Round points (N, 3), with colours (3,) or (N, 3)."""
        return self.api.add_point_cloud(
            self.of(part), to_scene(points_mm), np.asarray(colours, dtype=np.uint8), point_size=size_mm * M_PER_MM,
            precision="float32", point_shape="circle", point_shading="flat",
        )  # fmt: skip

    def lines(self, part: str, lines_mm: Array, colours: Any, width: float = 1.5) -> viser.LineSegmentsHandle:
        """Lines (K, 2, 3) as wide on every screen, in one colour or (K, 2, 3)."""
        return self.api.add_line_segments(
            self.of(part), to_scene(lines_mm), colours, thickness=width, thickness_units="screen"
        )

    def label(
        self, part: str, text: str, at_mm: Array, anchor: Anchor = "bottom-center", size: float = 0.85
    ) -> viser.LabelHandle:
        """Words at a place (3,)."""
        place = tuple(to_scene(at_mm).astype(float))
        return self.api.add_label(self.of(part), text, position=place, font_screen_scale=size, anchor=anchor)

    def ball(self, part: str, at_mm: Array, radius_mm: float, opacity: float) -> viser.SceneNodeHandle:
        """Translucent ball at a place (3,), in the colour of what is selected."""
        return self.api.add_icosphere(
            self.of(part), radius=radius_mm * M_PER_MM, color=rgb(HIGHLIGHT), opacity=opacity,
            position=tuple(to_scene(at_mm).astype(float)), cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    def copies(
        self,
        part: str,
        shape: tuple[Array, IndexArray],
        wxyz: Array,
        at_mm: Array,
        size_mm: Array,
        colours: Any = _GREY,
        opacity: float | None = None,
    ) -> viser.BatchedMeshHandle:
        """K copies of a mesh at wxyz (K, 4), places (K, 3), sizes (K, 3), in one colour or (K, 3)."""
        return self.api.add_batched_meshes_simple(
            self.of(part), *shape, wxyz, to_scene(at_mm), batched_scales=to_scene(size_mm), batched_colors=colours,
            opacity=opacity, lod="off", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    def touched(
        self,
        part: str,
        shape: tuple[Array, IndexArray],
        wxyz: Array,
        at_mm: Array,
        size_mm: Array,
        on_click: Callable[[int], None],
    ) -> viser.SceneNodeHandle:
        """K unseen copies that take clicks in place of points and arrows, which cannot."""
        node = self.copies(part, shape, wxyz, at_mm, size_mm, opacity=UNSEEN)

        @node.on_click
        def _(event: viser.SceneNodePointerEvent[viser.BatchedMeshHandle]) -> None:
            if event.instance_index is not None and 0 <= event.instance_index < len(at_mm):
                on_click(event.instance_index)

        return node


def sight_of(camera: viser.CameraHandle) -> Sight:
    """Sight of a page's camera as it stands."""
    rotation = np.asarray(viser.transforms.SO3(np.asarray(camera.wxyz)).as_matrix(), dtype=float)
    return Sight(np.asarray(camera.position, dtype=float), rotation, float(camera.fov), float(camera.aspect))


@dataclass(frozen=True)
class Sight:
    """Camera of a page: its place and attitude in the scene, and how wide it sees."""

    position: Array  # (3,) in the scene's unit
    rotation: Array  # (3, 3) scene_R_camera: x right, y down, z along the view
    fov_rad: float  # from bottom to top
    aspect: float  # width over height

    def on_screen(self, points: Array) -> Array:
        """Places (N, 2) of points (N, 3) on the screen, 0 to 1 from the left top; NaN behind the camera."""
        seen = (np.asarray(points, dtype=float) - self.position) @ self.rotation
        depth = np.where(seen[:, 2] > 0.0, seen[:, 2], np.nan)
        half = np.tan(0.5 * self.fov_rad) * np.array([self.aspect, 1.0])
        return 0.5 + 0.5 * seen[:, :2] / depth[:, None] / half

    def in_box(self, points: Array, corner: tuple[float, float], opposite: tuple[float, float]) -> BoolArray:
        """Whether points (N, 3) are seen in the box between two places on the screen."""
        low, high = np.minimum(corner, opposite), np.maximum(corner, opposite)
        place = self.on_screen(points)
        return np.asarray(((place >= low) & (place <= high)).all(axis=1))


class SceneView:
    """The 3D view of all pages; every method replaces what it drew before."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._scene = server.scene
        self._scene.set_up_direction(tuple(-np.array(DOWN)))
        self._scene.world_axes.visible = False
        self._root = self._scene.add_frame(ROOT, show_axes=False)
        self._layers = {name: self._scene.add_frame(f"{ROOT}/{name}", show_axes=False) for name in LAYERS}
        self._overview: dict[int, viser.PointCloudHandle] = {}
        self._hidden_overview: int | None = None
        self._field: viser.LineSegmentsHandle | None = None
        self._drawn: dict[str, list[viser.SceneNodeHandle]] = {name: [] for name in (*LAYERS, HALO)}
        self._keys: dict[str, object] = {}  # what a layer was drawn for
        self.draw_instrument("scanner")

    def _pen(self, layer: str) -> Pen:
        return Pen(self._scene, f"{ROOT}/{layer}")

    def _replace(self, layer: str, nodes: Nodes) -> None:
        """Remove the nodes of a layer that were not drawn again under the same name."""
        names = {node.name for node in nodes}
        for old in self._drawn[layer]:
            if old.name not in names:
                old.remove()
        self._drawn[layer] = list(nodes)

    def atomic(self) -> AbstractContextManager[None]:
        """Context in which everything drawn reaches the pages at once."""
        return self._server.atomic()

    def draw(self, layer: str, make: Make, *, key: object = None) -> None:
        """Fill a layer with the nodes that `make` draws.

        Nothing is drawn again for the same `key`: it spares the wire, and pages now and then show nothing of a batch
        of meshes that is added anew.
        """
        if key is not None and self._keys.get(layer) == key:
            return
        self._keys[layer] = key
        with self._server.atomic():
            self._replace(layer, make(self._pen(layer)))

    def clear(self, *layers: str) -> None:
        """Remove all nodes of some layers."""
        for layer in layers:
            self.draw(layer, lambda pen: [])

    def draw_halo(self, make: Make) -> None:
        """Draw the mark of the selected corner, separately from the corners because it moves."""
        with self._server.atomic():
            self._replace(HALO, make(self._pen("corners")))

    # ---- the view ---------------------------------------------------------------------------------------------------

    def show(self, layer: str, visible: bool) -> None:
        """Show or hide a layer without sending it again."""
        self._layers[layer].visible = visible

    def on_box(self, selected: Callable[[Callable[[Array], BoolArray]], None]) -> None:
        """Call `selected` for each box drawn with the Shift key, with a test of points (N, 3), mm, for lying in it."""

        @self._scene.on_rect_select(modifier="shift")
        def _(event: viser.SceneRectSelectEvent) -> None:
            sight = sight_of(event.client.camera)
            middle = np.asarray(self._root.position)
            selected(lambda points: sight.in_box(to_scene(points) + middle, event.screen_min, event.screen_max))

    def focus(self, point_mm: ArrayLike) -> None:
        """Move a point to the middle of the view."""
        self._root.position = tuple(-to_scene(point_mm).astype(float))

    def aim_camera(self, distance_mm: float, towards: ArrayLike, *, up: ArrayLike) -> None:
        """Direct the camera at the middle of the view from a direction (3,), in all open and later pages."""
        direction, up = np.asarray(towards, dtype=float), np.asarray(up, dtype=float)
        eye = direction / np.linalg.norm(direction) * distance_mm * M_PER_MM
        start = self._server.initial_camera
        start.position, start.look_at, start.up = tuple(eye), (0.0, 0.0, 0.0), tuple(up)
        start.near = 0.001
        for client in self._server.get_clients().values():
            with warnings.catch_warnings(), client.atomic():
                # A page may close while it is spoken to; there is nothing to tell anybody then.
                warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")
                client.camera.position = eye
                client.camera.look_at = np.zeros(3)
                client.camera.up_direction = up

    def draw_instrument(self, noun: str, field: ScanField | None = None) -> None:
        """Draw the frame of the measuring device with its noun, and the frustum in which a scanner measures."""
        pen = self._pen("scanner")
        self._scene.add_frame(pen.of("axes"), axes_length=0.06, axes_radius=0.0015)
        text = f"{noun} (z: view)" if noun == "scanner" else noun
        self._scene.add_label(pen.of("label"), text, font_screen_scale=0.8, anchor="center-right")
        if self._field is not None:
            self._field.remove()
        edges = None if field is None else frustum_edges(field.corners_mm)
        self._field = None if edges is None else pen.lines("field", edges, rgb(MODEL_BEFORE), 1.0)

    # ---- scans ------------------------------------------------------------------------------------------------------

    def draw_overview(
        self, index: int, points_mm: Array, colour: str, scans: int, normals: Array | None = None
    ) -> None:
        """Draw one of many scans with few points, shaded where their normals are known."""
        kept = thin(points_mm, max(200, min(OVERVIEW_POINTS, OVERVIEW_TOTAL // max(scans, 1))))
        colours = shaded(np.array(rgb(colour)), normals[kept]) if normals is not None else rgb(colour)
        node = self._pen("overview").points(str(index), points_mm[kept], colours, POINT_MM)
        node.visible = index != self._hidden_overview
        self._overview[index] = node

    def place_in_overview(self, index: int, here_T_there: Array) -> None:
        """Move one of many scans by a transform (4, 4) from its frame to the frame of the view."""
        node = self._overview[index]
        wxyz = viser.transforms.SO3.from_matrix(here_T_there[:3, :3]).wxyz
        position = to_scene(here_T_there[:3, 3]).astype(float)
        if not (np.allclose(node.wxyz, wxyz) and np.allclose(node.position, position)):
            node.wxyz, node.position = wxyz, tuple(position)

    @property
    def in_overview(self) -> tuple[int, ...]:
        """Indices of the scans that are drawn in the overview."""
        return tuple(self._overview)

    def hide_in_overview(self, index: int | None, apart: Callable[[int], bool] = lambda _: False) -> None:
        """Hide in the overview the scan that is drawn in full, and all scans for which `apart` is true."""
        self._hidden_overview = index
        for i, other in self._overview.items():
            visible = i != index and not apart(i)
            if other.visible != visible:
                other.visible = visible

    def clear_overview(self) -> None:
        """Remove the scans of the previous dataset."""
        for other in self._overview.values():
            other.remove()
        self._overview.clear()

    def draw_scan(self, points_mm: Array, faces: Sequence[IndexArray] = ()) -> int:
        """Draw the selected scan; `faces` are index arrays into it. Returns the number of points drawn."""
        face_of = np.full(len(points_mm), -1)
        for number, inliers in enumerate(faces):
            face_of[inliers] = number % len(FACE_COLOURS)
        kept = thin(points_mm, DETAIL_POINTS)
        points, face_of = points_mm[kept], face_of[kept]
        rest, on_face = face_of < 0, face_of >= 0
        colours = np.array([rgb(c) for c in FACE_COLOURS], dtype=np.uint8)
        with self._server.atomic():
            self._draw_points("scan", points[rest], rgb(SCAN), POINT_MM)
            self._draw_points("faces", points[on_face], colours[face_of[on_face]], POINT_MM * ON_FACE)
        return len(kept)

    def draw_distance(self, points_mm: Array, colours: ByteArray) -> None:
        """Draw points (N, 3) of the selected scan on the jig, in colours (N, 3) of their distance to its faces."""
        kept = thin(points_mm, DETAIL_POINTS)
        with self._server.atomic():
            self._draw_points("distance", points_mm[kept], colours[kept], POINT_MM * ON_FACE)

    def _draw_points(self, layer: str, points_mm: Array, colours: ArrayLike, size_mm: float) -> None:
        nodes = [self._pen(layer).points("points", points_mm, colours, size_mm)] if len(points_mm) else []
        self._replace(layer, nodes)
