"""A place to which the tool is brought: joints that reach it, and the error there of the arm as delivered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib import frames
from calib.array_types import Array, BoolArray
from calib.calibration.delivered_error import DeliveredError, delivered_error
from calib.calibration.result import Calibration
from calib.compensation.target_correction import joint_limits
from calib.compensation.tool_problem import ToolProblem
from calib.dataset.dataset import Poses
from calib.errors import FitError
from calib.fitting.observations import conditions_at
from calib.kinematics.inverse import solve_inverse
from calib.presented import Presented

NEAR_MM, NEAR_RAD = 1e-3, 1e-5
"""A place is reached to a micrometre, an attitude to 0.6 thousandths of a degree."""
_TURNS_FROM = 6  # joints: with fewer the tool's attitude is free
_STARTS = 32  # further measured poses that are searched from where the nearest do not lead to the place


@dataclass(frozen=True)
class ToolPlace(Presented):
    """Joints that bring the calibrated arm's tool to a place, and the error there of the arm as delivered."""

    calibration: Calibration
    poses: Poses  # one: the joints, with the conditions of the pose that the search began at
    like: str  # id of that pose
    reached: bool  # otherwise the joints are the nearest that were found
    missed_mm: float
    missed_rad: float  # 0 where the attitude is free: fewer than six joints
    error: DeliveredError | None  # None where the place is not reached
    outside: tuple[int, ...]  # joints, from 0, that leave the trained ranges

    @property
    def has_attitude(self) -> bool:
        """Whether the tool's attitude counts, not its position alone."""
        return self.calibration.dataset.robot.n_joints >= _TURNS_FROM

    @property
    def q(self) -> Array:
        """Joint vector (n,), rad or mm."""
        return np.asarray(self.poses.q[0])

    def _brief(self) -> str:
        if self.error is None:
            return f"not reached, missed by {self.missed_mm:.3g} mm"
        return f"delivered off by {self.error.length_mm[0]:.3g} mm, sigma {self.error.sigma_mm[0]:.2g} mm"


def tool_frame(calibration: Calibration, poses: Poses) -> Array:
    """Transforms base_T_tool (N, 4, 4) of the calibrated arm's tool at poses, effects included."""
    state = calibration.model.state(calibration.fit.x, poses)
    return np.asarray(frames.make_transform(state.attitude, state.place(state.chain.target_mm)))


def tool_place(
    calibration: Calibration,
    base_T_tool: ArrayLike,
    pose: int,
    start: ArrayLike | None = None,
    *,
    everywhere: bool = True,
) -> ToolPlace:
    """Joints that bring the tool to a place, with the predicted error there of the arm as delivered.

    The tool's attitude counts where the arm has six joints or more. Joints stay within their limits.

    Args:
        calibration: a fit of an arm that does not carry the scanner.
        base_T_tool: (4, 4) mm, in the calibrated base's frame.
        pose: index of the measured pose from which the search begins, and whose conditions and setup count.
        start: (n,) joints to search from first, such as those of the last place.
        everywhere: whether to search from other measured postures, too, where the nearest do not lead to the place.

    Raises:
        FitError: a scanner on the flange, a place that is not finite, or a pose whose setup has no frame.
    """
    dataset, goal = calibration.dataset, np.array(base_T_tool, dtype=float)
    if goal.shape != (4, 4) or not np.isfinite(goal).all():
        raise FitError("a place of the tool is a finite (4, 4) transform")
    measured = dataset.poses
    at_mm = tool_frame(calibration, measured)[:, :3, 3]
    nearby = np.argsort(np.linalg.norm(at_mm - goal[:3, 3], axis=1), kind="stable")
    own = [] if start is None else [np.asarray(start, dtype=float)]
    found = _solved(calibration, goal, pose, np.array([*own, measured.q[pose], measured.q[nearby[0]]]))
    if everywhere and not found.reached.any():  # in another posture, perhaps
        found = found.also(_solved(calibration, goal, pose, measured.q[nearby[1 : _STARTS + 1]]))
    # The first that reaches it: joints do not jump while a place is dragged.
    best = int(np.argmax(found.reached)) if found.reached.any() else int(np.argmin(found.missed_mm))
    missed_mm, missed_rad, reached = found.missed_mm, found.missed_rad, found.reached
    there = conditions_at(measured.select(np.array([pose])), found.q[[best]])
    beyond = calibration.trained.joints_outside(dataset.robot, there.q)[0]
    error = delivered_error(calibration, there, str(measured.setup[pose])) if reached[best] else None
    return ToolPlace(
        calibration=calibration,
        poses=there,
        like=measured.ids[pose],
        reached=bool(reached[best]),
        missed_mm=float(missed_mm[best]),
        missed_rad=float(missed_rad[best]),
        error=error,
        outside=tuple(np.flatnonzero(beyond).tolist()),
    )


@dataclass(frozen=True)
class _Solutions:
    """Joints (K, n) found from K starts, and by how much their tool misses the place."""

    q: Array
    missed_mm: Array  # (K,)
    missed_rad: Array  # (K,)

    @property
    def reached(self) -> BoolArray:
        return np.asarray((self.missed_mm <= NEAR_MM) & (self.missed_rad <= NEAR_RAD))

    def also(self, other: _Solutions) -> _Solutions:
        """These solutions, then others."""
        pairs = ((self.q, other.q), (self.missed_mm, other.missed_mm), (self.missed_rad, other.missed_rad))
        return _Solutions(*map(np.concatenate, pairs))


def _solved(calibration: Calibration, goal: Array, pose: int, starts: Array) -> _Solutions:
    """Joints within their limits that bring the tool to a place, from each of K starts (K, n)."""
    robot, count = calibration.dataset.robot, len(starts)
    if not count:
        return _Solutions(starts, np.zeros(0), np.zeros(0))
    conditions = conditions_at(calibration.dataset.poses.select(np.array([pose])), starts)
    goals = np.repeat(goal[None], count, axis=0)
    turns = robot.n_joints >= _TURNS_FROM
    problem = ToolProblem(calibration.model, calibration.fit.x, conditions, goals, turns)
    low, high = (np.broadcast_to(limit, starts.shape) for limit in joint_limits(robot))
    q = solve_inverse(problem, starts, low, high)
    missed_mm, missed_rad = problem.errors(q)
    return _Solutions(q, missed_mm, missed_rad if turns else np.zeros(count))
