"""Poses that could be measured next, under the conditions that a dataset's poses had."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset, Poses
from calib.fitting.observations import conditions_at

TRIED = 400


def further_poses(
    dataset: Dataset, q: Array | None = None, *, payloads_kg: tuple[float, ...] = (), tried: int = TRIED
) -> Poses:
    """Candidates for the next poses, with conditions drawn from those that were written down.

    Args:
        dataset: whose conditions vary as these shall: payload and temperature at both ends of their range, each joint
            approached from either side.
        q: (C, n) rad or mm, that can be measured; where None, joint vectors within the range of the measured ones.
        payloads_kg: to be carried in turn, where the data have none.
        tried: how many are drawn.
    """
    rng = np.random.default_rng(0)
    measured = dataset.poses
    if q is None:
        q = rng.uniform(measured.q.min(axis=0), measured.q.max(axis=0), (tried, measured.q.shape[1]))
    poses = conditions_at(measured, q)
    ends = [_ends(measured.payload_kg) or payloads_kg, _ends(measured.temperature_c)]
    payload_kg, temperature_c = (rng.choice(end, len(q)) if end else None for end in ends)
    approach = None if measured.approach is None else rng.choice([-1.0, 1.0], q.shape)
    return replace(
        poses,
        role=np.full(len(q), "train"),
        payload_kg=poses.payload_kg if payload_kg is None else payload_kg,
        temperature_c=poses.temperature_c if temperature_c is None else temperature_c,
        approach=approach,
    )


def _ends(values: Array | None) -> tuple[float, ...]:
    """The least and the largest of what varies; () where it does not."""
    if values is None or not np.ptp(values) > 0.0:
        return ()
    return float(values.min()), float(values.max())
