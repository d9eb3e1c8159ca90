"""Angles between fitted faces, and their derivatives by the planes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from calib.array_types import Array
from calib.jig import FACE_PAIRS, angles_between_deg

MOST_MISFIT = 21.1
"""Squared misfit of three angles that a jig with the given angles exceeds once in 10 000 scans."""


class Plane(Protocol):
    """Protocol of a plane of which the normal and two in-plane directions are known."""

    @property
    def normal(self) -> Array: ...  # (3,) unit

    @property
    def axes(self) -> Array: ...  # (2, 3) unit


def fitted_angles_deg(planes: Sequence[Plane]) -> tuple[float, float, float]:
    """Angles, deg, between fitted faces 1-2, 2-3 and 3-1: through a convex jig's material, or a concave jig's air."""
    return angles_between_deg(np.array([plane.normal for plane in planes]))


def angle_derivative(planes: Sequence[Plane]) -> Array:
    """Derivatives (3, 9) of n_i . n_j, pairs 1-2, 2-3, 3-1, by the planes' heights and slopes.

    A slope s_k turns a normal n into n - s_1 e_1 - s_2 e_2.
    """
    derivative = np.zeros((3, 9))
    for row, (i, j) in enumerate(FACE_PAIRS):
        derivative[row, 3 * i + 1 : 3 * i + 3] = -planes[i].axes @ planes[j].normal
        derivative[row, 3 * j + 1 : 3 * j + 3] = -planes[j].axes @ planes[i].normal
    return derivative


def turned_normals(planes: Sequence[Plane], moves: Array) -> Array:
    """Unit normals (3, 3) of the planes after their heights and slopes are moved by `moves` (9,)."""
    turned = np.array([p.normal - moves[3 * i + 1 : 3 * i + 3] @ p.axes for i, p in enumerate(planes)])
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)
