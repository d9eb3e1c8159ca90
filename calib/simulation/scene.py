"""Surfaces in the view of a simulated scanner: the jig on its flange, part of the arm behind, a wall and a table.

The jig's frame has its origin in the apex and z along the jig's axis, away from the scanner: a convex jig lies at
z > 0, and flange and arm lie behind it. Wall and table are fixed to the scanner. For a scanner on the arm the jig is on
a post and a plate, and nothing is fixed to the scanner. Lengths are mm.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.array_types import Array
from calib.frames import apply
from calib.jig import Jig, jig_geometry

CUBE_CORNER = Jig()

_PLATE_MM = (260.0, 220.0, 12.0)

SCENE = 0
"""Label of a surface other than the jig's faces, which have 1, 2, 3."""


def scene_triangles(
    scanner_T_jig: Array, jig: Jig, *, flange_mm: float, arm_turn_rad: float, background: tuple[float, float] | None
) -> tuple[Array, NDArray[np.int8]]:
    """Triangles of all surfaces in the scene (T, 3, 3), in the scanner's frame, and their labels (T,).

    background: distances of the wall behind and the table below the scanner, mm; None: the jig is on its own plate.
    """
    import trimesh

    edges, _ = jig_geometry(jig)
    apex = np.zeros(3)
    faces = np.array([[apex, edges[1], edges[2]], [apex, edges[2], edges[0]], [apex, edges[0], edges[1]]])
    back_mm = float(edges[:, 2].mean()) if jig.convex else 2.0
    flange_mm = max(flange_mm, back_mm + 1.0)  # a tool row shorter than the jig: the jig is on the flange itself

    def cylinder(radius_mm: float, start_mm: float, length_mm: float) -> Any:
        middle = trimesh.transformations.translation_matrix([0.0, 0.0, start_mm + 0.5 * length_mm])
        return trimesh.creation.cylinder(radius_mm, length_mm, sections=64, transform=middle)

    post = cylinder(14.0, back_mm, flange_mm - back_mm)
    body = [edges[None, ::-1]] if jig.convex else []  # the cut face
    if background is None:
        plate = trimesh.creation.box(
            _PLATE_MM, trimesh.transformations.translation_matrix([0.0, 0.0, flange_mm + 0.5 * _PLATE_MM[2]])
        )
        standing = np.concatenate([faces, *body, post.triangles, plate.triangles])
        return apply(scanner_T_jig, standing), _labels(len(standing))
    across = trimesh.transformations.rotation_matrix(
        arm_turn_rad, [0, 0, 1]
    ) @ trimesh.transformations.translation_matrix([30.0, 0.0, flange_mm + 110.0])
    across = across @ trimesh.transformations.rotation_matrix(0.5 * np.pi, [0, 1, 0])
    parts = [
        post,
        cylinder(37.5, flange_mm, 12.0),
        cylinder(42.0, flange_mm + 12.0, 140.0),
        trimesh.creation.cylinder(46.0, 190.0, sections=64, transform=across),
    ]
    arm = np.concatenate([*body, *(part.triangles for part in parts)])
    wall_z_mm, table_y_mm = background
    side = 3000.0
    wall = _quad([-side, -side, wall_z_mm], [2 * side, 0, 120.0], [0, 2 * side, 0])
    table = _quad([-side, table_y_mm, 300.0], [2 * side, 0, 0], [0, 0, side])
    triangles = np.concatenate([apply(scanner_T_jig, np.concatenate([faces, arm])), wall, table])
    return triangles, _labels(len(triangles))


def _labels(count: int) -> NDArray[np.int8]:
    """Labels (count,) of triangles of which the first three are the jig's faces."""
    label = np.zeros(count, dtype=np.int8)
    label[:3] = (1, 2, 3)
    return label


def _quad(corner: list[float], side: list[float], other_side: list[float]) -> Array:
    """Parallelogram as two triangles (2, 3, 3), from a corner and its two sides."""
    p, u, v = np.array(corner), np.array(side), np.array(other_side)
    return np.array([[p, p + u, p + u + v], [p, p + u + v, p + v]])
