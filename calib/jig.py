"""The jig that the scanner measures: three faces that meet in one apex (Jang 2025, section 2), and its geometry.

With dihedral angles f_ij between faces i and j (in the material of a convex jig, in the air of a concave one) the unit
normals toward the scanner's side satisfy n_i . n_j = -cos f_ij. Three angles belong to a corner if and only if the
matrix of these products, the Gram matrix, is positive definite.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from calib.array_types import Array, Vector
from calib.errors import CornerError

FACE_PAIRS = ((0, 1), (1, 2), (2, 0))
"""The pairs of faces in the order in which angles between faces are given: 1-2, 2-3, 3-1."""
_LEAST_EIGENVALUE = 1e-6  # of the Gram matrix; at zero the three normals lie in one plane


@dataclass(frozen=True)
class Outline:
    """Outline of the three faces of a jig, seen from the apex.

    Edge i does not lie in face i: it is the common border of the other two faces.
    """

    edges_mm: Vector
    rectangular: bool = False  # whole rectangles; otherwise triangles, cut off from edge end to edge end


@dataclass(frozen=True)
class Jig:
    """A trihedral corner: three faces, edges of known length, an apex.

    `edge_mm` is the length of the edges that leave the apex: one number for a jig whose faces are triangles with equal
    legs; three, in any order, for a target with three different edges, such as a box, whose faces are rectangles or
    triangles: a scan shows which. `convex` is true where the apex points at the scanner (a corner of a solid), false
    for the inside of a box. `face_angles_deg` are the angles between faces 1-2, 2-3 and 3-1; `certified` says that they
    were measured well enough to fit the faces as one rigid body.
    """

    shape: str = "trihedral"
    edge_mm: float | Vector = 60.0
    convex: bool = True
    face_angles_deg: Vector = (90.0, 90.0, 90.0)
    certified: bool = False

    @property
    def edges_mm(self) -> Vector:
        """Lengths of edges 1, 2 and 3; edge i is the one that does not lie in face i."""
        if isinstance(self.edge_mm, tuple):
            return self.edge_mm
        return (self.edge_mm, self.edge_mm, self.edge_mm)

    @property
    def shortest_mm(self) -> float:
        """Length of the shortest edge."""
        return min(self.edges_mm)

    @property
    def longest_mm(self) -> float:
        """Length of the longest edge."""
        return max(self.edges_mm)

    def edges_text(self) -> str:
        """The edges in a sentence: "edge 60 mm", or "edges 70, 110 and 160 mm"."""
        if isinstance(self.edge_mm, tuple):
            one, two, three = self.edge_mm
            return f"edges {one:g}, {two:g} and {three:g} mm"
        return f"edge {self.edge_mm:g} mm"

    def outlines(self) -> tuple[Outline, ...]:
        """Outlines that a scan of the jig may show: every order of the edges; for three lengths, either face shape."""
        if not isinstance(self.edge_mm, tuple):
            return (Outline(self.edges_mm),)
        orders = sorted({(one, two, three) for one, two, three in permutations(self.edge_mm)})
        return tuple(Outline(order, shape) for shape in (True, False) for order in orders)

    def out_of_square_deg(self) -> float:
        """Largest difference of an angle between two faces from 90 degrees."""
        return max(abs(angle - 90) for angle in self.face_angles_deg)


def angles_between_deg(normals: Array) -> Vector:
    """Angles between faces 1-2, 2-3 and 3-1 with unit normals (3, 3), one per row: f_ij = arccos(-n_i . n_j)."""
    first, second, third = (
        float(np.degrees(np.arccos(np.clip(-normals[i] @ normals[j], -1, 1)))) for i, j in FACE_PAIRS
    )
    return first, second, third


def jig_normals(face_angles_deg: Vector) -> Array:
    """Unit normals N (3, 3) of the faces, one per row, in the jig's own frame: N = G^(1/2), the symmetric root.

    The frame's axes are the faces' normals where the faces are square; otherwise it is the right-handed frame that lies
    closest to the normals.

    Raises:
        CornerError: no corner has such angles between faces 1-2, 2-3 and 3-1.
    """
    values, vectors = np.linalg.eigh(_gram_matrix(face_angles_deg))
    return (vectors * np.sqrt(values)) @ vectors.T


def jig_geometry(jig: Jig) -> tuple[Array, Array]:
    """Edge ends (3, 3), mm, and face normals (3, 3) toward the scanner's side, one per row, in the jig's model frame.

    That frame has its origin in the apex and z along the jig's axis, the mean of its edges, away from the scanner; x
    lies in the plane of z and the first face's normal. Face i is the triangle between the apex and the two edges that
    are not edge i.

    Raises:
        CornerError: no corner has the jig's face angles.
    """
    normals = np.linalg.cholesky(_gram_matrix(jig.face_angles_deg))
    edges = np.cross(normals[[1, 2, 0]], normals[[2, 0, 1]])
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    edges *= -np.sign(np.einsum("ij,ij->i", edges, normals))[:, None]  # edge i leaves face i's plane inwards
    axis = edges.sum(axis=0) / np.linalg.norm(edges.sum(axis=0))
    across = normals[0] - axis * (normals[0] @ axis)
    across /= np.linalg.norm(across)
    jig_R_raw = np.stack([across, np.cross(axis, across), axis])
    edges, normals = edges @ jig_R_raw.T, normals @ jig_R_raw.T
    if not jig.convex:  # seen from the inside: the apex is deepest, the edges come towards the scanner
        edges, normals = edges * [1, 1, -1], -normals * [1, 1, -1]
    return np.array(jig.edges_mm)[:, None] * edges, normals


def _gram_matrix(face_angles_deg: Vector) -> Array:
    """Gram matrix (3, 3) of the face normals, n_i . n_j = -cos f_ij. Raises CornerError where no corner has it."""
    gram = np.eye(3)
    for (i, j), angle in zip(FACE_PAIRS, np.radians(face_angles_deg), strict=True):
        gram[i, j] = gram[j, i] = -np.cos(angle)
    if np.linalg.eigvalsh(gram)[0] < _LEAST_EIGENVALUE:
        raise CornerError(
            f"jig: no corner has faces at {list(face_angles_deg)} degrees; correct face_angles_deg in dataset.toml"
        )
    return gram
