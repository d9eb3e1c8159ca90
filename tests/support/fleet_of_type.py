"""Fleets of arms of one type by `tests.support.engine`: errors in common, each arm scattered about these."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.dataset.dataset import Dataset
from tests.support.paired_cell import ARMS, compliance, draw_pairs, measured, size_of

_SPREAD = np.array([0.6, 3e-3, 0.6, 3e-3, 3e-3])  # a, alpha, d, theta, beta: mm and rad
_NEW_POSES, _TEST_POSES = 20, 60
_VISIBLE_MM = 0.1  # of the soft joint in the differences of 2 kg


def drawn_fleet(seed: int, *, arms: int = 6, poses: int = 60, scatter: float = 0.3) -> list[Dataset]:
    """Arms of a type, fitted to so many poses each; the last is new, with 20 training and 60 test poses.

    scatter: of an arm's link errors about its type, over the size of the type's own.
    """
    rng = np.random.default_rng([seed, 17])
    arm = ARMS[list(ARMS)[seed % len(ARMS)]]
    own = _SPREAD * rng.standard_normal(np.shape(arm.rows))
    size = 0.0
    fleet = []
    for number in range(arms):
        is_new = number == arms - 1
        cell = draw_pairs(arm, rng, _NEW_POSES + _TEST_POSES if is_new else poses, (0.0, 2.0))
        of_arm = own + scatter * _SPREAD * rng.standard_normal(own.shape)
        of_arm[-1] = _SPREAD * rng.standard_normal(5)  # the tool is each arm's own
        cell = replace(cell, rows=np.array(arm.rows) + of_arm)
        cause = compliance(1).cause
        size = size or size_of(cell, cause, _VISIBLE_MM)
        soft = size * (1.0 + 0.3 * scatter * rng.standard_normal())
        half = cell.poses // 2
        rows = np.arange(half)  # the poses without payload alone: there are no pairs
        cell = replace(
            cell,
            q=cell.q[rows],
            payload_kg=cell.payload_kg[rows],
            temperature_c=cell.temperature_c[rows],
            time_s=cell.time_s[rows],
            approach=cell.approach[rows],
            setup=cell.setup[rows],
        )
        made = measured(cell, [(cause, soft)], rng, test_places=_TEST_POSES if is_new else 0)
        fleet.append(replace(made, name=f"arm {number + 1}"))
    return fleet
