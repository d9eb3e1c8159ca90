"""Drawing of scans, planes and corners of a view."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import viser

from calib.array_types import Array, ByteArray
from calib.corners.search import CornerSearch
from calib.scans.scan import Scan
from calib.targets.search import ScanSearch
from calib.workcell.scan_field import ScanField, declared_field, evident_field
from inspector.markup.parts.palette import FACE_COLOURS, FILTER_COLOURS, GROUP_COLOURS, HIGHLIGHT, REJECTED, rgb
from inspector.scene.draw_model import pose_colour, pose_colours
from inspector.scene.scene_view import Nodes, Pen, SceneView, to_scene
from inspector.scene.shapes import (
    DOT_MM,
    disc,
    dot_mm,
    ellipsoids,
    facing,
    jig_edges,
    loops,
    spread,
    unit_sphere,
    upright,
)
from inspector.session.view import FACTORS, View, corner_of

HALO = 0.9  # radius of the selected corner's halo over the diameter of a dot
DRAWN_SETS, DRAWN_REJECTED, DRAWN_GROUPS = 2_000, 5_000, 40
NUMBERED_GROUPS = 6  # and the chosen ones
NORMAL_MM = 4.0  # length of a set's normal
REJECTED_MM = 1.0  # diameter of a rejected set's point
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
        scene.clear("corner")
        return
    xyz, covariance = found
    search = view.search
    corner = None if search is None else search.corner
    places = search.places if isinstance(search, ScanSearch) else ()  # of other targets

    def make(pen: Pen) -> Nodes:
        nodes: list[viser.SceneNodeHandle] = []
        if corner is not None:
            normals, centres = (
                np.array([getattr(face, key) for face in corner.faces]) for key in ("normal", "centre_mm")
            )
            edges = jig_edges(corner.xyz_mm, normals, centres, corner.outline.edges_mm)
            nodes.append(pen.lines("edges", edges, rgb(HIGHLIGHT), 2.5))
        if covariance is not None:
            colours = np.array([rgb(HIGHLIGHT)], dtype=np.uint8)
            nodes.append(_ellipsoids(pen, "ellipsoid", xyz[None], covariance[None], view.factor, colours))
        balls = ((place.xyz_mm, place.radius_mm or DOT_MM / 2) for place in places)
        return [*nodes, *(pen.ball(f"target{k}", *ball, opacity=0.25) for k, ball in enumerate(balls))]

    scene.draw("corner", make)


def _ellipsoids(
    pen: Pen,
    part: str,
    xyz_mm: Array,
    covariance_mm2: Array,
    factor: float,
    colours: ByteArray,
    opacity: float | None = None,
) -> viser.SceneNodeHandle:
    wxyz, half_mm = ellipsoids(covariance_mm2, factor)
    return pen.copies(part, unit_sphere(), wxyz, xyz_mm, half_mm, colours, opacity)


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
        scene.clear(*PLANE_LAYERS)
        return
    group_colour = group_colours(search)
    scene.draw("sets", lambda pen: _sets(pen, search, group_colour))
    scene.draw("rejected", lambda pen: _rejected(pen, search))
    scene.draw("groups", lambda pen: _groups(pen, search, group_colour))


def group_colours(search: CornerSearch) -> list[str]:
    """Colours of the plane groups: of the face that a group is, else its own; grey where it was not chosen."""
    colours = [
        REJECTED if i not in search.chosen else GROUP_COLOURS[i % len(GROUP_COLOURS)] for i in range(len(search.groups))
    ]
    for number, face in enumerate(search.corner.faces if search.corner else ()):
        if face.group >= 0:
            colours[face.group] = FACE_COLOURS[number]
    return colours


def _sets(pen: Pen, search: CornerSearch, group_colour: Sequence[str]) -> Nodes:
    """Nodes of accepted sample sets: quadrilaterals with a normal, in their group's colour."""
    sets = search.sets
    colours = np.full((len(sets), 3), rgb(REJECTED), dtype=np.uint8)
    for group, colour in zip(search.groups, group_colour, strict=True):
        colours[group.sets] = rgb(colour)
    passed = np.flatnonzero(sets.passed())
    drawn = passed[:: max(1, -(-len(passed) // DRAWN_SETS))]
    if not len(drawn):
        return []
    corners, own = sets.points_mm[drawn], colours[drawn]
    centre = corners.mean(axis=1)
    ticks = np.stack([centre, centre + NORMAL_MM * sets.normals[drawn]], axis=1)
    of_lines = np.concatenate([np.repeat(own, 4, axis=0), own])
    return [pen.lines("lines", np.concatenate([loops(corners), ticks]), np.repeat(of_lines[:, None], 2, axis=1))]


def _rejected(pen: Pen, search: CornerSearch) -> Nodes:
    """Nodes of sample sets that a filter rejected, coloured by filter 1, 2 or 3."""
    sets = search.sets
    left_out = np.flatnonzero(sets.rejected_by > 0)
    drawn = left_out[:: max(1, -(-len(left_out) // DRAWN_REJECTED))]
    colours = np.array([rgb(c) for c in FILTER_COLOURS], dtype=np.uint8)[sets.rejected_by[drawn] - 1]
    return [pen.points("points", sets.centroids_mm[drawn], colours, REJECTED_MM)] if len(drawn) else []


def _groups(pen: Pen, search: CornerSearch, group_colour: Sequence[str]) -> Nodes:
    """Nodes of plane groups: numbered discs, the chosen ones stronger."""
    groups, centroids_mm = search.groups[:DRAWN_GROUPS], search.sets.centroids_mm
    if not groups:
        return []
    chosen = np.isin(np.arange(len(groups)), search.chosen)
    radii = [max(spread(centroids_mm[g.sets], g.centre_mm), 1.0) for g in groups]
    discs = pen.api.add_batched_meshes_simple(
        pen.of("discs"), *disc(), facing(np.array([g.normal for g in groups])),
        to_scene(np.array([g.centre_mm for g in groups])), batched_scales=to_scene(np.outer(radii, np.ones(3))),
        batched_colors=np.array([rgb(c) for c in group_colour[: len(groups)]], dtype=np.uint8), opacity=0.5,
        batched_opacities=np.where(chosen, 1.0, 0.3), side="double", lod="off", cast_shadow=False, receive_shadow=False,
    )  # fmt: skip
    return [
        discs,
        *(
            pen.label(f"label{i}", str(i + 1), group.centre_mm, "center-center", 0.75)
            for i, group in enumerate(groups)
            if chosen[i] or i < NUMBERED_GROUPS
        ),
    ]


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
    diameter = dot_mm(xyz)

    def make(pen: Pen) -> Nodes:
        if not len(xyz):
            return []
        # Points cannot be clicked, and a lit sphere this small is mostly highlight: unseen spheres take the clicks.
        size = np.full((len(xyz), 3), 0.8 * diameter)
        nodes: list[viser.SceneNodeHandle] = [
            pen.points("points", xyz, colours, diameter),
            pen.touched("dots", unit_sphere(6, 8), upright(len(xyz)), xyz, size, lambda k: on_click(which[k])),
        ]
        if covariance is not None:
            nodes.append(_ellipsoids(pen, "ellipsoids", xyz, covariance, view.factor, colours, opacity=0.35))
        return nodes

    of = None if covariance is None else covariance.tobytes()
    scene.draw("corners", make, key=(tuple(which), xyz.tobytes(), of, colours.tobytes(), view.factor))
    selected = xyz[which.index(view.pose)] if view.pose in which else None
    scene.draw_halo(lambda pen: [] if selected is None else [pen.ball("halo", selected, HALO * diameter, opacity=0.35)])
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
