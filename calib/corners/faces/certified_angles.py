"""Fit of three planes under the certified angles of a jig: one rigid body instead of three free planes.

The three angles between the faces are three equations between the nine parameters of the planes. The best linear
estimate under them moves the parameters by -C J' (J C J')^-1 g, where C is their covariance, g the angles' misfit and J
its derivative; the covariance becomes C - C J' (J C J')^-1 J C. Nine unknowns become six, and the covariance of the
apex becomes smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from calib.array_types import Array
from calib.jig import FACE_PAIRS, angles_between_deg
from calib.planes.robust_fit import PlaneFit

MOST_MISFIT = 21.1
"""Squared misfit of three angles that a jig with the given angles exceeds once in 10 000 scans."""
_LEAST_MISFIT_MARGIN = 12.0  # by which the best labelling's squared misfit is below the next one's


@dataclass(frozen=True)
class RigidFit:
    """Planes fitted under the certified angles; where the angles cannot be used, the free planes and a note why."""

    moves: Array  # (9,) added to (h, s_1, s_2) of each plane; zeros where they are left free
    covariance: Array  # (9, 9)
    misfit: float  # squared, of three angles: 3 on average
    note: str = ""


def constrain_to_angles(
    planes: Sequence[PlaneFit], covariance: Array, face_angles_deg: tuple[float, float, float]
) -> RigidFit:
    """Corrections of the planes' heights and slopes that give the certified angles between the faces, with covariance.

    Which fitted face is which certified one is not known: the six labellings are tried, and the squared misfit of the
    best has to be less than that of the next by a margin, unless both give the same angles.
    """
    labellings = sorted({_angles(face_angles_deg, order) for order in permutations(range(3))})
    fits = [_constrain(planes, covariance, np.radians(angles_deg)) for angles_deg in labellings]
    fits.sort(key=lambda fit: fit.misfit)
    best = fits[0]
    if best.misfit > MOST_MISFIT:
        angles_text = ", ".join(f"{angle:.3f}" for angle in fitted_angles_deg(planes))
        return RigidFit(np.zeros(9), covariance, best.misfit, (
            f"the faces meet at {angles_text} deg, which the certified face_angles_deg do not explain "
            f"(squared misfit {best.misfit:.0f} of three angles); the planes were left free"
        ))  # fmt: skip
    if len(fits) > 1 and fits[1].misfit - best.misfit < _LEAST_MISFIT_MARGIN:
        return RigidFit(np.zeros(9), covariance, best.misfit, (
            "the certified face_angles_deg are too alike to tell which face is which in this scan; "
            "the planes were left free"
        ))  # fmt: skip
    return best


def fitted_angles_deg(planes: Sequence[PlaneFit]) -> tuple[float, float, float]:
    """Angles, deg, between fitted faces 1-2, 2-3 and 3-1: through a convex jig's material, or a concave jig's air."""
    return angles_between_deg(np.array([plane.normal for plane in planes]))


def angle_derivative(planes: Sequence[PlaneFit]) -> Array:
    """Derivatives (3, 9) of n_i . n_j, pairs 1-2, 2-3, 3-1, by the planes' heights and slopes.

    A slope s_k turns a normal n into n - s_1 e_1 - s_2 e_2.
    """
    derivative = np.zeros((3, 9))
    for row, (i, j) in enumerate(FACE_PAIRS):
        derivative[row, 3 * i + 1 : 3 * i + 3] = -planes[i].axes @ planes[j].normal
        derivative[row, 3 * j + 1 : 3 * j + 3] = -planes[j].axes @ planes[i].normal
    return derivative


def turned_normals(planes: Sequence[PlaneFit], moves: Array) -> Array:
    """Unit normals (3, 3) of the planes after their heights and slopes are moved by `moves` (9,)."""
    turned = np.array([p.normal - moves[3 * i + 1 : 3 * i + 3] @ p.axes for i, p in enumerate(planes)])
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def _angles(angles_deg: tuple[float, float, float], order: tuple[int, ...]) -> tuple[float, float, float]:
    """Certified angles, deg, between fitted faces 1-2, 2-3, 3-1 if fitted face i is the certificate's order[i]."""
    between = {frozenset(pair): angle for pair, angle in zip(FACE_PAIRS, angles_deg, strict=True)}
    first, second, third = (between[frozenset((order[i], order[j]))] for i, j in FACE_PAIRS)
    return first, second, third


def _constrain(planes: Sequence[PlaneFit], covariance: Array, angles_rad: Array) -> RigidFit:
    """Corrections of the planes' heights and slopes, and their covariance, that give three angles in known order."""
    derivative = angle_derivative(planes)
    gain = covariance @ derivative.T @ np.linalg.inv(derivative @ covariance @ derivative.T)
    moves, misfit = np.zeros(9), 0.0
    for _ in range(4):
        normals = turned_normals(planes, moves)
        off = np.array([normals[i] @ normals[j] for i, j in FACE_PAIRS]) + np.cos(angles_rad)
        moves = gain @ (derivative @ moves - off)
        misfit = misfit or float(off @ np.linalg.solve(derivative @ covariance @ derivative.T, off))
    return RigidFit(moves, covariance - gain @ derivative @ covariance, misfit)
