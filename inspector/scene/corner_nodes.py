"""Nodes of measured corners, for `SceneView.draw`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import viser

from calib.array_types import Array, ByteArray
from calib.targets.protocol.finder import FoundPoint
from inspector.markup.parts.palette import HIGHLIGHT, rgb
from inspector.scene.model_nodes import touched
from inspector.scene.scene_view import M_PER_MM, cloud, to_scene
from inspector.scene.shapes import ellipsoids, unit_sphere

DOT_MM = 5.0  # diameter of a corner in the scene
DOT_SHARE = 0.005  # of the field that the corners lie in, where that is more

HALO = 0.9  # radius of the selected corner's halo over the diameter of a dot


def dot_mm(xyz_mm: Array) -> float:
    """Diameter, mm, at which the dots of points (N, 3) can be distinguished near and far."""
    return max(DOT_MM, DOT_SHARE * float(np.linalg.norm(np.ptp(xyz_mm, axis=0)))) if len(xyz_mm) else DOT_MM


def corner(
    api: viser.SceneApi,
    name: str,
    xyz_mm: Array,
    covariance_mm2: Array | None,
    factor: float,
    edges_mm: Array | None,
    text: str,
) -> list[viser.SceneNodeHandle]:
    """Nodes of the selected corner: its 1-sigma ellipsoid enlarged by `factor`, the jig's three edges, a label."""
    nodes: list[viser.SceneNodeHandle] = []
    if edges_mm is not None:
        nodes.append(
            api.add_line_segments(
                f"{name}/edges", to_scene(edges_mm), rgb(HIGHLIGHT), thickness=2.5, thickness_units="screen"
            )
        )
    if covariance_mm2 is not None:
        colours = np.array([rgb(HIGHLIGHT)], dtype=np.uint8)
        nodes.append(_ellipsoids(api, f"{name}/ellipsoid", xyz_mm[None], covariance_mm2[None], factor, colours))
    at = tuple(to_scene(xyz_mm).astype(float))
    nodes.append(api.add_label(f"{name}/label", text, position=at, font_screen_scale=0.85, anchor="bottom-left"))
    return nodes


def targets(api: viser.SceneApi, name: str, places: Sequence[FoundPoint]) -> list[viser.SceneNodeHandle]:
    """Nodes of other targets found in a scan: a fitted sphere, or a small ball at a point target."""
    return [
        api.add_icosphere(
            f"{name}/target{k}", radius=(place.radius_mm or DOT_MM / 2) * M_PER_MM, color=rgb(HIGHLIGHT),
            opacity=0.25, position=tuple(to_scene(place.xyz_mm).astype(float)), cast_shadow=False,
            receive_shadow=False,
        )
        for k, place in enumerate(places)
    ]  # fmt: skip


def corners(
    api: viser.SceneApi,
    name: str,
    xyz_mm: Array,
    covariance_mm2: Array | None,
    colours: ByteArray,
    factor: float,
    on_click: Callable[[int], None],
) -> list[viser.SceneNodeHandle]:
    """Nodes of all N corners: dots with enlarged ellipsoids, selectable by click."""
    if not len(xyz_mm):
        return []
    diameter = dot_mm(xyz_mm)
    nodes: list[viser.SceneNodeHandle] = [cloud(api, f"{name}/points", xyz_mm, colours, diameter)]
    # Points cannot be clicked, and a lit sphere this small is mostly highlight: unseen spheres take the clicks.
    upright, size = np.tile([1.0, 0, 0, 0], (len(xyz_mm), 1)), np.full((len(xyz_mm), 3), 0.8 * diameter)
    nodes.append(touched(api, f"{name}/dots", unit_sphere(6, 8), upright, xyz_mm, size, on_click))
    if covariance_mm2 is not None:
        nodes.append(_ellipsoids(api, f"{name}/ellipsoids", xyz_mm, covariance_mm2, factor, colours, opacity=0.35))
    return nodes


def halo(api: viser.SceneApi, name: str, at_mm: Array, diameter_mm: float) -> list[viser.SceneNodeHandle]:
    """Node of the ring around the selected corner's dot at `at_mm` (3,)."""
    return [
        api.add_icosphere(
            name, radius=HALO * diameter_mm * M_PER_MM, color=rgb(HIGHLIGHT), opacity=0.35,
            position=tuple(to_scene(at_mm).astype(float)), cast_shadow=False, receive_shadow=False,
        )
    ]  # fmt: skip


def _ellipsoids(
    api: viser.SceneApi,
    name: str,
    xyz_mm: Array,
    covariance_mm2: Array,
    factor: float,
    colours: ByteArray,
    opacity: float | None = None,
) -> viser.BatchedMeshHandle:
    wxyz, half_mm = ellipsoids(covariance_mm2, factor)
    return api.add_batched_meshes_simple(
        name, *unit_sphere(), wxyz, to_scene(xyz_mm), batched_scales=to_scene(half_mm), batched_colors=colours,
        opacity=opacity, lod="off", cast_shadow=False, receive_shadow=False,
    )  # fmt: skip
