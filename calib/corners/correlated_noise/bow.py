"""What one scan tells of the bows of its jig's faces, and its planes as they follow from known bows.

A face's bow is its height over the plane that is nearest to all of it, a polynomial of degree 4 of two coordinates
along its edges from the apex: 12 coefficients c, each the root mean square, mm, of a part of the bow over the face.
With the planes' heights and slopes p the mean heights m of patches are

    m = D p + Q c + e,     e of covariance W from white noise and the scanner's correlated error,

so that given c the generalised least squares estimate of p is p_0 - G c, and the scan's log likelihood of c is
h' c - c' S c / 2, with N = [D Q]' W^-1 [D Q], r = [D Q]' W^-1 m and

    G = N_DD^-1 N_DQ,   p_0 = N_DD^-1 r_D,   S = N_QQ - N_QD G,   h = r_Q - N_QD p_0.

One scan hardly tells a bow from the scanner's error; many of one jig do (`calib.corners.face_bows`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.corners.correlated_noise.patches import Patches
from calib.planes.robust_fit import PlaneFit

QUADRATIC, TERMS = 3, 12
"""Coefficients of one face's bow: of degree 2, and up to degree 4."""
_POWERS = tuple((degree - k, k) for degree in range(5) for k in range(degree + 1))
_NODES = 6  # by which polynomials of degree 11 are integrated exactly
_SHOWS = 15.0  # squared residual that quadratic bows take away, 9 on average in white noise, from which they are shown


@dataclass(frozen=True)
class BowEvidence(Brief):
    """One scan's likelihood of the bows c (36,) of its faces, taken right-handedly round the apex, and its planes by c.

    Planes are told by heights, mm, and slopes, rad (9,), from those of the corner that holds this, in its own order.
    """

    order: tuple[int, int, int]  # the corner's faces, right-handedly round the apex
    gradient: Array  # (36,) h
    information: Array  # (36, 36) S, 1 / mm^2
    moves: Array  # (9,) p_0
    by_bows: Array  # (9, 36) G
    covariance: Array  # (9, 9) of the planes, given the bows
    rectangular: bool
    shown: bool  # whether the scan by itself shows more of a bow than noise would

    @property
    def at_apex(self) -> Array:
        """Moves (9, 36) of the planes by which they pass through the bowed faces' heights at the apex."""
        out = np.zeros((9, 3 * TERMS))
        for place, face in enumerate(self.order):
            out[3 * face, TERMS * place : TERMS * (place + 1)] = heights(np.zeros((1, 2)), self.rectangular)[0]
        return out

    def from_planes(self, moves: Array, further: Array) -> BowEvidence:
        """The same from planes moved by (9,), with a further covariance (9, 9) of these."""
        return replace(self, moves=self.moves - moves, covariance=self.covariance + further)


@lru_cache(maxsize=2)
def _coefficients(rectangular: bool) -> Array:
    """Coefficients (15, 12) of the powers in each part of a bow: mean square 1 over a face, and mean plane 0."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    u, v = (x.ravel() for x in np.meshgrid(nodes, nodes))
    weight = np.outer(weights, weights).ravel()
    if not rectangular:  # u + v < 1
        u, v, weight = u, v * (1.0 - u), 2.0 * weight * (1.0 - u)
    rows = _powers(np.column_stack([u, v])) * np.sqrt(weight)[:, None]
    inverse = np.linalg.inv(np.linalg.qr(rows)[1])
    return inverse[:, 3:]


def _powers(at: Array) -> Array:
    return np.column_stack([at[:, 0] ** i * at[:, 1] ** k for i, k in _POWERS])


def heights(at: Array, rectangular: bool) -> Array:
    """Heights (B, 12) of the parts of a bow at places (B, 2): along both edges from the apex, in edge lengths."""
    return _powers(at) @ _coefficients(rectangular)


def right_handed(normals: Array) -> tuple[int, int, int]:
    """Order in which three faces with normals (3, 3), toward the scanner, follow each other right-handedly."""
    return (0, 1, 2) if np.linalg.det(normals) > 0 else (2, 1, 0)


def bow_columns(planes: Sequence[PlaneFit], patches: Sequence[Patches], edge_mm: float, rectangular: bool) -> Array:
    """Heights (B, 36) of the bows' parts at the patches of three faces, face by face as these are given."""
    order = right_handed(np.array([plane.normal for plane in planes]))
    blocks = []
    for face, (plane, of_face) in enumerate(zip(planes, patches, strict=True)):
        middles = plane.centre_mm + of_face.design[:, 1:] @ plane.axes
        place = order.index(face)
        ends = [planes[order[(place + k) % 3]] for k in (1, 2)]
        at = np.column_stack([np.abs(middles @ p.normal - p.offset_mm) for p in ends]) / edge_mm
        block = np.zeros((len(middles), 3 * TERMS))
        block[:, TERMS * place : TERMS * (place + 1)] = heights(at, rectangular)
        blocks.append(block)
    return np.concatenate(blocks)


def quadratic(columns: Array) -> Array:
    """(..., 9) of (..., 36) those of degree 2."""
    return columns[..., [TERMS * face + k for face in range(3) for k in range(QUADRATIC)]]


def shows_bows(mean_mm: Array, variance_mm2: Array, design: Array, columns: Array) -> bool:
    """Whether quadratic bows take more of the patches' means (B,) away than they would of noise."""
    root = np.sqrt(variance_mm2)
    basis = np.linalg.qr(design / root[:, None])[0]
    rows = np.column_stack([quadratic(columns), mean_mm]) / root[:, None]
    rows = rows - basis @ (basis.T @ rows)
    taken = np.linalg.qr(rows[:, :-1])[0].T @ rows[:, -1]
    return bool(taken @ taken > _SHOWS)


def bow_evidence(
    planes: Sequence[PlaneFit],
    mean_mm: Array,
    design: Array,
    columns: Array,
    covariance: Array,
    *,
    rectangular: bool,
    shown: bool,
) -> BowEvidence:
    """Evidence of patches' mean heights (B,), of covariance (B, B), with rows (B, 9) by planes and (B, 36) by bows."""
    root = np.linalg.cholesky(covariance)
    rows = np.linalg.solve(root, np.column_stack([design, columns, mean_mm]))
    normal_matrix = rows.T @ rows
    own = slice(0, design.shape[1])
    bows = slice(design.shape[1], -1)
    of_planes = np.linalg.inv(normal_matrix[own, own])
    by_bows = of_planes @ normal_matrix[own, bows]
    moves = of_planes @ normal_matrix[own, -1]
    information = normal_matrix[bows, bows] - normal_matrix[bows, own] @ by_bows
    return BowEvidence(
        right_handed(np.array([plane.normal for plane in planes])),
        normal_matrix[bows, -1] - normal_matrix[bows, own] @ moves,
        0.5 * (information + information.T),
        moves,
        by_bows,
        of_planes,
        rectangular,
        shown,
    )
