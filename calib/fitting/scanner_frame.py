"""Scanner frame of a setup: the rigid motion from predicted to measured points that fits best, and its derivatives."""

from __future__ import annotations

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.errors import FitError
from calib.statistics import axis_variances


def fit_scanner_frame(base_mm: Array, scanner_mm: Array, covariance_mm2: Array, whiten: Array | None = None) -> Array:
    """Transform scanner_T_base (4, 4) that minimises sum (T b - s)^T C^-1 (T b - s) over predicted b and measured s.

    Closed form (`frames.best_fit_transform`) for isotropic covariances; Gauss-Newton from there for others. Collinear
    points leave one turn undetermined; the result is then one of the equally good frames.

    Args:
        base_mm: (M, 3) predicted points, base frame.
        scanner_mm: (M, 3) measured points, scanner frame.
        covariance_mm2: (M, 3, 3) of the measured points.
        whiten: (M, 1, 3) what whitens lengths, whose frame has the base's axes and only an origin of its own.
    """
    if whiten is not None:
        scanner_T_base = frames.make_transform(np.eye(3), (scanner_mm - base_mm).mean(axis=0))
    else:
        sigma2 = axis_variances(covariance_mm2)
        scanner_T_base = frames.best_fit_transform(base_mm, scanner_mm, 1.0 / sigma2)
        if np.allclose(covariance_mm2, sigma2[:, None, None] * np.eye(3), rtol=1e-9, atol=0.0):
            return scanner_T_base
        whiten = whitener(covariance_mm2)
    for _ in range(20):
        at = frames.apply(scanner_T_base, base_mm)
        centre = at.mean(axis=0)
        residual = np.einsum("mij,mj->mi", whiten, at - scanner_mm)
        motion = -np.linalg.pinv(frame_columns(at, whiten), rcond=1e-9) @ residual.ravel()
        turn = frames.rotation_from_rotvec(motion[3:])
        about_centre = frames.make_transform(turn, centre - turn @ centre + motion[:3])
        scanner_T_base = about_centre @ scanner_T_base
        if np.linalg.norm(motion[3:]) < 1e-14 and np.linalg.norm(motion[:3]) < 1e-11:
            break
    return scanner_T_base


def whitener(covariance_mm2: Array) -> Array:
    """Whitening matrices W (M, 3, 3) with W C W^T = 1 for covariances C (M, 3, 3): inverse Cholesky factors.

    Raises FitError where a covariance is not positive definite.
    """
    try:
        return np.linalg.inv(np.linalg.cholesky(covariance_mm2))
    except np.linalg.LinAlgError:
        row = int(np.argmin(np.linalg.eigvalsh(covariance_mm2)[:, 0]))
        raise FitError(
            f"the covariance of measured point {row} is not positive definite; give each in mm^2, or leave them out"
        ) from None


def frame_columns(scanner_mm: Array, whiten: Array) -> Array:
    """Derivative (C M, 6) of whitened points by a frame's small motion: a shift, then a turn about their centre.

    scanner_mm  # (M, 3); whiten  # (M, C, 3)
    """
    # about the centre: a far origin would cost digits
    return whitened_motion(scanner_mm, scanner_mm.mean(axis=0), whiten).reshape(-1, 6)


def whitened_motion(points_mm: Array, centre_mm: Array, whiten: Array) -> Array:
    """Derivative (M, C, 6) of whitened points by a frame's small motion; of lengths (C = 1) zero by its turn.

    A turn about the anchor changes no length, and one about another point does what a shift does.
    """
    columns = np.asarray(whiten @ frames.frame_motion(points_mm, centre_mm))
    if whiten.shape[1] == 1:
        columns[..., 3:] = 0.0
    return columns


def orthonormal(columns: Array) -> Array:
    """Orthonormal basis (R, rank) of the span of columns (R, K), whatever their rank."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return u[:, s > 1e-7 * s[0]]
