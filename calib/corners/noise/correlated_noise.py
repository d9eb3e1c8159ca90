"""The covariance of three fitted planes where the errors of neighbouring points are correlated.

A structured-light scanner's error is white noise and a part that is smooth over some millimetres. A covariance for
independent points is too small then, the more points there are. The residuals show how large the correlated part is and
how far it reaches: their means over patches of each face have, beside the white noise of a patch, the covariance of a
Gaussian process of variance w^2 and correlation exp(-r^2 / 2 l^2). The likelihood of w and l is that of the contrasts
that the planes leave (REML, Patterson and Thompson 1971), and the covariance is the posterior mean over no correlated
part at all, or any w and l of a grid, in one of two forms: an error along the line of sight that is continuous from
face to face, or unevenness of each face by itself.

An error that is smooth over more than a face tilts and shifts its plane and leaves no residuals: only repeated scans
show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, IndexArray
from calib.planes.robust_fit import PlaneFit

_PATCHES_AN_EDGE = 6
_POINTS_A_PATCH = 4  # at least, on average: otherwise the patches are larger
_LENGTHS = (1 / 30, 1 / 16, 1 / 9, 1 / 6, 1 / 4, 1 / 2.8)  # of the edge
_SIZES = np.geomspace(0.02, 20.0, 25)  # of the patch means' own standard deviation
_PRIOR_WHITE = (
    0.75  # of no correlated part; with 0.5 the covariance of white noise alone comes out a tenth larger
)
_POINTS_OF_OTHERS = 3


@dataclass(frozen=True)
class PlaneUncertainty:
    """The joint covariance of the three planes, and the correlated part of the error, from the residuals."""

    covariance: (
        Array  # (9, 9) of height (mm) and two slopes (rad) of each plane in turn, as in PlaneFit.design
    )
    white_covariance: Array  # (9, 9) as if all residuals were white noise
    correlated_sigma_mm: (
        float  # standard deviation of the correlated part of the error; near 0 where there is none
    )
    correlation_length_mm: float  # l of its correlation exp(-r^2 / 2 l^2)


@dataclass(frozen=True)
class _Patches:
    """B patches of the three faces."""

    mean_mm: Array  # (B,) residual
    variance_mm2: Array  # (B,) of that mean, from white noise
    design: Array  # (B, 9) mean of the design's rows
    influence: Array  # (B, 9) how the nine plane parameters move with each patch's mean
    face: IndexArray  # (B,) 0, 1, 2
    centres_mm: Array  # (B, 3)
    spreads_mm2: Array  # (B, 3, 3) second central moments of the patch's points


def plane_uncertainty(planes: Sequence[PlaneFit], edge_mm: float, sight: Array) -> PlaneUncertainty:
    """Joint covariance of three fitted planes. sight  # (3,) unit, from the scanner to the apex."""
    parts, white = [], np.zeros((9, 9))
    variances = [float(np.sum(p.psi_mm**2)) / p.slope**2 / max(len(p.psi_mm) - 3, 1) for p in planes]
    for face in range(3):
        patches, white[3 * face : 3 * face + 3, 3 * face : 3 * face + 3] = _patches(
            planes, face, edge_mm, max(variances)
        )
        parts.append(patches)
    patches = _Patches(*(np.concatenate(columns) for columns in zip(*map(_columns, parts), strict=True)))
    log_evidences, covariances, variances_mm2, lengths_mm = [], [], [], []
    for length in _LENGTHS:
        for kernel in (
            _sight_kernel(patches, planes, sight, length * edge_mm),
            _surface_kernel(patches, planes, length * edge_mm),
        ):
            log_evidence, variance_mm2 = _restricted_likelihood(patches, kernel)
            log_evidences.append(log_evidence)
            variances_mm2.append(variance_mm2)
            lengths_mm.append(length * edge_mm)
            covariances.append(patches.influence.T @ kernel @ patches.influence)
    log_odds = np.array(log_evidences) + np.log((1 - _PRIOR_WHITE) / _PRIOR_WHITE / len(log_evidences))
    share = np.exp(log_odds - np.logaddexp(0.0, np.logaddexp.reduce(log_odds)))
    correlated_mm2 = share * np.array(variances_mm2)
    covariance = white + np.einsum("k,kij->ij", correlated_mm2, np.array(covariances))
    length_mm = float(correlated_mm2 @ np.array(lengths_mm) / max(correlated_mm2.sum(), 1e-300))
    return PlaneUncertainty(covariance, white, float(np.sqrt(correlated_mm2.sum())), length_mm)


def _columns(patches: _Patches) -> tuple[Array | IndexArray, ...]:
    return (
        patches.mean_mm, patches.variance_mm2, patches.design, patches.influence, patches.face, patches.centres_mm,
        patches.spreads_mm2,
    )  # fmt: skip


def _patches(
    planes: Sequence[PlaneFit], face: int, edge_mm: float, other_variance_mm2: float
) -> tuple[_Patches, Array]:
    """Patches of one face, and the covariance (3, 3) of its plane from white noise.

    The noise of a face of ten points is hardly known from them: the largest variance of the faces counts as that of
    three further points.
    """
    plane = planes[face]
    design = plane.design(plane.points_mm)
    values = plane.psi_mm / plane.slope
    total = len(values)
    # Cells along the face's two edges, counted from the apex, so that the patches turn with the scan.
    along = np.column_stack([plane.points_mm @ p.normal - p.offset_mm for p in planes if p is not plane])
    area = 0.5 * float(np.prod(np.ptp(along, axis=0)))
    side = max(edge_mm / _PATCHES_AN_EDGE, float(np.sqrt(_POINTS_A_PATCH * area / total)))
    cell = np.floor(along / side).astype(np.int64)
    cell -= cell.min(axis=0)
    key = cell[:, 0] * (int(cell[:, 1].max()) + 1) + cell[:, 1]
    table = np.bincount(key)
    patch = (np.cumsum(table > 0) - 1)[key]
    count = table[table > 0].astype(float)

    def mean(column: Array) -> Array:
        return np.asarray(np.bincount(patch, column) / count)

    means = mean(values)
    # Differences within a patch have no correlated part, so this is the white one; the plane is subtracted already.
    squares = float(np.sum((values - means[patch]) ** 2)) + _POINTS_OF_OTHERS * other_variance_mm2
    within = squares / (max(total - max(len(count), 3), 0) + _POINTS_OF_OTHERS)
    normal_matrix = np.linalg.inv(design.T @ design)
    rows = np.column_stack([mean(column) for column in design.T])
    wide, influence = np.zeros((2, len(count), 9))
    wide[:, 3 * face : 3 * face + 3] = rows
    influence[:, 3 * face : 3 * face + 3] = (rows * count[:, None]) @ normal_matrix
    centres = np.column_stack([mean(column) for column in plane.points_mm.T])
    spreads = np.empty((len(count), 3, 3))
    for a in range(3):
        for b in range(a, 3):
            moment = mean(plane.points_mm[:, a] * plane.points_mm[:, b]) - centres[:, a] * centres[:, b]
            spreads[:, a, b] = spreads[:, b, a] = moment
    within = max(within, 1e-24)
    patches = _Patches(means, within / count, wide, influence, np.full(len(count), face), centres, spreads)
    return patches, np.asarray(within * normal_matrix, dtype=np.float64)


def _sight_kernel(patches: _Patches, planes: Sequence[PlaneFit], sight: Array, length_mm: float) -> Array:
    """(B, B) covariance of patch means under an error along the line of sight of variance 1, correlated across it."""
    across = np.linalg.svd(sight[None])[2][1:]
    cosine = np.abs(np.array([plane.normal @ sight for plane in planes]))[patches.face]
    return _kernel(patches, across, length_mm, slice(None)) * np.outer(cosine, cosine)


def _surface_kernel(patches: _Patches, planes: Sequence[PlaneFit], length_mm: float) -> Array:
    """(B, B) covariance of patch means under an unevenness of variance 1 of each face by itself."""
    kernel = np.zeros((len(patches.face), len(patches.face)))
    for face, plane in enumerate(planes):
        on = np.flatnonzero(patches.face == face)
        kernel[np.ix_(on, on)] = _kernel(patches, plane.axes, length_mm, on)
    return kernel


def _kernel(patches: _Patches, axes: Array, length_mm: float, on: IndexArray | slice) -> Array:
    """exp(-r^2 / 2 l^2) averaged over pairs of the patches `on`, r measured along the two axes (2, 3).

    With patches taken as Gaussian of their own second moments S the average is closed:
    l^2 / sqrt(det M) exp(-d . M^-1 d / 2), M = l^2 I + S_b + S_c.
    """
    x, y = (centre[:, None] - centre for centre in axes @ patches.centres_mm[on].T)
    spreads = axes @ patches.spreads_mm2[on] @ axes.T
    xx, xy, yy = (spreads[:, i, j, None] + spreads[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
    xx, yy = xx + length_mm**2, yy + length_mm**2
    determinant = xx * yy - xy**2
    way = (yy * x * x - 2 * xy * x * y + xx * y * y) / determinant
    return np.asarray(length_mm**2 / np.sqrt(determinant) * np.exp(-0.5 * way))


def _restricted_likelihood(patches: _Patches, kernel: Array) -> tuple[float, float]:
    """Log evidence of a correlated part over none, and the posterior mean of its variance w^2, over the grid of sizes.

    With the patch means whitened, Q the contrasts that the planes leave and Q^T K Q = U diag(k) U^T, the values
    z = U^T Q^T y are independent of variance 1 + w^2 k.
    """
    root = np.sqrt(patches.variance_mm2)
    basis, triangular = np.linalg.qr(patches.design / root[:, None], mode="complete")
    contrasts = basis[:, triangular.shape[1] :]
    if not contrasts.shape[1]:
        return -np.inf, 0.0
    eigenvalues, turn = np.linalg.eigh(contrasts.T @ (kernel / np.outer(root, root)) @ contrasts)
    squared = (turn.T @ (contrasts.T @ (patches.mean_mm / root))) ** 2
    size_mm2 = (_SIZES**2) * float(np.mean(patches.mean_mm**2) + np.median(patches.variance_mm2))
    variance = 1 + size_mm2[:, None] * np.maximum(eigenvalues, 0)
    log_ratio = 0.5 * np.sum(squared - squared / variance - np.log(variance), axis=1)
    largest = log_ratio.max()
    weight = np.exp(log_ratio - largest)
    return float(largest + np.log(weight.mean())), float(weight @ size_mm2 / weight.sum())
