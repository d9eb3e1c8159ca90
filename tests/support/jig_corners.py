"""Corners with chosen normals and noise, for tests of orientations and face labels: no scan, no search."""

from __future__ import annotations

from typing import cast

import numpy as np
from scipy.spatial.transform import Rotation

from calib.corners.intersection import Corner, Face
from calib.corners.quality import CornerQuality
from calib.jig import Jig

UNEVEN = Jig(face_angles_deg=(88.0, 91.0, 90.5))


def corner_of(
    normals: np.ndarray, rng: np.random.Generator, *, sigma_rad: float = 1e-4, apex: np.ndarray | None = None
) -> Corner:
    """A corner with these normals (3, 3), found with noise of an uneven covariance, each face's axes drawn."""
    apex = np.array([0.0, 0.0, 700.0]) if apex is None else apex
    root = rng.normal(size=(9, 9)) * np.tile([0.01, sigma_rad, sigma_rad], 3)[:, None]
    covariance = root @ root.T
    noise = root @ rng.normal(size=9)
    faces = []
    for i, normal in enumerate(normals):
        first = np.cross(normal, rng.normal(size=3))
        first /= np.linalg.norm(first)
        axes = np.array([first, rng.choice([-1.0, 1.0]) * np.cross(normal, first)])
        turned = normal + noise[3 * i + 1 : 3 * i + 3] @ axes  # true = found - s e
        found = turned / np.linalg.norm(turned)
        axes = axes - np.outer(axes @ found, found)
        own = covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3]
        faces.append(Face(found, float(found @ apex), apex, 9, 0.02, np.zeros(0, int), i, axes, own))
    quality = cast(CornerQuality, None)
    return Corner(apex, 1e-4 * np.eye(3), (faces[0], faces[1], faces[2]), covariance, quality, Jig().outlines()[0])


def error_rad(true: np.ndarray, found: np.ndarray) -> np.ndarray:
    """The rotation vector of true @ found^T."""
    return np.asarray(Rotation.from_matrix(true @ found.T).as_rotvec())
