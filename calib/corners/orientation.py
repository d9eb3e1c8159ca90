"""The jig's orientation in the scanner's frame, from the three planes that meet in the corner.

**The jig's frame** has its origin in the apex. Its x, y and z axes are the normals of faces 1, 2 and 3, toward the
scanner's side, which is right-handed for convex and concave jigs alike. Where the faces are not square, their normals N
(rows) satisfy N N^T = G with G_ij = -cos f_ij of the dihedral angles, and the frame is the right-handed one that lies
closest to them: N = G^(1/2), the symmetric root, whose closest rotation is the identity.

Three equal faces look alike under rotations by 120 degrees: `candidates` gives all three orientations,
`calib.measurement.face_labels` selects one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.corners.faces.angles import MOST_MISFIT
from calib.corners.intersection import Corner
from calib.jig import Jig, jig_normals
from calib.planes.robust_fit import height_lever

_STEPS = 6
_NULL = 1e-8  # of a covariance's largest eigenvalue: certified angles leave three of six slopes no freedom


@dataclass(frozen=True)
class Orientation:
    """The jig's orientation under one labelling of its faces."""

    scanner_R_jig: Array  # (3, 3)
    covariance_rad2: Array  # (3, 3) of the small turn w in the scanner's frame: true = exp(w) scanner_R_jig
    cross_mm_rad: Array  # (3, 3) covariance of the apex's error (rows, mm) with that turn (columns)
    order: tuple[int, int, int]  # which of the corner's faces are the jig's faces 1, 2, 3
    misfit: float  # squared, of the angles found between the faces and the jig's: 3 on average for free planes

    def quaternion(self) -> Array:
        """Quaternion (4,) w, x, y, z of scanner_R_jig, w >= 0."""
        return frames.quaternion_from_rotation(self.scanner_R_jig)

    def sigma_rad(self) -> float:
        """Standard deviation of the rotation over all three axes: sqrt(trace of the covariance)."""
        return float(np.sqrt(np.trace(self.covariance_rad2)))


def candidates(corner: Corner, jig: Jig) -> tuple[Orientation, Orientation, Orientation]:
    """Orientations under each of the three cyclic labellings; the first begins with the corner's first face.

    Raises CornerError for angles that no jig can have.
    """
    known = jig_normals(jig.face_angles_deg)
    normals = np.array([face.normal for face in corner.faces])
    one, two, three = (0, 1, 2) if np.linalg.det(normals) > 0.0 else (0, 2, 1)
    first = _orient(corner, known, (one, two, three))
    if len(set(jig.face_angles_deg)) == 1:  # another labelling permutes the columns
        turned = first.scanner_R_jig
        return (
            first,
            replace(first, scanner_R_jig=turned[:, [1, 2, 0]], order=(two, three, one)),
            replace(first, scanner_R_jig=turned[:, [2, 0, 1]], order=(three, one, two)),
        )
    return (first, _orient(corner, known, (two, three, one)), _orient(corner, known, (three, one, two)))


def oriented(corner: Corner, jig: Jig, order: tuple[int, int, int]) -> Orientation:
    """Orientation with the corner's faces labelled in the order of one of the `candidates`.

    Raises CornerError for angles that no jig can have.
    """
    return _orient(corner, jig_normals(jig.face_angles_deg), order)


def _orient(corner: Corner, known: Array, order: tuple[int, int, int]) -> Orientation:
    """Orientation by least squares on the rotations (a weighted Wahba problem), Gauss-Newton from the unweighted one.

    A plane's slopes s say that its true normal is n - s_1 e_1 - s_2 e_2. For a jig with orientation R the slopes would
    be s_k = -e_k . R m, m the known normal; the measured slopes are zeros with the planes' covariance. A small rotation
    w changes s_k by -(R m x e_k) . w. Under certified angles the covariance has rank 3; the weight is its
    pseudo-inverse.
    """
    free = corner.without_held_angles  # these would count twice
    normals = np.array([free.faces[i].normal for i in order])
    axes = np.array([free.faces[i].axes for i in order])  # (3, 2, 3)
    slopes = np.array([[3 * i + 1, 3 * i + 2] for i in order]).ravel()
    covariance = free.plane_covariance[np.ix_(slopes, slopes)]
    weight = np.linalg.pinv(0.5 * (covariance + covariance.T), rcond=_NULL, hermitian=True)
    scanner_R_jig = frames.best_fit_rotation(known, normals)
    for _ in range(_STEPS):
        turned = known @ scanner_R_jig.T
        slope = -np.einsum("ikj,ij->ik", axes, turned).ravel()
        by_turn = -np.cross(turned[:, None], axes).reshape(6, 3)
        information = by_turn.T @ weight @ by_turn
        step = -np.linalg.solve(information, by_turn.T @ weight @ slope)
        scanner_R_jig = frames.rotation_from_rotvec(step) @ scanner_R_jig
        if np.linalg.norm(step) < 1e-13:
            break
    residual = slope + by_turn @ step
    misfit = float(residual @ weight @ residual)
    # Where the faces do not meet at the jig's angles, the result depends on the weights; the covariance grows with it.
    wider = misfit / 3.0 if misfit > MOST_MISFIT else 1.0
    turn_covariance = np.linalg.inv(information)
    by_planes = turn_covariance @ by_turn.T @ weight  # (3, 6) the turn w by errors of the slopes
    cross = _apex_by_planes(corner) @ corner.plane_covariance[:, slopes] @ by_planes.T
    return Orientation(scanner_R_jig, wider * turn_covariance, np.sqrt(wider) * cross, order, misfit)


def _apex_by_planes(corner: Corner) -> Array:
    """Derivatives (3, 9) of the apex, mm, by height h and slopes s_1, s_2 of each of the three planes."""
    normals = np.array([face.normal for face in corner.faces])
    return np.linalg.solve(normals, height_lever(corner.faces, corner.xyz_mm))
