"""Moves of the instrument that a fit found: between which poses, and by how much. They are no errors of the arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.effects.catalogue.order_steps import ScannerStep, is_measured_for_training


@dataclass(frozen=True)
class InstrumentMove:
    """A move of the instrument between two poses that were measured one after the other."""

    after: str  # the last fitted pose before it, by its id
    before: str  # the first fitted pose after it
    turn_mrad: tuple[float, float, float]  # of the reported points, about the instrument's axes
    shift_mm: tuple[float, float, float]  # of the reported points, at the middle of the measured field


def instrument_moves(calibration: Calibration) -> tuple[InstrumentMove, ...]:
    """Moves of the instrument in the model of a calibration, in the order in which they happened."""
    model, dataset = calibration.model, calibration.fitted_dataset
    found = []
    for effect, values in zip(model.effects, model.values_by_effect(calibration.fit.x), strict=True):
        last = last_before(dataset, effect.start.pose) if isinstance(effect, ScannerStep) else None
        if last is not None and isinstance(effect, ScannerStep):
            x, y, z, *turn = values.tolist()
            a, b, c = (1e3 * angle for angle in turn)
            found.append((effect.start.first, InstrumentMove(last, effect.start.pose, (a, b, c), (x, y, z))))
    return tuple(move for _, move in sorted(found, key=lambda one: one[0]))


def last_before(dataset: Dataset, pose_id: str) -> str | None:
    """Id of the last fitted pose that was measured before a pose; None where it was the first, or is not known."""
    poses = dataset.poses
    if pose_id not in poses.ids:
        return None
    earlier = np.flatnonzero(is_measured_for_training(dataset) & (poses.order < poses.order[poses.index(pose_id)]))
    return poses.ids[earlier[np.argmax(poses.order[earlier])]] if len(earlier) else None
