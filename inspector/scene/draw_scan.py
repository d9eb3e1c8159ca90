"""Drawing of scans, planes and corners of a view."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from calib.array_types import Array
from calib.rendering import numbers
from calib.scans.scan import Scan
from calib.targets.search import ScanSearch
from calib.workcell.scan_field import ScanField, declared_field, evident_field
from inspector.markup.measure.corner import ellipsoid_words
from inspector.markup.measure.planes import group_colours
from inspector.scene import corner_nodes, plane_nodes
from inspector.scene.draw_model import pose_colour, pose_colours
from inspector.scene.scene_view import SceneView
from inspector.scene.shapes import jig_edges, spread
from inspector.session.view import FACTORS, View, corner_of

AROUND_JIG = 1.8  # edges of the jig
ELLIPSOID_MM = 12.0
PLANE_LAYERS = ("sets", "rejected", "groups")


def draw_pose(scene: SceneView, view: View, scan: Scan | None, visible: set[str]) -> int:
    """Draw the selected pose's scan, planes and corner; returns the number of points drawn."""
    search = view.search
    corner = None if search is None else search.corner
    faces = [] if corner is None or scan is None else [face.inliers for face in corner.faces]
    if scan is not None and isinstance(search, ScanSearch):
        faces = [place.inliers for place in search.places]
    drawn = scene.draw_scan(np.zeros((0, 3)) if scan is None else scan.points_mm, faces)
    draw_planes(scene, view, visible)
    draw_corner(scene, view)
    return drawn


def draw_corner(scene: SceneView, view: View) -> None:
    """Draw the selected pose's corner with its uncertainty, and the jig's edges where it was scanned."""
    found = corner_of(view, view.pose)
    if found is None:
        scene.draw("corner", lambda api, name: [])
        return
    xyz, covariance = found
    corner = None if view.search is None else view.search.corner
    edges = None
    if corner is not None:
        edges = jig_edges(
            corner.xyz_mm,
            np.array([face.normal for face in corner.faces]),
            np.array([face.centre_mm for face in corner.faces]),
            corner.outline.edges_mm,
        )
    text = view.pose_id
    if covariance is not None:
        text += f": σ {numbers.length(float(np.sqrt(np.trace(covariance))))}, {ellipsoid_words(view.factor)}"
    scene.draw(
        "corner",
        lambda api, name: [
            *corner_nodes.corner(api, name, xyz, covariance, view.factor, edges, text),
            *corner_nodes.targets(api, name, view.search.places if isinstance(view.search, ScanSearch) else ()),
        ],
    )


def draw_overview(scene: SceneView, view: View, pose: int, scan: Scan) -> None:
    """Draw one of many scans: the points with normals around its corner, or the whole scan where none was found.

    A scan without a corner shows all that it has, wall and table too, so it stands out.
    """
    search = view.session.searches.get(view.session.dataset.poses.ids[pose])
    colour, scans = pose_colour(view, pose), view.session.scans
    if search is None or search.corner is None:
        scene.draw_overview(pose, scan.points_mm, colour, scans)
        scene.place_in_overview(pose, view.here_T_scanner(pose))
        return
    away = np.linalg.norm(search.voxel_points_mm - search.corner.xyz_mm, axis=1)
    kept = away < AROUND_JIG * view.session.dataset.jig.longest_mm
    scene.draw_overview(pose, search.voxel_points_mm[kept], colour, scans, search.voxel_normals[kept])
    scene.place_in_overview(pose, view.here_T_scanner(pose))


def place_overview(scene: SceneView, view: View) -> None:
    """Place the scans of a scanner that the arm carries in the room, by the version on show.

    The jig stands still there, so that its scans lie on one another where the model is right.
    """
    if view.session.dataset.robot.carries_scanner:
        for pose in scene.in_overview:
            scene.place_in_overview(pose, view.here_T_scanner(pose))


def draw_planes(scene: SceneView, view: View, visible: set[str]) -> None:
    """Draw sample sets and plane groups of the selected pose, as far as their layers are visible."""
    search = view.search
    if search is None or visible.isdisjoint(PLANE_LAYERS):
        for layer in PLANE_LAYERS:
            scene.draw(layer, lambda api, name: [])
        return
    sets, passed, groups = search.sets, search.sets.passed(), search.groups
    group_of = np.full(len(sets), -1)
    for number, group in enumerate(groups):
        group_of[group.sets] = number
    colours = group_colours(search, view.grey_rejected)
    of_sets = [colours[g] if g >= 0 else None for g in group_of[passed]]
    scene.draw(
        "sets", lambda api, name: plane_nodes.sets(api, name, sets.points_mm[passed], sets.normals[passed], of_sets)
    )
    left_out = sets.rejected_by > 0
    scene.draw(
        "rejected",
        lambda api, name: plane_nodes.rejected(api, name, sets.centroids_mm[left_out], sets.rejected_by[left_out]),
    )
    scene.draw(
        "groups",
        lambda api, name: plane_nodes.groups(
            api,
            name,
            np.array([g.centre_mm for g in groups]).reshape(-1, 3),
            np.array([g.normal for g in groups]).reshape(-1, 3),
            np.array([spread(sets.centroids_mm[g.sets], g.centre_mm) for g in groups]),
            colours,
            [i in search.chosen for i in range(len(groups))],
        ),
    )


def draw_corners(scene: SceneView, view: View, on_click: Callable[[int], None]) -> Array:
    """Draw all corners of the selected pose's setup, coloured by role or error; returns their points (K, 3), mm."""
    poses = view.session.dataset.poses
    here = [(i, corner_of(view, i)) for i in range(len(poses)) if poses.setup[i] == poses.setup[view.pose]]
    found = [(i, *corner) for i, corner in here if corner is not None]
    which = [f[0] for f in found]
    xyz = np.array([f[1] for f in found]).reshape(-1, 3)
    known = bool(found) and all(f[2] is not None for f in found)
    covariance = np.array([f[2] for f in found]) if known else None
    colours = pose_colours(view)[which]
    scene.draw(
        "corners",
        lambda api, name: corner_nodes.corners(
            api, name, xyz, covariance, colours, view.factor, lambda k: on_click(which[k])
        ),
        key=(
            tuple(which),
            xyz.tobytes(),
            None if covariance is None else covariance.tobytes(),
            colours.tobytes(),
            view.factor,
        ),
    )
    selected = xyz[which.index(view.pose)] if view.pose in which else None
    scene.draw_halo(
        lambda api, name: [] if selected is None else corner_nodes.halo(api, name, selected, corner_nodes.dot_mm(xyz))
    )
    return xyz


def fitting_ellipsoids(view: View) -> float:
    """Enlargement at which the first known corner's ellipsoid is about a centimetre large."""
    known = (corner_of(view, i) for i in range(len(view.session.dataset.poses)))
    covariance = next((found[1] for found in known if found is not None), None)
    if covariance is None:
        return view.factor
    sigma_mm = float(np.sqrt(np.trace(covariance)))
    return float(max((f for f in FACTORS if f * sigma_mm <= ELLIPSOID_MM), default=FACTORS[0]))


def middle_of(view: View, medians: Mapping[int, Array]) -> tuple[Array, float]:
    """Middle (3,) of all corners, or of the scans' `medians`, and the radius that contains nearly all of them, mm."""
    setups = view.session.dataset.poses.setup
    here = [i for i in range(len(setups)) if setups[i] == setups[view.pose]]
    corners = [corner[0] for i in here if (corner := corner_of(view, i)) is not None]
    points = [m for i, m in medians.items() if i in here and np.isfinite(m).all()]
    known = np.array(corners or points).reshape(-1, 3)  # a scan's middle is that of its background
    if not len(known):
        return np.array([0.0, 0.0, 700.0]), 100.0
    middle = (known.min(axis=0) + known.max(axis=0)) / 2
    return middle, spread(known, middle)


def field_of_scanner(view: View) -> ScanField | None:
    """Field in which the scanner measures: declared, or where the jig was measured; None for other instruments."""
    dataset, placed = view.session.dataset, [corner_of(view, i) for i in range(len(view.session.dataset.poses))]
    points = np.array([corner[0] for corner in placed if corner is not None]).reshape(-1, 3)
    if not dataset.shows_faces or not len(points):
        return declared_field(dataset.scanner)
    field, _ = evident_field(dataset.scanner, points)
    return field if isinstance(field, ScanField) else None
