"""Inverse kinematics of an arm with effects: joint vectors near given ones that put the tool where it should be.

Newton's method on the model's own forward map, with the chain's analytic Jacobian J, all targets at once:

    dq = J^+ e + (1 - J^+ J) (q0 - q),      e = [p_goal - p; L sin(turn)],

L the arm's reach, so that rows and columns are millimetres alike. The second term makes a redundant arm move the
least. Where a full step does not lower |e| it is damped (Levenberg 1944; Nakamura and Hanafusa 1986); joints that press
against their box are held there. How effects change with q is left out of J: that costs an iteration or two and no
accuracy, since e is exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray, IndexArray
from calib.dataset.dataset import Poses
from calib.effects.state import RobotState
from calib.fitting.model import Model
from calib.kinematics import chain as kinematics

_ITERATIONS = 100
_EXACT_MM = 1e-10  # an error below this may rise again in rounding
_SETTLED = 1e-12  # no joint moves by more (rad, reach): done
_NULL = 1e-10  # singular values below this share of the largest give no direction
_FIRST_DAMPING, _LAST_DAMPING = 1e-8, 1e4  # shares of the largest squared singular value


@dataclass(frozen=True)
class ToolProblem:
    """Where the tool should be, and where the calibrated arm has it."""

    model: Model
    x: Array
    conditions: Poses
    goal: Array  # (N, 4, 4) base_T_tool of the nominal arm
    with_orientation: bool

    @property
    def length_mm(self) -> float:
        """What a radian is worth: the arm's reach. Columns and rows are scaled to millimetres by it."""
        table = self.model.robot.table
        return max(float(np.sum(np.hypot(table[:, 0], table[:, 2]))), 1.0)

    @property
    def joint_units(self) -> Array:
        """(n,) size of one scaled unit of each joint: rad, or the reach in mm for a prismatic joint."""
        return np.where(self.model.robot.is_revolute, 1.0, self.length_mm)

    def _state(self, q: Array, rows: IndexArray) -> tuple[RobotState, Array]:
        """The calibrated arm at q (K, n), and how its base is turned there (1 or K, 3, 3)."""
        state = self.model.state(self.x, replace(self.conditions.select(rows), q=q))
        return state, frames.rotation_from_rotvec(state.base_rotvec_rad)

    def _tool(self, state: RobotState, turn: Array) -> Array:
        """base_T_tool (K, 4, 4), with the base's turn and what displaces the tool."""
        rotation = turn @ state.chain.base_T_frame[:, -1, :3, :3]
        return frames.make_transform(rotation, state.place(state.chain.target_mm))

    def _error(self, base_T_tool: Array, rows: IndexArray) -> Array:
        goal = self.goal[rows]
        position = goal[:, :3, 3] - base_T_tool[:, :3, 3]
        if not self.with_orientation:
            return position
        return np.concatenate([position, self.length_mm * _turn_vector(base_T_tool, goal)], axis=1)

    def linearise(self, q: Array, rows: IndexArray) -> tuple[Array, Array]:
        """Goal minus place (K, 3 or 6) of some targets, mm, and the place's derivative by the scaled joints (..., n).

        Rows 4 to 6 are the turn that is left, times the reach.
        """
        state, turn = self._state(q, rows)
        turning = self.model.robot.is_revolute
        by_table = kinematics.jacobian(state.chain, state.chain.target_mm)[:, :, :-1]  # (K, 3, n, 5)
        jacobian = turn @ np.where(turning, by_table[..., 3], by_table[..., 2])
        if self.with_orientation:
            axes = turn @ np.moveaxis(state.chain.base_T_frame[:, :-2, :3, 2], 1, 2)  # z_(i-1) of each joint
            jacobian = np.concatenate([jacobian, self.length_mm * np.where(turning, axes, 0.0)], axis=1)
        return self._error(self._tool(state, turn), rows), jacobian * self.joint_units

    def errors(self, q: Array) -> tuple[Array, Array]:
        """Position error (N,) mm and angle between orientations (N,) rad, nan where they do not count."""
        at = self._tool(*self._state(q, np.arange(len(q))))
        position = np.linalg.norm(self.goal[:, :3, 3] - at[:, :3, 3], axis=1)
        if not self.with_orientation:
            return position, np.full(len(q), np.nan)
        sine = np.linalg.norm(_turn_vector(at, self.goal), axis=1)
        cosine = 0.5 * (np.einsum("nij,nij->n", at[:, :3, :3], self.goal[:, :3, :3]) - 1.0)
        return position, np.arctan2(sine, cosine)


def _turn_vector(at: Array, goal: Array) -> Array:
    """sin(angle) times axis of the turn from `at` to `goal` (N, 3), base frame, exact to rounding for small turns."""
    return 0.5 * np.sum(np.cross(at[:, :3, :3], goal[:, :3, :3], axis=1), axis=-1)


def solve_inverse(problem: ToolProblem, start: Array, low: Array, high: Array) -> Array:
    """Joint vectors (N, n) from `low` to `high` (N, n), near `start`, with the least error.

    Where a goal cannot be met the result is the closest approach that was found; ask `problem.errors`.
    """
    units = problem.joint_units
    q = np.clip(start, low, high)
    active = np.arange(len(q))
    damping = np.zeros(len(q))
    error, jacobian = problem.linearise(q, active)
    for _ in range(_ITERATIONS):
        if len(active) == 0:
            break
        at = q[active]
        home = np.where(damping[active, None] > 0.0, 0.0, (start[active] - at) / units)
        step = _step(jacobian, error, home, damping[active], at <= low[active], at >= high[active])
        trial = np.clip(at + step * units, low[active], high[active])
        trial_error, trial_jacobian = problem.linearise(trial, active)
        before, after = np.linalg.norm(error, axis=1), np.linalg.norm(trial_error, axis=1)
        accepted = (after < before) | (after <= _EXACT_MM)
        moved = np.abs((trial - at) / units).max(axis=1)
        q[active[accepted]] = trial[accepted]
        error[accepted], jacobian[accepted] = trial_error[accepted], trial_jacobian[accepted]
        relaxed = np.where(damping[active] > _FIRST_DAMPING, 0.1 * damping[active], 0.0)
        raised = np.maximum(10.0 * damping[active], _FIRST_DAMPING)
        damping[active] = np.where(accepted, relaxed, raised)
        going = (moved > _SETTLED) & (damping[active] <= _LAST_DAMPING)
        active, error, jacobian = active[going], error[going], jacobian[going]
    return q


def _step(
    jacobian: Array,
    error: Array,
    home: Array,
    damping: Array,
    at_low: BoolArray,
    at_high: BoolArray,
) -> Array:
    """Scaled steps (K, n); joints at an end of their box that would press outward are held and the rest steps anew."""
    held = np.zeros_like(at_low)
    for _ in range(jacobian.shape[2]):
        step = _damped(jacobian * ~held[:, None], error, home, damping) * ~held
        pressing = ((step < 0.0) & at_low) | ((step > 0.0) & at_high)
        if not pressing.any():
            break
        held |= pressing
    return step * ~held


def _damped(jacobian: Array, error: Array, home: Array, damping: Array) -> Array:
    """J^T (J J^T + mu s_max^2)^(-1) e + (1 - J^+ J) home, by singular values: (K, m, n) -> (K, n)."""
    u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
    largest = np.maximum(s[:, :1], 1e-300)
    keep = s > _NULL * largest
    gain = np.where(keep, s / (s**2 + damping[:, None] * largest**2 + ~keep), 0.0)
    along = gain * np.einsum("kir,ki->kr", u, error)
    back = np.where(keep, np.einsum("krn,kn->kr", vt, home), 0.0)
    return home + np.einsum("krn,kr->kn", vt, along - back)
