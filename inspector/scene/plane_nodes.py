"""Nodes of sample sets and plane groups, for `SceneView.draw`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser

from calib.array_types import Array, ByteArray
from inspector.markup.parts.palette import FILTER_COLOURS, REJECTED, rgb
from inspector.scene.scene_view import M_PER_MM, cloud, to_scene
from inspector.scene.shapes import disc, facing

DRAWN_SETS = 2_000
DRAWN_REJECTED = 5_000
DRAWN_GROUPS = 40
NUMBERED_GROUPS = 6  # and the chosen ones
NORMAL_MM = 4.0  # length of a set's normal
REJECTED_MM = 1.0  # diameter of a rejected set's point


def sets(
    api: viser.SceneApi, name: str, points_mm: Array, normals: Array, colours: Sequence[str | None]
) -> list[viser.SceneNodeHandle]:
    """Nodes of accepted sample sets: quadrilaterals with a normal, in their group's colour.

    points_mm  # (K, 4, 3); normals (K, 3); colours (K,), None: in no group.
    """
    step = max(1, -(-len(points_mm) // DRAWN_SETS))
    points, normals = points_mm[::step], normals[::step]
    if not len(points):
        return []
    rgbs = np.array([rgb(c or REJECTED) for c in colours[::step]], dtype=np.uint8)
    loop = np.stack([points, np.roll(points, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    centre = points.mean(axis=1)
    tick = np.stack([centre, centre + NORMAL_MM * normals], axis=1)
    lines = api.add_line_segments(
        f"{name}/lines",
        to_scene(np.concatenate([loop, tick])),
        np.repeat(np.concatenate([np.repeat(rgbs, 4, axis=0), rgbs])[:, None], 2, axis=1),
        thickness=1.5,
        thickness_units="screen",
    )
    return [lines]


def rejected(api: viser.SceneApi, name: str, centroids_mm: Array, filters: ByteArray) -> list[viser.SceneNodeHandle]:
    """Nodes of sample sets that a filter rejected, coloured by filter 1, 2 or 3 (filters (R,)); centroids_mm (R, 3)."""
    every = max(1, -(-len(centroids_mm) // DRAWN_REJECTED))
    kept, by = centroids_mm[::every], filters[::every]
    if not len(kept):
        return []
    colours = np.array([rgb(c) for c in FILTER_COLOURS], dtype=np.uint8)[by - 1]
    return [cloud(api, f"{name}/points", kept, colours, REJECTED_MM)]


def groups(
    api: viser.SceneApi,
    name: str,
    centres_mm: Array,
    normals: Array,
    radii_mm: Array,
    colours: Sequence[str],
    chosen: Sequence[bool],
) -> list[viser.SceneNodeHandle]:
    """Nodes of plane groups: numbered discs, the chosen ones stronger; centres (G, 3), normals (G, 3), radii (G,)."""
    centres, normals, radii = centres_mm[:DRAWN_GROUPS], normals[:DRAWN_GROUPS], radii_mm[:DRAWN_GROUPS]
    if not len(centres):
        return []
    scale = np.maximum(radii, 1.0) * M_PER_MM
    vertices, faces = disc()
    nodes: list[viser.SceneNodeHandle] = [
        api.add_batched_meshes_simple(
            f"{name}/discs", vertices, faces, facing(normals), to_scene(centres),
            batched_scales=np.stack([scale, scale, scale], axis=1),
            batched_colors=np.array([rgb(c) for c in colours[:DRAWN_GROUPS]], dtype=np.uint8),
            opacity=0.5, batched_opacities=np.where(chosen[:DRAWN_GROUPS], 1.0, 0.3), side="double", lod="off",
            cast_shadow=False, receive_shadow=False,
        )
    ]  # fmt: skip
    nodes += [
        api.add_label(
            f"{name}/label{i}", str(i + 1), position=tuple(to_scene(centres[i]).astype(float)),
            font_screen_scale=0.75, anchor="center-center",
        )
        for i in range(len(centres)) if chosen[i] or i < NUMBERED_GROUPS
    ]  # fmt: skip
    return nodes
