"""Rigid transforms as (..., 4, 4) arrays.

A transform's name says what it maps: `base_T_flange` takes flange coordinates to base coordinates, so names chain as
they multiply: `base_T_target = base_T_flange @ flange_T_target`. Lengths are millimetres.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array


def make_transform(rotation: ArrayLike, translation_mm: ArrayLike) -> Array:
    """Transforms (..., 4, 4) made of rotations (..., 3, 3) and translations (..., 3) in mm."""
    rotation = np.asarray(rotation, dtype=float)
    translation_mm = np.asarray(translation_mm, dtype=float)
    shape = np.broadcast_shapes(rotation.shape[:-2], translation_mm.shape[:-1])
    transform = np.zeros((*shape, 4, 4))
    transform[..., :3, :3] = rotation
    transform[..., :3, 3] = translation_mm
    transform[..., 3, 3] = 1.0
    return transform


def invert(a_T_b: ArrayLike) -> Array:
    """Inverses b_T_a (..., 4, 4) of rigid transforms a_T_b."""
    a_T_b = np.asarray(a_T_b, dtype=float)
    b_R_a = np.swapaxes(a_T_b[..., :3, :3], -1, -2)
    return make_transform(b_R_a, -np.einsum("...ij,...j->...i", b_R_a, a_T_b[..., :3, 3]))


def apply(a_T_b: ArrayLike, points_b_mm: ArrayLike) -> Array:
    """Points (..., 3) of frame b in frame a; the leading axes broadcast."""
    a_T_b = np.asarray(a_T_b, dtype=float)
    return np.einsum("...ij,...j->...i", a_T_b[..., :3, :3], np.asarray(points_b_mm, float)) + a_T_b[..., :3, 3]


def rotation_from_rotvec(rotvec_rad: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) that turn by |rotvec| about rotvec (..., 3)."""
    rotvec_rad = np.asarray(rotvec_rad, dtype=float)
    half = 0.5 * np.linalg.norm(rotvec_rad, axis=-1, keepdims=True)
    # np.sinc(x) is sin(pi x) / (pi x), and 1 at zero
    return rotation_from_quaternion(np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * rotvec_rad], axis=-1))


def rotvec_from_rotation(rotation: ArrayLike) -> Array:
    """Rotation vectors (..., 3) of rotation matrices (..., 3, 3)."""
    quaternion = quaternion_from_rotation(rotation)
    scalar, vector = quaternion[..., :1], quaternion[..., 1:]
    half = np.arctan2(np.linalg.norm(vector, axis=-1, keepdims=True), scalar)
    return 2.0 * vector / np.sinc(half / np.pi)


def rotation_from_quaternion(quaternion: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions w, x, y, z (..., 4), which are scaled to length 1."""
    quaternion = np.asarray(quaternion, dtype=float)
    unit = quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
    scalar, vector = unit[..., 0, None, None], unit[..., 1:]
    outer = vector[..., :, None] * vector[..., None, :]
    square = scalar**2 - np.trace(outer, axis1=-2, axis2=-1)[..., None, None]
    return square * np.eye(3) + 2.0 * (outer + scalar * skew(vector))


def quaternion_from_rotation(rotation: ArrayLike) -> Array:
    """Unit quaternions w, x, y, z (..., 4) of rotation matrices (..., 3, 3), w being 0 or above.

    Each row of the table below is 4 q_k q; the one of the largest q_k loses no digits (Markley 2008).
    """
    m = np.asarray(rotation, dtype=float)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    wx, wy, wz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    rows = [
        [1.0 + xx + yy + zz, wx, wy, wz],
        [wx, 1.0 + xx - yy - zz, xy, xz],
        [wy, xy, 1.0 - xx + yy - zz, yz],
        [wz, xz, yz, 1.0 - xx - yy + zz],
    ]
    table = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    largest = np.argmax(np.diagonal(table, axis1=-2, axis2=-1), axis=-1)
    found = np.take_along_axis(table, largest[..., None, None], axis=-2)[..., 0, :]
    found = found * np.where(found[..., :1] < 0.0, -1.0, 1.0)
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


def rotation_from_rpy(rpy_rad: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of turns about fixed axes x, y, z (..., 3): Rz(yaw) Ry(pitch) Rx(roll)."""
    roll, pitch, yaw = np.moveaxis(np.asarray(rpy_rad, dtype=float), -1, 0)
    cr, sr, cp, sp, cy, sy = (np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw))
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rpy_from_rotation(rotation: ArrayLike) -> Array:
    """Roll, pitch, yaw (3,) of a rotation (3, 3), the inverse of `rotation_from_rpy`.

    At a pitch of +-90 deg roll and yaw are one turn, and roll is set to zero. By atan2, so exact to rounding there too.
    """
    R = np.asarray(rotation, dtype=float)
    level = np.hypot(R[0, 0], R[1, 0])  # cos(pitch)
    yaw = np.arctan2(R[1, 0], R[0, 0]) if level > 1e-15 else np.arctan2(-R[0, 1], R[1, 1])
    cy, sy = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-R[2, 0], cy * R[0, 0] + sy * R[1, 0])
    roll = np.arctan2(sy * R[0, 2] - cy * R[1, 2], cy * R[1, 1] - sy * R[0, 1])
    return np.array([roll, pitch, yaw])


def wrapped_angle(angle_rad: float) -> float:
    """The angle from -pi to pi, rad, of the same turn."""
    return math.remainder(angle_rad, math.tau)


def skew(vectors: ArrayLike) -> Array:
    """Cross-product matrices (..., 3, 3): `skew(v) @ w` is `v x w`."""
    v = np.asarray(vectors, dtype=float)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def frames_by_name(frame_of_name: Mapping[str, Array], names: Iterable[object]) -> Array:
    """Frames (N, 4, 4) of names, one for each name."""
    return np.stack([frame_of_name[str(name)] for name in names])


def frame_motion(points_mm: Array, centre_mm: Array) -> Array:
    """Derivative (N, 3, 6) of points (N, 3) by a frame's small motion: a shift, and a turn about a centre (3,)."""
    eye = np.broadcast_to(np.eye(3), (len(points_mm), 3, 3))
    return np.concatenate([eye, -skew(points_mm - centre_mm)], axis=-1)


def best_fit_transform(source_mm: ArrayLike, target_mm: ArrayLike, weights: ArrayLike | None = None) -> Array:
    """Rigid motion target_T_source (4, 4) from source (N, 3) to target (N, 3) with the least weighted squared error.

    Closed form by SVD (Kabsch 1976, Umeyama 1991), reflections excluded. Points on a line leave the rotation about it
    undetermined; the result is then one of the motions that fit equally well.
    """
    source = np.asarray(source_mm, dtype=float)
    target = np.asarray(target_mm, dtype=float)
    w = np.ones(len(source)) if weights is None else np.asarray(weights, dtype=float)
    w = w / w.sum()
    source_mean, target_mean = w @ source, w @ target
    covariance = (target - target_mean).T @ (w[:, None] * (source - source_mean))
    rotation = nearest_rotation(covariance)
    return make_transform(rotation, target_mean - rotation @ source_mean)


def best_fit_rotation(source: ArrayLike, target: ArrayLike) -> Array:
    """Rotation (3, 3) that takes directions source (N, 3) to target (N, 3) with the least squared error.

    With their opposites the directions lie about the origin, so that the best rigid motion has no translation.
    """
    source, target = np.asarray(source, dtype=float), np.asarray(target, dtype=float)
    return best_fit_transform(np.concatenate([source, -source]), np.concatenate([target, -target]))[:3, :3]


def nearest_rotation(matrix: Array) -> Array:
    """Rotations (..., 3, 3) nearest to matrices in the Frobenius norm, by SVD."""
    u, _, vt = np.linalg.svd(matrix)
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    return np.asarray(u @ vt)


def mean_rotation(rotations: ArrayLike) -> Array:
    """Rotation (3, 3) with the least sum of squared Frobenius distances to rotations (K, 3, 3), by SVD."""
    return nearest_rotation(np.mean(np.asarray(rotations, dtype=float), axis=0))
