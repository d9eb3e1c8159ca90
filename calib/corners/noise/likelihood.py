"""How likely smooth errors of many kernels and sizes make the patches' means (REML, Patterson and Thompson 1971).

What the planes leave of the means, their contrasts, has the covariance I + w^2 Q' K Q once the white noise is whitened.
The contrasts are turned into the modes of one rough, long kernel. Of the leading modes each kernel's covariance is
taken as it is; the others, short waves that all kernels leave nearly independent, count one by one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.corners.noise.kernels import LENGTHS, ROUGH_FROM, SHAPES

_LEADING = 16  # modes; with all of them the covariance of the apex is the same to some per cent
_MODES_OF = len(LENGTHS) + int(np.argmin(np.abs(LENGTHS - 1.0))) - ROUGH_FROM  # exponential, an edge long


@dataclass(frozen=True)
class Evidence:
    """What patches say of smooth errors of S shapes of kernel and W sizes."""

    log_likelihood: Array  # (S, W) less that of white noise alone
    expected_loss: Array  # (S, W) by how much that is below 0 on average where the noise is white


def evidence_of(mean_mm: Array, variance_mm2: Array, design: Array, kernels: Array, sizes_mm: Array) -> Evidence:
    """The evidence of patches' means (B,).

    variance_mm2  # (B,) of the means by white noise; design  # (B, P) of what is free; kernels  # (L, B, B) Gaussian
    ones of unit variance; sizes_mm  # (W,)
    """
    root = np.sqrt(variance_mm2)
    basis, triangular = np.linalg.qr(design / root[:, None], mode="complete")
    contrasts = basis[:, triangular.shape[1] :] / root[:, None]
    if not contrasts.shape[1]:
        return Evidence(*np.zeros((2, len(SHAPES), len(sizes_mm))))
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
    return Evidence(log_likelihood, 0.5 * (spread - shrunk.sum(axis=2)))
