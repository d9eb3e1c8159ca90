"""Simulated arms under a scanner whose noise is not white; truth and noise are the second engine's and numpy's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.dataset.dataset import Dataset, Points, Scanner
from calib.simulation.simulate import simulate_dataset
from tests.support.engine.noise import draw_noise

SIGMA_MM = 0.05


def odd_arm(
    kind: str, seed: int, effects: Sequence[str] = (), *, sigmas: float | None = None, repeats: int = 1
) -> Dataset:
    """An arm at 80 poses, 16 of them held out, measured with noise of a kind (`tests.support.engine.noise`)."""
    rng = np.random.default_rng([seed, len(effects)])
    simulation = simulate_dataset(
        ("rb5", "panda")[seed % 2],
        rng=rng,
        effects=effects,
        visible_sigmas=sigmas,
        conditions=True,
        poses=80,
        noise_mm=SIGMA_MM,
    )
    pose = np.repeat(np.arange(80), repeats)
    seen_mm = simulation.apex_mm[pose]
    noise_mm = draw_noise(kind, seen_mm, pose, SIGMA_MM, np.random.default_rng([seed, 7]))
    points = Points(pose, seen_mm + noise_mm, np.full(len(pose), "jig"))
    return replace(simulation.dataset, points=points, scanner=Scanner(point_sigma_mm=SIGMA_MM))
