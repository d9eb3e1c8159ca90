"""Candidate poses for the next measurements, under the conditions that a dataset's poses had."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.dataset.dataset import Poses
from calib.errors import CalibError
from calib.fitting.observations import conditions_at
from calib.workcell.candidates import candidate_poses
from calib.workcell.known_cell import workcell_of_dataset

OFFERED = 400


def offered_poses(calibration: Calibration, *, count: int = OFFERED) -> Poses:
    """Candidate poses that can be measured next from the scanner's first station.

    Where no such pose is found, they lie within the ranges of the measured joints.
    """
    rng = np.random.default_rng(0)
    dataset = calibration.dataset
    measured = dataset.poses
    setup, scanner_T_base = next(iter(calibration.after.scanner_T_base.items()))
    try:
        cell = workcell_of_dataset(dataset, parent_T_scanner=frames.invert(scanner_T_base), setup=setup)
        q = candidate_poses(cell, count, rng=rng)
    except CalibError:
        q = rng.uniform(measured.q.min(axis=0), measured.q.max(axis=0), (count, measured.q.shape[1]))
    poses = conditions_at(measured, q)
    offered = replace(poses, role=np.full(count, "train"), setup=np.full(count, setup))
    return under_conditions(offered, measured)


def under_conditions(poses: Poses, measured: Poses, payloads_kg: tuple[float, ...] = ()) -> Poses:
    """Poses with payload, temperature and approach drawn from the range of the measured poses.

    Payload and temperature are at either end of their range, and each joint is approached from either side, where that
    was recorded.

    Args:
        poses: to be measured.
        measured: poses whose conditions vary as the new ones shall.
        payloads_kg: payloads to draw from, where that of the measured poses does not vary.
    """
    rng = np.random.default_rng(0)
    payload_kg, temperature_c = (
        rng.choice(ends, len(poses)) if ends else None
        for ends in (_ends(measured.payload_kg) or payloads_kg, _ends(measured.temperature_c))
    )
    return replace(
        poses,
        payload_kg=poses.payload_kg if payload_kg is None else payload_kg,
        temperature_c=poses.temperature_c if temperature_c is None else temperature_c,
        approach=None if measured.approach is None else rng.choice([-1.0, 1.0], poses.q.shape),
    )


def _ends(values: Array | None) -> tuple[float, ...]:
    """Least and largest value of a pose condition (such as payload); () where it does not vary."""
    if values is None or not np.ptp(values) > 0.0:
        return ()
    return float(values.min()), float(values.max())
