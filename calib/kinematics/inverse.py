"""Inverse kinematics: joint vectors that bring an arm's tool to its goal, all goals at once.

Newton's method on the arm's own forward map. With the derivative J of the position by the joints and the remaining
error e, rows and columns both in millimetres (`InverseProblem`), a step is

    dq = J^T (J J^T + mu)^(-1) e + (1 - J^+ J) (q0 - q)

by the singular values of J. The second term makes a redundant arm move the least from q0; a damped step (mu > 0:
Levenberg 1944; Nakamura and Hanafusa 1986) leaves it out. A `Preference` is a further quantity r to be made
small by the free motion: with its derivative S that minimises |q0 - q|^2 + |r|^2. Joints that press against a limit are
fixed there and the others step anew. Two rules set the damping:

* `FROM_NEARBY`: mu is 0 while full steps lower |e|; a step that does not is refused and mu is raised.
* `FROM_ANYWHERE`: for random starts, from which |e| may first have to rise: mu is constant and every step is taken.

J may leave out terms that change slowly with q: that costs an iteration or two and no accuracy, since e is exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray

_EXACT_MM = 1e-10  # an error below this may rise again in rounding
_SETTLED = 1e-12  # no joint moves by more (scaled): done
_NULL = 1e-10  # singular values below this share of the largest give no direction
_FIRST_DAMPING, _LAST_DAMPING = 1e-8, 1e4  # shares of the largest squared singular value


Preference = Callable[[Array, IndexArray], tuple[Array, Array]]
"""Function of q (K, n) and goals `rows` (K,): the quantity to be made small (K, s), and its derivative by the scaled
joints (K, s, n), both in units of a joint's scaled motion."""


class InverseProblem(Protocol):
    """Inverse kinematics problem: N goals for an arm with n joints, each goal as m equations."""

    @property
    def joint_units(self) -> Array:
        """Size (n,) of one scaled unit of each joint, rad or mm."""
        ...

    def linearise(self, q: Array, rows: IndexArray) -> tuple[Array, Array]:
        """Errors (K, m), mm, of K of the goals at q (K, n), and their derivatives (K, m, n) by the scaled joints.

        Turns count in mm too, times a length that the problem chooses.
        """
        ...


@dataclass(frozen=True)
class StepRule:
    """Rule by which the steps of the inverse kinematics are damped and accepted."""

    iterations: int
    constant_damping_mm2: float = 0.0  # mu; 0: damped only where a full step does not lower the error
    longest_step: float = np.inf  # of any joint, scaled
    by_normal_equations: bool = False  # instead of singular values: quicker; only for a constant damping


FROM_NEARBY = StepRule(iterations=100)
FROM_ANYWHERE = StepRule(iterations=60, constant_damping_mm2=25.0, longest_step=0.5)


def solve_inverse(
    problem: InverseProblem,
    start: Array,
    low: Array,
    high: Array,
    rule: StepRule = FROM_NEARBY,
    prefer: Preference | None = None,
) -> Array:
    """Joint vectors (N, n) within limits that reach the goals with the least error, near start values.

    `prefer`: a quantity that a redundant arm makes small by its free motion, in addition to that motion itself.
    Where a goal cannot be met the result is the closest approach that was found; ask the problem how close.
    """
    units = problem.joint_units
    takes_all = rule.constant_damping_mm2 > 0.0
    q = np.clip(start, low, high)
    active = np.arange(len(q))
    damping = np.zeros(len(q))
    error, jacobian = problem.linearise(q, active)
    for _ in range(rule.iterations):
        if len(active) == 0:
            break
        at = q[active]
        is_damped = takes_all | (damping[active, None] > 0.0)
        to_start = np.where(is_damped, 0.0, (start[active] - at) / units)
        damped = (damping[active], rule.constant_damping_mm2)
        if rule.by_normal_equations:
            step = _damped_by_normal_equations(jacobian, error, rule.constant_damping_mm2)
        else:
            preferred = None if prefer is None else prefer(at, active)
            step = _step(jacobian, error, to_start, damped, at <= low[active], at >= high[active], preferred)
        longest = np.abs(step).max(axis=1, keepdims=True)
        step = step * np.minimum(1.0, rule.longest_step / np.maximum(longest, 1e-12))
        trial = np.clip(at + step * units, low[active], high[active])
        trial_error, trial_jacobian = problem.linearise(trial, active)
        before, after = np.linalg.norm(error, axis=1), np.linalg.norm(trial_error, axis=1)
        accepted = takes_all | (after < before) | (after <= _EXACT_MM)
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
    to_start: Array,
    damping: tuple[Array, float],
    at_low: BoolArray,
    at_high: BoolArray,
    preferred: tuple[Array, Array] | None = None,
) -> Array:
    """Scaled joint steps (K, n) that respect the limits: joints at a limit stay fixed and the others compensate."""
    fixed = np.zeros_like(at_low)
    for _ in range(jacobian.shape[2]):
        if preferred is None:
            step = _damped(jacobian * ~fixed[:, None], error, to_start, damping) * ~fixed
        else:
            step = _preferring(jacobian, error, to_start, damping, preferred, ~fixed) * ~fixed
        pressing = ((step < 0.0) & at_low) | ((step > 0.0) & at_high)
        if not pressing.any():
            break
        fixed |= pressing
    return step * ~fixed


def _damped(jacobian: Array, error: Array, to_start: Array, damping: tuple[Array, float]) -> Array:
    """Damped least-squares steps (K, n), with redundant motion towards the start, by singular value decomposition.

    J^T (J J^T + mu)^(-1) e + (1 - J^+ J) to_start, with the singular values of J (K, m, n).

    damping  # (K,) as a share of the largest squared singular value, and one for all in mm^2: mu is their sum
    """
    share, constant_mm2 = damping
    u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
    largest = np.maximum(s[:, :1], 1e-300)
    keep = s > _NULL * largest
    gain = np.where(keep, s / (s**2 + share[:, None] * largest**2 + constant_mm2 + ~keep), 0.0)
    along = gain * np.einsum("kir,ki->kr", u, error)
    back = np.where(keep, np.einsum("krn,kn->kr", vt, to_start), 0.0)
    return to_start + np.einsum("krn,kr->kn", vt, along - back)


def _preferring(
    jacobian: Array,
    error: Array,
    to_start: Array,
    damping: tuple[Array, float],
    preferred: tuple[Array, Array],
    free: BoolArray,
) -> Array:
    """Damped least-squares steps (K, n) of the free joints, with redundant motion along a secondary objective.

    They are as by `_damped`, with the free motion in the metric W = 1 + S^T S.

    By W = L L^T the motion y = L^T dq counts evenly, and W^-1 (to_start + S^T r) is its minimum without the goal.
    """
    remaining, derivative = preferred
    derivative = derivative * free[:, None]
    metric = np.eye(jacobian.shape[2]) + np.swapaxes(derivative, 1, 2) @ derivative
    inverse = np.linalg.inv(np.linalg.cholesky(metric))  # L^-1
    undamped = (damping[0] + damping[1] == 0.0)[:, None]
    pull = (to_start + np.where(undamped, np.einsum("ksn,ks->kn", derivative, remaining), 0.0)) * free
    across = (jacobian * free[:, None]) @ np.swapaxes(inverse, 1, 2)
    motion = _damped(across, error, np.einsum("kmn,kn->km", inverse, pull), damping)
    return np.einsum("knm,kn->km", inverse, motion)


def _damped_by_normal_equations(jacobian: Array, error: Array, constant_mm2: float) -> Array:
    """Damped least-squares steps (K, n) J^T (J J^T + mu)^(-1) e, by the normal equations."""
    square = jacobian @ np.swapaxes(jacobian, 1, 2) + constant_mm2 * np.eye(jacobian.shape[1])
    return np.einsum("kmn,km->kn", jacobian, np.linalg.solve(square, error[..., None])[..., 0])
