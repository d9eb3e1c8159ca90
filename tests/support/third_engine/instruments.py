"""Noise of instruments, by their own axes; each reading comes with its true covariance."""

from __future__ import annotations

import numpy as np

from tests.support.third_engine.screws import Array

INSTRUMENTS = ("tracker", "scanner", "plain")


def covariances(instrument: str, seen: Array, sigma_mm: float) -> Array:
    """Covariances (M, 3, 3), mm^2, at points `seen` (M, 3) of the instrument's frame; their mean variance is sigma^2.

    tracker: across the beam in proportion to the distance, along it a third of that and nearly constant. scanner: along
    its own z axis two and a half times coarser. plain: the same everywhere.
    """
    if instrument == "plain":
        return np.tile(sigma_mm**2 * np.eye(3), (len(seen), 1, 1))
    if instrument == "scanner":
        shape = np.diag([1.0, 1.0, 2.5**2])
        return np.tile(sigma_mm**2 * shape / (np.trace(shape) / 3.0), (len(seen), 1, 1))
    far = np.linalg.norm(seen, axis=1)
    ray = seen / far[:, None]
    along = np.einsum("ni,nj->nij", ray, ray)
    relative = (far / far.mean())[:, None, None]
    out = relative**2 * (np.eye(3) - along) + (0.25 + 0.1 * relative) ** 2 * along
    return sigma_mm**2 * out / np.mean(np.trace(out, axis1=1, axis2=2) / 3.0)


def draw_noise(covariance: Array, rng: np.random.Generator) -> Array:
    """Errors (M, 3) mm of readings with these covariances."""
    return np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.standard_normal(covariance.shape[:2]))
