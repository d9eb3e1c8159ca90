"""From the view to the scene: which arrays are drawn where. What they look like is `scene`'s."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from calib.scan import Scan
from inspector.palette import role_colour
from inspector.panels import words
from inspector.panels.base import View, corner_of
from inspector.panels.corner import ellipsoid_words
from inspector.panels.planes import group_colours
from inspector.scene import SceneView
from inspector.shapes import jig_edges, spread

AROUND_JIG = 1.8  # edges of the jig
PLANE_LAYERS = {"sets", "rejected", "groups"}


def draw_pose(scene: SceneView, view: View, scan: Scan | None, visible: set[str]) -> int:
    """The selected pose's scan, planes and corner. Returns how many points of the scan are drawn."""
    search = view.search
    corner = None if search is None else search.corner
    faces = [] if corner is None else [face.inliers for face in corner.faces]
    drawn = scene.draw_scan(np.zeros((0, 3)) if scan is None else scan.points_mm, faces)
    draw_planes(scene, view, visible)
    found = corner_of(view, view.pose)
    edges = None
    if corner is not None:
        edges = jig_edges(
            corner.xyz_mm,
            np.array([face.normal for face in corner.faces]),
            np.array([face.centre_mm for face in corner.faces]),
            view.session.dataset.jig.edge_mm,
        )
    if found is None:
        scene.draw_corner(None, None, view.factor, None, "")
        return drawn
    xyz, covariance = found
    text = view.pose_id
    if covariance is not None:
        text += f": σ {words.length(float(np.sqrt(np.trace(covariance))))}, {ellipsoid_words(view.factor)}"
    scene.draw_corner(xyz, covariance, view.factor, edges, text)
    return drawn


def draw_overview(scene: SceneView, view: View, pose: int, scan: Scan, colour: str, scans: int) -> None:
    """One scan among many: around its corner, from the points that have normals; the whole scan where none was found.

    A scan without a corner shows all that it has, wall and table too, so it stands out.
    """
    search = view.session.searches.get(view.session.dataset.poses.ids[pose])
    if search is None or search.corner is None:
        scene.draw_overview(pose, scan.points_mm, colour, scans)
        return
    away = np.linalg.norm(search.voxel_points_mm - search.corner.xyz_mm, axis=1)
    kept = away < AROUND_JIG * view.session.dataset.jig.edge_mm
    scene.draw_overview(pose, search.voxel_points_mm[kept], colour, scans, search.voxel_normals[kept])


def draw_planes(scene: SceneView, view: View, visible: set[str]) -> None:
    """Sample sets and plane groups of the selected pose, if any of their layers is on show."""
    search, none = view.search, np.zeros((0, 3))
    if search is None or not PLANE_LAYERS & visible:
        scene.draw_sets(none.reshape(0, 4, 3), none, [], none)
        scene.draw_groups(none, none, np.zeros(0), [], [])
        return
    sets, passed = search.sets, search.sets.passed()
    group_of = np.full(len(sets), -1)
    for number, group in enumerate(search.groups):
        group_of[group.sets] = number
    colours = group_colours(search, view.grey_rejected)
    scene.draw_sets(
        sets.points_mm[passed],
        sets.normals[passed],
        [colours[g] if g >= 0 else None for g in group_of[passed]],
        sets.centroids_mm[sets.rejected_by > 0],
    )
    groups = search.groups
    scene.draw_groups(
        np.array([g.centre_mm for g in groups]).reshape(-1, 3),
        np.array([g.normal for g in groups]).reshape(-1, 3),
        np.array([spread(sets.centroids_mm[g.sets], g.centre_mm) for g in groups]),
        colours,
        [i in search.chosen for i in range(len(groups))],
    )


def draw_corners(scene: SceneView, view: View, on_click: Callable[[int], None]) -> NDArray:
    """All corners seen from the selected pose's scanner placement, each in the colour of its role. Returns them."""
    poses = view.session.dataset.poses
    here = [(i, corner_of(view, i)) for i in range(len(poses)) if poses.setup[i] == poses.setup[view.pose]]
    found = [(i, *corner) for i, corner in here if corner is not None]
    xyz = np.array([f[1] for f in found]).reshape(-1, 3)
    known = bool(found) and all(f[2] is not None for f in found)
    scene.draw_corners(
        xyz,
        np.array([f[2] for f in found]) if known else None,
        [role_colour(str(poses.role[f[0]])) for f in found],
        view.factor,
        lambda instance: on_click(found[instance][0]),
    )
    return xyz
