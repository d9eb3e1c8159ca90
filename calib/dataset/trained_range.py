"""Joint ranges of a fit's training poses, outside which the model extrapolates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray
from calib.dataset.dataset import Dataset
from calib.dataset.repeats import in_repeat_groups_of
from calib.kinematics.robot import Robot
from calib.rendering import numbers

_SHARE = 0.1  # of a joint's range: so far beyond its ends is still inside
_LEAST_RAD, _LEAST_MM = np.radians(1.0), 1.0  # of a joint that hardly moved
_MOST_NAMED = 10  # poses


@dataclass(frozen=True)
class TrainedRange:
    """Least and largest value of each joint over a fit's training poses, rad or mm."""

    low: tuple[float, ...]
    high: tuple[float, ...]

    @classmethod
    def of(cls, dataset: Dataset, outliers: Sequence[str] = ()) -> TrainedRange:
        """Joint ranges of a dataset's measured training poses, outlying poses excluded."""
        assert dataset.points is not None
        used = ~dataset.poses.is_test & np.isin(np.arange(len(dataset.poses)), dataset.points.pose)
        if outliers:
            used &= ~in_repeat_groups_of(dataset, outliers)
        q = dataset.poses.q[used]
        return cls(tuple(q.min(axis=0).tolist()), tuple(q.max(axis=0).tolist()))

    def joints_outside(self, robot: Robot, q: Array) -> BoolArray:
        """Mask (N, n) of the joints that, at q (N, n), are beyond their range by more than a tenth of it."""
        low, high = np.array(self.low), np.array(self.high)
        least = np.where(robot.is_revolute, _LEAST_RAD, _LEAST_MM)
        margin = np.maximum(_SHARE * (high - low), least)
        return (q < low - margin) | (q > high + margin)

    def outside(self, robot: Robot, q: Array) -> BoolArray:
        """Mask (N,) of the joint vectors q (N, n) with any joint beyond its range by more than a tenth of it."""
        return np.asarray(self.joints_outside(robot, q).any(axis=1))

    def words(self, robot: Robot, q: Array, ids: Sequence[str]) -> str:
        """Sentence that names the poses outside the trained ranges and the worst joint; "" where none is."""
        beyond = self.joints_outside(robot, q)
        rows = np.flatnonzero(beyond.any(axis=1))
        if not len(rows):
            return ""
        names = numbers.in_short([ids[int(i)] for i in rows], _MOST_NAMED)
        joint = int(np.argmax(beyond.sum(axis=0)))
        scale, unit = (np.degrees(1.0), "°") if robot.joints[joint].is_revolute else (1.0, " mm")
        trained = f"{scale * self.low[joint]:.4g} to {scale * self.high[joint]:.4g}{unit}"
        many = "1 pose is" if len(rows) == 1 else f"{len(rows)} poses are"
        return (
            f"{many} outside the joint ranges that were trained, by more than a tenth of a range ({names}; joint "
            f"{joint + 1} was trained from {trained}): there the model is not confirmed"
        )
