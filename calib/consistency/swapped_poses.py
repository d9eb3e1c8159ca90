"""Pairs of outlying poses whose measurements are exchanged, as when two photos or two rows of a sheet are swapped."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from calib.calibration.evaluation import evaluate_all
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset

_SIGMAS = 6.0  # per coordinate of the fit, within which an exchanged point has to lie
_SHARE = 0.01  # of how far the points are off as they are, where that is more


def swapped_poses(calibration: Calibration, dataset: Dataset, poses: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Pairs of poses, each measured where the model of a fit without them has the other; each pose in one pair.

    Args:
        calibration: a fit without the poses.
        dataset: with the points of these poses.
        poses: ids of the poses that stand out.
    """
    if len(poses) < 2 or dataset.points is None or dataset.points.lengths is not None:
        return ()
    errors = evaluate_all(calibration.model, [calibration.fit.x], dataset, poses)[0]
    measured_mm, target = dataset.points.xyz_mm, dataset.points.target
    predicted_mm = measured_mm + errors.error_mm
    rows_of = {name: np.flatnonzero(errors.pose == dataset.poses.index(name)) for name in poses}
    found: list[tuple[str, str]] = []
    for one, other in combinations(poses, 2):
        a, b = rows_of[one], rows_of[other]
        known = {name for pair in found for name in pair}
        same_setup = dataset.poses.setup[dataset.poses.index(one)] == dataset.poses.setup[dataset.poses.index(other)]
        if known & {one, other} or not same_setup or len(a) != len(b) or not np.array_equal(target[a], target[b]):
            continue
        off_mm = float(np.linalg.norm(errors.error_mm[np.concatenate([a, b])], axis=1).min(initial=np.inf))
        crossed_mm = np.concatenate([predicted_mm[a] - measured_mm[b], predicted_mm[b] - measured_mm[a]])
        limit_mm = max(_SIGMAS * calibration.sigma_mm, _SHARE * off_mm)
        if np.linalg.norm(crossed_mm, axis=1).max(initial=0.0) < min(limit_mm, 0.5 * off_mm):
            found.append((one, other))
    return tuple(found)
