"""Judgement of each pose of a running campaign: good, doubtful, or to be measured again, and the facts behind it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.array_types import Array, IndexArray
from calib.brief import Brief
from calib.calibration.promise import PointPromise, promise
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.statistics import chi2_ppf

State = Literal["good", "doubtful", "repeat"]
Reason = Literal["", "not compared", "uncertain", "off", "no target", "unreadable", "not seen"]
FALSE_DOUBTS = 1e-4
"""Probability that a test pose which agrees with the fit is called doubtful."""
UNCERTAIN = 3.0
"""Sigma of a target over the median of the other poses' sigmas, from which it is doubtful."""
_ENOUGH_TO_COMPARE = 5  # poses whose median sigma is one


@dataclass(frozen=True)
class PoseJudgement(Brief):
    """State of a measured pose with the reason for it."""

    pose: str
    state: State
    reason: Reason
    failure: str = ""  # of the search in the scan
    sigma_mm: float | None = None  # of the measured point by its own measurement, the worst target's
    error_mm: float | None = None  # measured minus predicted, three dimensions, the worst target's
    promised_mm: float | None = None  # standard deviation of such an error, root of the sum over the coordinates

    @property
    def told(self) -> tuple[object, ...]:
        """What a change of makes the judgement worth telling again."""
        reason = "" if self.reason == "not compared" else self.reason
        return self.pose, self.state, reason, self.failure


def judge_found(dataset: Dataset, found: Sequence[str], calibration: Calibration | None) -> dict[str, PoseJudgement]:
    """Judgements of the poses that have points, in the order given.

    A training pose is doubtful where the robust fit leaves it out; a test pose where its error is improbable by what
    was promised for it.

    Args:
        dataset: with the points of all poses that were found.
        found: their ids, in the order in which they arrived.
        calibration: robust fit of them; None while there are too few.
    """
    sigma_mm = _own_sigma_mm(dataset)
    usual = float(np.median(list(sigma_mm.values()))) if len(sigma_mm) >= _ENOUGH_TO_COMPARE else np.inf
    compared = {} if calibration is None else _compared(dataset, promise(calibration))
    judged = {}
    for pose_id in found:
        own = sigma_mm.get(pose_id)
        if pose_id not in compared:
            judged[pose_id] = PoseJudgement(pose_id, "good", "not compared", sigma_mm=own)
            continue
        error_mm, promised_mm, agrees = compared[pose_id]
        assert calibration is not None
        is_off = not agrees if dataset.poses.is_test[dataset.poses.index(pose_id)] else pose_id in calibration.outliers
        reason: Reason = "off" if is_off else "uncertain" if own is not None and own > UNCERTAIN * usual else ""
        judged[pose_id] = PoseJudgement(
            pose_id, "doubtful" if reason else "good", reason, sigma_mm=own, error_mm=error_mm, promised_mm=promised_mm
        )
    return judged


def _own_sigma_mm(dataset: Dataset) -> dict[str, float]:
    """Sigma of the worst target of each pose by its own covariance; {} where points have none."""
    points = dataset.points
    if points is None or points.covariance_mm2 is None:
        return {}
    sigma_mm = np.sqrt(np.linalg.eigvalsh(points.covariance_mm2)[:, -1])
    return {dataset.poses.ids[points.pose[i]]: float(sigma_mm[i]) for i in _worst(points.pose, sigma_mm)}


def _compared(dataset: Dataset, promised: PointPromise) -> dict[str, tuple[float, float, bool]]:
    """Error and promised sigma, mm, of each pose's worst point, and whether it is as small as promised."""
    limit = chi2_ppf(1.0 - FALSE_DOUBTS, 3)
    ratio = np.sum((promised.error_mm / promised.sigma_mm) ** 2, axis=1)
    error, sigma = (np.linalg.norm(each, axis=1) for each in (promised.error_mm, promised.sigma_mm))
    worst = _worst(promised.pose, ratio)
    return {
        dataset.poses.ids[promised.pose[i]]: (float(error[i]), float(sigma[i]), bool(ratio[i] < limit)) for i in worst
    }


def _worst(pose: IndexArray, values: Array) -> IndexArray:
    """Row of each pose's point with the largest of the values (M,)."""
    order = np.lexsort((values, pose))
    return order[np.diff(pose[order], append=-1) != 0]
