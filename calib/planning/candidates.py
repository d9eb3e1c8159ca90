"""Poses that a plan may choose from: those that can be measured."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.planning.start import Start
from calib.simulation.pose_design import scan_poses


def candidates_of(start: Start, count: int, *, rng: np.random.Generator) -> Array:
    """(count, n) joints of poses that can be measured. Raises CalibError where there are too few."""
    dataset = start.dataset
    return scan_poses(dataset.robot, start.base_T_scanner, count, rng=rng, jig=dataset.jig)
