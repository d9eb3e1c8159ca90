"""The joint ranges in which a fit was trained: a model is confirmed inside them and only guesses far outside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray
from calib.dataset.dataset import Dataset
from calib.dataset.stands import of_stands
from calib.kinematics.robot import Robot

_SHARE = 0.1  # of a joint's range: so far beyond its ends is still inside
_LEAST_RAD, _LEAST_MM = np.radians(1.0), 1.0  # of a joint that hardly moved
_TOLD = 10  # poses


@dataclass(frozen=True)
class TrainedRange:
    """The least and the largest value of each joint at the poses that a fit was trained with, rad or mm."""

    low: tuple[float, ...]
    high: tuple[float, ...]

    @classmethod
    def of(cls, dataset: Dataset, outliers: Sequence[str] = ()) -> TrainedRange:
        """The ranges of a dataset's measured training poses, without those of outlying poses."""
        assert dataset.points is not None
        used = ~dataset.poses.is_test & np.isin(np.arange(len(dataset.poses)), dataset.points.pose)
        if outliers:
            used &= ~of_stands(dataset, outliers)
        q = dataset.poses.q[used]
        return cls(tuple(q.min(axis=0).tolist()), tuple(q.max(axis=0).tolist()))

    def joints_outside(self, robot: Robot, q: Array) -> BoolArray:
        """(N, n) which joints at q (N, n) are beyond their range by more than a tenth of it."""
        low, high = np.array(self.low), np.array(self.high)
        least = np.where(robot.is_revolute, _LEAST_RAD, _LEAST_MM)
        margin = np.maximum(_SHARE * (high - low), least)
        return np.asarray((q < low - margin) | (q > high + margin))

    def outside(self, robot: Robot, q: Array) -> BoolArray:
        """(N,) at which of q (N, n) a joint is."""
        return np.asarray(self.joints_outside(robot, q).any(axis=1))

    def words(self, robot: Robot, q: Array, ids: Sequence[str]) -> str:
        """Which poses leave the ranges, and by which joint, in a sentence; "" where none does."""
        beyond = self.joints_outside(robot, q)
        rows = np.flatnonzero(beyond.any(axis=1))
        if not len(rows):
            return ""
        names = ", ".join(ids[i] for i in rows[:_TOLD]) + (" ..." if len(rows) > _TOLD else "")
        joint = int(np.argmax(beyond.sum(axis=0)))
        scale, unit = (np.degrees(1.0), "°") if robot.joints[joint].is_revolute else (1.0, " mm")
        trained = f"{scale * self.low[joint]:.4g} to {scale * self.high[joint]:.4g}{unit}"
        many = "1 pose is" if len(rows) == 1 else f"{len(rows)} poses are"
        return (
            f"{many} outside the joint ranges that were trained, by more than a tenth of a range ({names}; joint "
            f"{joint + 1} was trained from {trained}): there the model is not confirmed"
        )
