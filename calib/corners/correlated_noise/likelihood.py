"""Likelihood of the patches' mean heights under correlated errors of many kernels and sizes.

Kernels are Gaussian, or exponential as a mixture of Gaussian ones: exp(-r / l) is the mean of exp(-r^2 / 2 s^2) over
s / l distributed as the absolute value of a standard normal number. So one set of Gaussian kernels gives errors as
smooth as those of lenses and as rough as speckle.

The likelihood is restricted (REML, Patterson and Thompson 1971). The contrasts, what remains of the means after the
planes are fitted, have the covariance I + w^2 Q' K Q once the white noise is whitened. They are rotated into the modes
of one rough, long kernel. Of the leading modes each kernel's covariance is taken in full; the others, short waves that
all kernels leave nearly independent, count one by one.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, sqrt

import numpy as np

from calib.array_types import Array
from calib.corners.correlated_noise.patches import PatchPlaces

LENGTHS = np.geomspace(1 / 30, 3.0, 14)
"""Correlation lengths l (L,) of the Gaussian kernels, in edges of the jig."""
ROUGH_FROM = 4
"""Index of the shortest length of an exponential kernel: shorter ones look like Gaussian ones in patches."""


def _mixture(length: float) -> Array:
    """Weights (L,) with which Gaussian kernels of the lengths LENGTHS add up to about exp(-r / length)."""
    between = np.sqrt(LENGTHS[1:] * LENGTHS[:-1])
    below = [erf(b / length / sqrt(2)) for b in between]
    return np.diff([0.0, *below, 1.0])


SHAPES = np.vstack([np.eye(len(LENGTHS)), [_mixture(length) for length in LENGTHS[ROUGH_FROM:]]])
"""Shares (S, L) of the Gaussian kernels in each shape of kernel: the Gaussian ones, then the exponential ones."""
SHAPE_LENGTHS = np.concatenate([LENGTHS, LENGTHS[ROUGH_FROM:]])
"""Correlation lengths (S,) of the shapes, in edges of the jig."""

_ROUGH = 0.15  # of a kernel that seems Gaussian: without it mean squared errors over their covariance of 14 were seen

_LEADING = 16  # modes; with all of them the covariance of the apex is the same to some per cent
_MODES_OF = len(LENGTHS) + int(np.argmin(np.abs(LENGTHS - 1.0))) - ROUGH_FROM  # exponential, an edge long


def partly_rough(variances: Array) -> tuple[Array, Array]:
    """Variances of Gaussian kernels less the part of each that an exponential one takes, and that part."""
    return (1 - _ROUGH) * variances, _ROUGH * variances


def exponential(variances: Array, lengths: Array) -> Array:
    """Variances (..., L) of Gaussian kernels of the lengths LENGTHS that make exponential ones of (..., K) variances.

    lengths  # (K,) of the exponential kernels, in edges
    """
    return variances @ np.array([_mixture(length) for length in lengths])


def gaussian_kernels(places: PatchPlaces, lengths_mm: Array) -> Array:
    """Means (L, B, B) of exp(-r^2 / 2 l^2) over the points of each pair of patches, for lengths l (L,).

    With patches taken as Gaussian of their own second moments S the average is closed: l^2 / sqrt(det M) exp(-d . M^-1
    d / 2), M = l^2 I + S_b + S_c.
    """
    x, y = (centre[:, None] - centre for centre in places.centres_mm.T)
    spreads = places.spreads_mm2
    xx, xy, yy = (spreads[:, i, j, None] + spreads[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
    square = (lengths_mm**2)[:, None, None]
    xx, yy = xx + square, yy + square
    determinant = xx * yy - xy**2
    way = (yy * (x * x) - 2 * xy * x * y + xx * (y * y)) / determinant
    return square / np.sqrt(determinant) * np.exp(-0.5 * way)


@dataclass(frozen=True)
class CorrelationEvidence:
    """Log likelihood of patches' mean heights under correlated errors of S kernel shapes and W sizes."""

    log_likelihood: Array  # (S, W) less that of white noise alone
    expected_loss: Array  # (S, W) by how much that is below 0 on average where the noise is white


def evidence_of(
    mean_mm: Array, variance_mm2: Array, design: Array, kernels: Array, sizes_mm: Array
) -> CorrelationEvidence:
    """Evidence of the patches' mean heights (B,) for each shape and size of a correlated error.

    variance_mm2 # (B,) of the means by white noise; design # (B, P) of what is free; kernels # (L, B, B) Gaussian ones
    of unit variance; sizes_mm  # (W,)
    """
    root = np.sqrt(variance_mm2)
    basis, triangular = np.linalg.qr(design / root[:, None], mode="complete")
    contrasts = basis[:, triangular.shape[1] :] / root[:, None]
    if not contrasts.shape[1]:
        return CorrelationEvidence(*np.zeros((2, len(SHAPES), len(sizes_mm))))
    of = np.einsum("l,lbc->bc", SHAPES[_MODES_OF], kernels)
    modes = contrasts @ np.linalg.eigh(contrasts.T @ of @ contrasts)[1][:, ::-1]
    values = modes.T @ mean_mm
    leading, others = modes[:, :_LEADING], modes[:, _LEADING:]
    through = kernels @ modes
    square = SHAPES @ (leading.T @ through[:, :, :_LEADING]).reshape(len(LENGTHS), -1)
    single = SHAPES @ np.einsum("bm,lbm->lm", others, through[:, :, _LEADING:])
    own, turns = np.linalg.eigh(square.reshape(len(SHAPES), leading.shape[1], -1))
    eigenvalues = np.maximum(np.concatenate([own, single], axis=1), 0)
    turned = np.einsum("smn,m->sn", turns, values[:_LEADING])
    squared = np.concatenate([turned, np.broadcast_to(values[_LEADING:], single.shape)], axis=1) ** 2
    variance = 1 + sizes_mm[:, None] ** 2 * eigenvalues[:, None, :]
    shrunk, spread = 1 - 1 / variance, np.sum(np.log(variance), axis=2)
    log_likelihood = 0.5 * (np.einsum("swm,sm->sw", shrunk, squared) - spread)
    return CorrelationEvidence(log_likelihood, 0.5 * (spread - shrunk.sum(axis=2)))
