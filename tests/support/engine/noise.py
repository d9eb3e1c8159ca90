"""Scanner noise, white or of another kind; each kind has the declared sigma as its mean size."""

from __future__ import annotations

import numpy as np

from tests.support.engine.mechanics import Array

KINDS = ("white", "student", "deep", "growing", "wandering")


def draw_noise(kind: str, seen: Array, pose: Array, sigma_mm: float, rng: np.random.Generator) -> Array:
    """(M, 3) mm at points `seen` (M, 3) in the scanner's frame, measured at `pose` (M,) in the order of time.

    student: t with 3 degrees of freedom. deep: three times coarser along z. growing: with the square of the distance.
    wandering: half of the variance an AR(1) of the whole instrument, correlation 0.9 from pose to pose.
    """
    white = rng.standard_normal(seen.shape)
    if kind == "student":
        noise = rng.standard_t(3.0, seen.shape) / np.sqrt(3.0)
    elif kind == "deep":
        noise = white * np.array([1.0, 1.0, 3.0]) / np.sqrt(11.0 / 3.0)
    elif kind == "growing":
        far = np.linalg.norm(seen, axis=1) ** 2
        noise = white * (far / np.sqrt(np.mean(far**2)))[:, None]
    elif kind == "wandering":
        order = np.argsort(pose, kind="stable")
        poses, which = np.unique(pose[order], return_inverse=True)
        wander = np.zeros((len(poses), 3))
        for k, kick in enumerate(rng.standard_normal(wander.shape)):
            wander[k] = kick if k == 0 else 0.9 * wander[k - 1] + np.sqrt(1.0 - 0.81) * kick
        noise = np.empty_like(white)
        noise[order] = np.sqrt(0.5) * (white[order] + wander[which])
    else:
        noise = white
    return sigma_mm * noise
