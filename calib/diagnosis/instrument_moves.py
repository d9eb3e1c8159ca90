"""Moves of the instrument that a fit found: between which poses, and by how much. They are no errors of the arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.effects.catalogue.order_steps import ScannerStep, is_measured_for_training


@dataclass(frozen=True)
class InstrumentMove:
    """A move of the instrument between two poses that were measured one after the other."""

    after: str  # the last pose before it, by its id
    before: str  # the first pose after it
    turn_mrad: tuple[float, float, float]  # of the reported points, about the instrument's axes
    shift_mm: tuple[float, float, float]  # of the reported points, at the instrument's origin


def instrument_moves(calibration: Calibration) -> tuple[InstrumentMove, ...]:
    """Moves of the instrument in the model of a calibration, in the order in which they happened."""
    model = calibration.model
    found = []
    for effect, values in zip(model.effects, model.values_by_effect(calibration.fit.x), strict=True):
        if isinstance(effect, ScannerStep) and effect.start.pose in calibration.dataset.poses.ids:
            shift_mm = values[:3] - np.cross(values[3:], effect.centre_mm)
            (a, b, c), (x, y, z) = (1e3 * values[3:]).tolist(), shift_mm.tolist()
            move = InstrumentMove(*_beside(calibration, effect, values), (a, b, c), (x, y, z))
            found.append((effect.start.first, move))
    return tuple(move for _, move in sorted(found, key=lambda one: one[0]))


def _beside(calibration: Calibration, step: ScannerStep, values: Array) -> tuple[str, str]:
    """Ids of the poses before and after a step: a test pose between is on the side where it is less off."""
    dataset, errors = calibration.dataset, calibration.after
    assert dataset.points is not None
    poses, first = dataset.poses, dataset.poses.index(step.start.pose)
    trained = np.flatnonzero(is_measured_for_training(dataset) & (poses.order < poses.order[first]))
    last = int(trained[np.argmax(poses.order[trained])]) if len(trained) else first
    between = (poses.order > poses.order[last]) & (poses.order < poses.order[first])
    for pose in sorted(np.flatnonzero(between).tolist(), key=lambda k: poses.order[k]):
        rows = errors.pose == pose
        if not rows.any():
            continue
        moved_mm = values[:3] + np.cross(values[3:], dataset.points.xyz_mm[rows] - step.centre_mm)
        if np.linalg.norm(errors.error_mm[rows]) < np.linalg.norm(errors.error_mm[rows] - moved_mm):
            return poses.ids[last], poses.ids[pose]
        last = pose
    return poses.ids[last], poses.ids[first]
