"""Distances of scan points to the jig: the jig's model placed at the found corner, and heights over its faces."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
from numpy.typing import ArrayLike

from calib import frames
from calib.array_types import Array, IndexArray
from calib.corners.intersection import Corner
from calib.errors import ScanError
from calib.jig import Jig, jig_geometry

REACH = 0.05  # of the jig's edge: points farther from every face are no part of the jig
RIM = 0.02  # of the jig's edge: how far over a face's rim a point may lie


def place_jig(corner: Corner, jig: Jig) -> tuple[Array, tuple[int, int, int]]:
    """Pose scanner_T_jig (4, 4) of the jig's model at a found corner, and the model's face that is each of its faces.

    The apex lies in the corner; the rotation takes the model's face normals to the estimated ones with the least
    squared error (Kabsch). Which face is which is not known: of the six ways to pair them the one with the least error
    is taken, for edges of different lengths one that puts each in its place, and face i of the corner is face
    `order[i]` of `jig_geometry`.
    """
    jig = _as_seen(jig, corner)
    fitted = np.array([face.normal for face in corner.faces])
    _, normals = jig_geometry(jig)
    lengths = np.array(jig.edges_mm)

    def misfit(order: tuple[int, ...]) -> tuple[bool, float]:
        misplaced = not np.array_equal(lengths[list(order)], corner.outline.edges_mm)
        return misplaced, _turn(fitted, normals[list(order)])[1]

    best = min(permutations((0, 1, 2)), key=misfit)
    turn, _ = _turn(fitted, normals[list(best)])
    return frames.make_transform(turn, corner.xyz_mm), (best[0], best[1], best[2])


def _turn(fitted: Array, model: Array) -> tuple[Array, float]:
    """Rotation (3, 3) from the model's normals (3, 3) to the fitted normals (3, 3), and the norm of the residual."""
    turn = frames.best_fit_rotation(model, fitted)
    return turn, float(np.linalg.norm(fitted - model @ turn.T))


def jig_outline(corner: Corner, jig: Jig) -> Array:
    """Faces of the jig's model at a corner: triangles (3, 3, 3) in mm, apex first, in the corner's order.

    Where the faces are rectangles there are three more triangles, their other halves.
    """
    scanner_T_jig, order = place_jig(corner, jig)
    edges, _ = jig_geometry(_as_seen(jig, corner))
    faces = [[np.zeros(3), edges[(k + 1) % 3], edges[(k + 2) % 3]] for k in order]
    if corner.outline.rectangular:
        faces += [[one + other, other, one] for _, one, other in faces]
    return frames.apply(scanner_T_jig, np.array(faces))


def face_distances(points_mm: ArrayLike, corner: Corner, jig: Jig) -> tuple[Array, IndexArray]:
    """Signed distance (N,) in mm of each point to the nearest of the three estimated planes, and the face's index (N,).

    Positive is outside, towards the scanner. nan (and face -1) where a point is no part of the jig: outside the outline
    of every face, or farther from all than `REACH` of the edge.

    Raises:
        ScanError: points that are not (N, 3).
    """
    points = np.asarray(points_mm, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ScanError(f"distances to the jig: found points of shape {points.shape}; (N, 3) would do")
    distance = np.full(len(points), np.nan)
    nearest = np.full(len(points), -1)
    # Most of a scan is wall and arm: the rest is computed for points in the box around the jig only.
    box_mm = (1.0 + RIM + REACH) * jig.longest_mm * (np.sqrt(2) if corner.outline.rectangular else 1.0)
    near = np.ones(len(points), dtype=bool)
    for axis in range(3):
        near &= np.abs(points[:, axis] - corner.xyz_mm[axis]) <= box_mm
    close = np.flatnonzero(near)
    around = points[close]
    limit = np.full(len(around), REACH * jig.shortest_mm)
    for number, (face, outline) in enumerate(zip(corner.faces, jig_outline(corner, jig), strict=False)):
        height = around @ face.normal - face.offset_mm
        sides = np.column_stack([outline[1] - outline[0], outline[2] - outline[0], face.normal])
        to_sides = np.linalg.inv(sides)[:2]
        u, v = to_sides @ around.T - (to_sides @ outline[0])[:, None]
        inside = (u > -RIM) & (v > -RIM)
        inside &= (np.maximum(u, v) if corner.outline.rectangular else u + v) < 1.0 + RIM
        better = inside & (np.abs(height) <= limit)
        distance[close[better]], nearest[close[better]] = height[better], number
        limit[better] = np.abs(height[better])
    return distance, nearest


def _as_seen(jig: Jig, corner: Corner) -> Jig:
    """The jig, with the cyclic order of its three edges reversed where the scanned corner has the reverse order.

    `edge_mm` may name them in any order.
    """
    if not isinstance(jig.edge_mm, tuple):
        return jig
    fitted = np.array([face.normal for face in corner.faces])
    same_way = np.linalg.det(fitted) * np.linalg.det(jig_geometry(jig)[1]) > 0
    seen = corner.outline.edges_mm if same_way else corner.outline.edges_mm[::-1]
    one, two, three = jig.edge_mm
    if seen in ((one, two, three), (two, three, one), (three, one, two)):
        return jig
    return replace(jig, edge_mm=(one, three, two), face_angles_deg=jig.face_angles_deg[::-1])
