"""Triangle meshes for a second, independent scanner: the jig with its flaws, a robot around it, a workshop behind.

Everything is in the view frame: the first eye at the origin, looking along +z, y down. Labels are per triangle: 0, 1, 2
the jig's faces, 3 the rest of the jig (chamfers, cut tips, holes, stickers), 4 all else.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, Delaunay, HalfspaceIntersection
from scipy.spatial.transform import Rotation

REST_OF_JIG, ELSE = 3, 4
_ROUND = 40  # corners of a circle


@dataclass(frozen=True)
class Mesh:
    """Triangles with a label each."""

    vertices_mm: NDArray  # (V, 3)
    triangles: NDArray  # (T, 3)
    label: NDArray  # (T,)

    def moved(self, view_T_part: NDArray) -> Mesh:
        """The mesh after a rigid transform (4, 4)."""
        return Mesh(self.vertices_mm @ view_T_part[:3, :3].T + view_T_part[:3, 3], self.triangles, self.label)


def joined(meshes: Iterable[Mesh]) -> Mesh:
    """Several meshes as one."""
    parts = list(meshes)
    first = np.cumsum([0, *(len(m.vertices_mm) for m in parts)])
    return Mesh(
        np.vstack([m.vertices_mm for m in parts]),
        np.vstack([m.triangles + start for m, start in zip(parts, first, strict=False)]),
        np.concatenate([m.label for m in parts]),
    )


def transform(rotation: NDArray, place_mm: NDArray) -> NDArray:
    """(4, 4) of a rotation (3, 3) and a place (3,)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, place_mm
    return out


def _at(*xyz_mm: float) -> NDArray:
    return np.array(xyz_mm)


def box(size_mm: Sequence[float], label: int = ELSE) -> Mesh:
    """A box about its middle."""
    import trimesh

    made = trimesh.creation.box(extents=size_mm)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces), np.full(len(made.faces), label))


def rod(start_mm: NDArray, end_mm: NDArray, radius_mm: float) -> Mesh:
    """A cylinder from place to place."""
    import trimesh

    made = trimesh.creation.cylinder(radius=radius_mm, segment=np.array([start_mm, end_mm]), sections=_ROUND)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces), np.full(len(made.faces), ELSE))


@dataclass(frozen=True)
class JigShape:
    """A cube's corner cut off along the diagonal, and what a workshop makes of it. Lengths in mm."""

    edge: float = 60.0
    chamfer: float = 0.0  # leg of the bevel along the three edges
    tip_cut: float = 0.0  # taken off each leg's end
    holes: int = 0  # screw holes on each face
    sticker: float = 0.0  # height of a label on the first face
    plate: float | None = None  # a base plate on from the first face's far edge, that much below its plane


def jig_mesh(shape: JigShape, rng: np.random.Generator) -> Mesh:
    """The jig in its own frame: the (virtual) apex at the origin, edges along +x, +y, +z, faces toward -x, -y, -z."""
    edge = shape.edge
    rows = [[-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [*(np.ones(3) / np.sqrt(3)), -edge / np.sqrt(3)]]
    if shape.chamfer:
        for i, j in ((0, 1), (1, 2), (2, 0)):
            bevel = np.zeros(4)
            bevel[[i, j]], bevel[3] = -np.sqrt(0.5), shape.chamfer * np.sqrt(0.5)
            rows.append(bevel.tolist())
    if shape.tip_cut:
        rows += [[*np.eye(3)[i], shape.tip_cut - edge] for i in range(3)]
    corners = HalfspaceIntersection(np.array(rows, dtype=float), np.full(3, edge / 5)).intersections
    corners = np.unique(np.round(corners, 9), axis=0)
    hull = ConvexHull(corners)
    on_face = [np.flatnonzero(np.abs(corners[:, i]) < 1e-6) for i in range(3)]
    is_face = [np.all(np.isin(hull.simplices, on), axis=1) for on in on_face]
    rest = hull.simplices[~np.any(is_face, axis=0)]
    parts = [Mesh(corners, rest, np.full(len(rest), REST_OF_JIG))]
    for face in range(3):
        parts += _face_with_holes(corners[on_face[face]], face, shape, rng)
    if shape.sticker:
        flat = box((edge * rng.uniform(0.2, 0.4), edge * rng.uniform(0.12, 0.25), 1.0), REST_OF_JIG)
        turn = Rotation.from_euler("z", rng.uniform(0, 180), degrees=True).as_matrix()
        middle = np.array([*(edge * rng.uniform(0.25, 0.33, 2)), 0.5 - shape.sticker])
        parts.append(_cyclic(flat.moved(transform(turn, middle))))
    if shape.plate is not None:
        wide, deep, thick = edge * rng.uniform(0.8, 1.3), edge * rng.uniform(0.15, 0.4), rng.uniform(5, 10)
        along = np.array([1.0, 1.0, 0]) / np.sqrt(2)
        axes = np.column_stack([np.cross(along, [0, 0, 1.0]), along, [0, 0, 1.0]])
        middle = along * (edge / np.sqrt(2) + deep / 2) + [0, 0, shape.plate + thick / 2]
        parts.append(_cyclic(box((wide, deep, thick)).moved(transform(axes, middle))))
    return joined(parts)


def _cyclic(mesh: Mesh) -> Mesh:
    """The mesh with its axes permuted: the face z = 0 becomes the face x = 0."""
    return Mesh(mesh.vertices_mm[:, [2, 0, 1]], mesh.triangles, mesh.label)


def _face_with_holes(corners: NDArray, face: int, shape: JigShape, rng: np.random.Generator) -> list[Mesh]:
    """A convex face, triangulated around its screw holes, with the holes' walls and floors. corners  # (C, 3)"""
    flat = [i for i in range(3) if i != face]
    middles: list[NDArray] = []
    radius = rng.uniform(0.03, 0.06) * shape.edge
    for _ in range(200):
        middle = rng.uniform(0, shape.edge, 2)
        room = 1.6 * radius + shape.chamfer
        inside = middle.min() > room and middle.sum() < shape.edge - np.sqrt(2) * room - shape.tip_cut
        if inside and all(np.linalg.norm(middle - other) > 3 * radius for other in middles):
            middles.append(middle)
        if len(middles) >= shape.holes:
            break
    middles = middles[: shape.holes]
    angle = np.arange(_ROUND) * 2 * np.pi / _ROUND
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.vstack([corners[:, flat], *(m + ring for m in middles)])
    triangles = Delaunay(points).simplices
    of_hole = np.maximum((np.arange(len(points)) - len(corners)) // _ROUND, -1)
    of_hole[: len(corners)] = -1
    hole = of_hole[triangles]
    triangles = triangles[(hole[:, 0] < 0) | np.any(hole != hole[:, :1], axis=1)]
    vertices = np.zeros((len(points), 3))
    vertices[:, flat] = points
    parts = [Mesh(vertices, triangles, np.full(len(triangles), face))]
    for number, middle in enumerate(middles):
        rim = vertices[of_hole == number]
        floor = rim + 0.12 * shape.edge * np.eye(3)[face]
        centre = np.zeros((1, 3))
        centre[0, flat], centre[0, face] = middle, 0.12 * shape.edge
        here, following = np.arange(_ROUND), (np.arange(_ROUND) + 1) % _ROUND
        walls = np.vstack(
            [
                np.column_stack([here, following, here + _ROUND]),
                np.column_stack([following, following + _ROUND, here + _ROUND]),
                np.column_stack([here + _ROUND, following + _ROUND, np.full(_ROUND, 2 * _ROUND)]),
            ]
        )
        parts.append(Mesh(np.vstack([rim, floor, centre]), walls, np.full(len(walls), REST_OF_JIG)))
    return parts


def robot_behind(view_T_jig: NDArray, edge: float, rng: np.random.Generator, whole_cube: bool = False) -> list[Mesh]:
    """An adapter, a flange and two links that go away from the jig, or from a cube in its place, along its diagonal."""
    diagonal = view_T_jig[:3, :3] @ np.ones(3) / np.sqrt(3)
    base = view_T_jig[:3, 3] + diagonal * edge * (np.sqrt(3) if whole_cube else 1 / np.sqrt(3))
    turn = Rotation.align_vectors([diagonal], [[0, 0, 1.0]])[0]
    turn = (turn * Rotation.from_euler("z", rng.uniform(0, 360), degrees=True)).as_matrix()
    adapter = rng.uniform(4, 12)
    flange = base + adapter * diagonal
    parts = [
        box((edge * rng.uniform(0.5, 1.3), edge * rng.uniform(0.5, 1.3), adapter)).moved(
            transform(turn, base + diagonal * adapter / 2)
        ),
        rod(flange, flange + rng.uniform(15, 40) * diagonal, rng.uniform(0.5, 0.9) * edge),
    ]
    way = diagonal + rng.normal(0, 0.5, 3)
    elbow = flange + 120 * way / np.linalg.norm(way) + 30 * diagonal
    parts.append(rod(flange + 20 * diagonal, elbow, rng.uniform(30, 50)))
    parts.append(
        box((80, 100, 350)).moved(
            transform(Rotation.random(rng=rng).as_matrix(), elbow + _at(0, 0, 150) + rng.uniform(-60, 60, 3))
        )
    )
    return parts


def bracket(view_T_jig: NDArray, edge: float, rng: np.random.Generator) -> list[Mesh]:
    """Two plates at a right angle close to the jig, half of the time parallel to its faces."""
    long, wide, thick = edge * rng.uniform(0.5, 1.2), edge * rng.uniform(0.4, 1.0), rng.uniform(2, 5)
    foot = box((long, wide, thick)).moved(transform(np.eye(3), np.array([0, wide / 2, thick / 2])))
    upright = box((long, thick, wide)).moved(transform(np.eye(3), np.array([0, thick / 2, wide / 2])))
    turn = view_T_jig[:3, :3] @ np.roll(np.eye(3), rng.integers(3), axis=0)
    if rng.random() < 0.5:
        turn = Rotation.random(rng=rng).as_matrix()
    side = rng.uniform(0, 2 * np.pi)
    way = edge * rng.uniform(1.1, 1.5) * np.array([np.cos(side), np.sin(side), rng.uniform(0, 0.6)])
    place = transform(turn, view_T_jig[:3, 3] + way)
    return [foot.moved(place), upright.moved(place)]


def workshop(apex: NDArray, edge: float, rng: np.random.Generator) -> list[Mesh]:
    """Table, wall or walls, boxes and rods at random around and behind the jig."""
    parts = []
    turn = Rotation.from_euler("xyz", rng.uniform(-15, 15, 3), degrees=True).as_matrix()
    if rng.random() < 0.7:
        top = apex + _at(0, edge * rng.uniform(1.5, 3.0) + 20, 200)
        parts.append(box((1500, 40, 1200)).moved(transform(turn, top)))
    if rng.random() < 0.7:
        parts.append(box((3000, 3000, 20)).moved(transform(turn, apex + _at(0, 0, 4 * edge + rng.uniform(150, 600)))))
    if rng.random() < 0.4:
        parts.append(box((20, 3000, 3000)).moved(transform(turn, apex + _at(rng.choice([-1, 1]) * 5 * edge, 0, 100))))
    for _ in range(rng.integers(2, 6)):
        side, far = rng.uniform(0, 2 * np.pi), edge * rng.uniform(1.5, 3.5)
        place = apex + _at(far * np.cos(side), far * np.sin(side), edge * rng.uniform(0.3, 3))
        attitude = Rotation.random(rng=rng).as_matrix()
        if rng.random() < 0.6:
            parts.append(box(edge * rng.uniform(0.2, 1.2, 3)).moved(transform(attitude, place)))
        else:
            half = attitude[:, 0] * edge * rng.uniform(0.5, 1.5)
            parts.append(rod(place - half, place + half, edge * rng.uniform(0.05, 0.3)))
    return parts


def cable(apex: NDArray, edge: float, rng: np.random.Generator) -> list[Mesh]:
    """A cable that hangs through the view in front of the jig."""
    offset = edge * rng.uniform(-0.4, 0.4)
    turn = rng.uniform(0, np.pi)
    across, up = (
        np.array([np.cos(turn), np.sin(turn), 0]),
        np.array([-np.sin(turn), np.cos(turn), 0]),
    )
    share = np.linspace(-1, 1, 17)[:, None]
    line = apex + 4 * edge * share * across + (offset + 0.5 * edge * share**2) * up
    line[:, 2] -= rng.uniform(0.3, 1.2) * edge
    radius = rng.uniform(1.5, 3.5)
    return [rod(a, b, radius) for a, b in pairwise(line)]
