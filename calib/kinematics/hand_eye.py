"""Robot-world and hand-eye calibration: scanner poses on the flange and target positions, without a first guess.

    R_i (X s_i + t) + b_i = p

with the flange's frame (R_i, b_i) at each pose, the measured point s_i in the scanner's frame, the scanner's frame on
the flange (X, t) of each setup, and the position p of each target in the base frame. The equation is linear in the nine
numbers of X, in t and in p. With t and p eliminated, a quadratic form of X remains: its minimum is brought to a
rotation, and from there, and from rotations all over SO(3) in case the points determine fewer than nine numbers, the
least squares on rotations are found. Then all unknowns are refined together.

Where the orientation O_i of the jig was measured as well, R_i X O_i = Y is that of the jig in the world, the same at
all poses (A X = Y B): linear in X too, and part of the same quadratic form.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from calib import frames
from calib.array_types import Array, BoolArray, Vector
from calib.kinematics.robot import Robot, Target

POSITION_SIGMA_MM = 1000.0
"""Prior's sigma of a target's coordinate in the world: it is known by the points alone."""
_MM_PER_RADIAN = 500.0  # weight of turns against shifts
_OPEN = 1e-6  # share of the largest singular value, below which the poses do not determine a motion
_HARDLY_KNOWN = 2e-3  # such a share, below which positions are known a hundred times worse than points
_STEPS = 30
_SETTLED = 1e-10


@dataclass(frozen=True)
class HandEye:
    """Scanner poses on the flange, target positions in the world, and motions that the poses leave undetermined."""

    flange_T_scanner: Mapping[str, Array]  # by setup, (4, 4)
    position_mm: Mapping[str, Array]  # by target, (3,) in the base frame
    undetermined_rotation: bool  # whether some turn of a scanner on the flange changes no measured point
    undetermined_shifts: Array  # (K, 3) orthonormal, base frame: along which targets and scanner may shift together


def with_world_targets(robot: Robot, position_mm: Mapping[str, Array]) -> Robot:
    """Robot with further targets added at positions (3,), mm in the base frame, fixed in the world."""
    known = {target.name for target in robot.targets if target.in_world}
    added = [
        Target(name, _vector(xyz_mm), POSITION_SIGMA_MM, in_world=True)
        for name, xyz_mm in position_mm.items()
        if name not in known
    ]
    return replace(robot, targets=(*robot.targets, *added))


def _vector(position_mm: Array) -> Vector:
    x, y, z = position_mm.tolist()
    return (x, y, z)


def solve_hand_eye(
    base_T_flange: Array,
    scanner_mm: Array,
    setup: NDArray[np.str_],
    target: NDArray[np.str_],
    scanner_R_jig: Array | None = None,
) -> HandEye:
    """Scanner poses on the flange and target positions with the least squared error at M points.

    base_T_flange  # (M, 4, 4); scanner_mm  # (M, 3); setup, target  # (M,) names
    scanner_R_jig  # (M, 3, 3) where the jig's orientation was measured, else nan
    """
    problem = _Problem.of(base_T_flange, scanner_mm, setup, target)
    if scanner_R_jig is not None and np.isfinite(scanner_R_jig).all(axis=(1, 2)).any():
        problem = replace(problem, scanner_R_jig=scanner_R_jig)
    turns = np.stack([problem.best_rotation(k) for k in range(len(problem.setups))])
    turns, shifts, places = problem.refined(turns)
    undetermined_rotation, undetermined_shifts = problem.undetermined(turns)
    return HandEye(
        {name: frames.make_transform(turns[k], shifts[k]) for k, name in enumerate(problem.setups)},
        {name: places[k] for k, name in enumerate(problem.targets)},
        undetermined_rotation,
        undetermined_shifts,
    )


@dataclass(frozen=True)
class _Problem:
    """Hand-eye equations R (X s + t) + b = p of M points, for S setups (X, t) and T target positions p."""

    rotation: Array  # (M, 3, 3) base_R_flange
    origin_mm: Array  # (M, 3) of the flange, about `centre_mm`
    scanner_mm: Array  # (M, 3)
    setup: Array  # (M, S) 1 where a point is of a setup
    target: Array  # (M, T) 1 where a point is of a target
    setups: tuple[str, ...]
    targets: tuple[str, ...]
    centre_mm: Array  # (3,)
    scanner_R_jig: Array | None = None  # (M, 3, 3), nan where it is not known

    @classmethod
    def of(cls, base_T_flange: Array, scanner_mm: Array, setup: NDArray[np.str_], target: NDArray[np.str_]) -> _Problem:
        setups, targets = np.unique(setup), np.unique(target)
        centre_mm = base_T_flange[:, :3, 3].mean(axis=0)
        return cls(
            rotation=base_T_flange[:, :3, :3],
            origin_mm=base_T_flange[:, :3, 3] - centre_mm,
            scanner_mm=scanner_mm,
            setup=(setup[:, None] == setups).astype(float),
            target=(target[:, None] == targets).astype(float),
            setups=tuple(map(str, setups)),
            targets=tuple(map(str, targets)),
            centre_mm=centre_mm,
        )

    @property
    def _shift_columns(self) -> Array:
        """Derivative (3 M, 3 S + 3 T) of the hand-eye residual by the scanner shifts t and target positions p."""
        by_shift = np.einsum("ms,mij->misj", self.setup, self.rotation)
        by_place = -np.einsum("mt,ij->mitj", self.target, np.eye(3))
        return np.concatenate(
            [by_shift.reshape(3 * len(self.rotation), -1), by_place.reshape(3 * len(self.rotation), -1)], axis=1
        )

    def best_rotation(self, k: int) -> Array:
        """Rotation flange_R_scanner (3, 3) of a setup, estimated from the setup's own points."""
        rows = self.setup[:, k] > 0.0
        rotation, scanner_mm = self.rotation[rows], self.scanner_mm[rows]
        scanner_mm = scanner_mm - scanner_mm.mean(axis=0)  # a common shift is part of t
        by_turn = np.einsum("mij,mk->mijk", rotation, scanner_mm).reshape(-1, 9)
        apart = replace(
            self, rotation=rotation, target=self.target[rows], setup=np.ones((len(rotation), 1))
        )._shift_columns
        u, s, _ = np.linalg.svd(apart, full_matrices=False)
        basis = u[:, s > _OPEN * s[0]]
        both = np.column_stack([by_turn, self.origin_mm[rows].ravel()])
        both = np.concatenate([both - basis @ (basis.T @ both), self._attitude_rows(rows)])
        both = np.asarray(np.linalg.qr(both, mode="r"))
        form, right = both[:, :9], both[:, 9]
        linear = np.linalg.lstsq(form, -right, rcond=1e-9)[0].reshape(3, 3)
        starts = np.concatenate([frames.nearest_rotation(linear)[None], _START_ROTATIONS])
        return _least_squares_rotation(form, right, starts)

    def _attitude_rows(self, rows: BoolArray) -> Array:
        """Equations (9 K, 10) that keep the jig's orientation in the world constant, linear in the rotation X.

        They are R X O less its mean, O being the jig's measured orientation at K points.

        A radian counts as `_MM_PER_RADIAN`.
        """
        if self.scanner_R_jig is None:
            return np.zeros((0, 10))
        known = rows & np.isfinite(self.scanner_R_jig).all(axis=(1, 2))
        by_turn = np.einsum("mai,mjb->mabij", self.rotation[known], self.scanner_R_jig[known])
        by_turn = by_turn.reshape(-1, 9, 9)
        apart = _MM_PER_RADIAN * (by_turn - by_turn.mean(axis=0)) if len(by_turn) else by_turn
        return np.column_stack([apart.reshape(-1, 9), np.zeros(9 * len(by_turn))])

    def _residual(self, turns: Array, shifts: Array, places: Array) -> tuple[Array, Array]:
        """Hand-eye residual R (X s + t) + b - p (M, 3), mm, and the rotated points R X s."""
        turned = np.einsum("ms,sij,mj->mi", self.setup, turns, self.scanner_mm)
        turned = np.einsum("mij,mj->mi", self.rotation, turned)
        shifted = np.einsum("mij,mj->mi", self.rotation, self.setup @ shifts)
        return turned + shifted + self.origin_mm - self.target @ places, turned

    def _turn_columns(self, turned: Array) -> Array:
        """Derivative (3 M, 3 S) of the hand-eye residual by small turns of each scanner about the flange's axes."""
        by_turn = -frames.skew(turned) @ self.rotation / _MM_PER_RADIAN
        return np.einsum("ms,mij->misj", self.setup, by_turn).reshape(3 * len(turned), -1)

    def refined(self, turns: Array) -> tuple[Array, Array, Array]:
        """Least-squares rotations (S, 3, 3), shifts (S, 3) and target positions (T, 3), from approximate rotations."""
        count = len(self.setups)
        columns = self._shift_columns
        shifts, places = np.zeros((count, 3)), np.zeros((len(self.targets), 3))
        residual, turned = self._residual(turns, shifts, places)
        linear = np.linalg.lstsq(columns, -residual.ravel(), rcond=_OPEN)[0].reshape(-1, 3)
        shifts, places = np.asarray(linear[:count]), np.asarray(linear[count:])
        for _ in range(_STEPS):
            residual, turned = self._residual(turns, shifts, places)
            every = np.concatenate([self._turn_columns(turned), columns], axis=1)
            step = np.linalg.lstsq(every, -residual.ravel(), rcond=_OPEN)[0].reshape(-1, 3)
            turns = frames.rotation_from_rotvec(step[:count] / _MM_PER_RADIAN) @ turns
            shifts, places = shifts + step[count : 2 * count], places + step[2 * count :]
            if np.max(np.abs(step)) < _SETTLED * _MM_PER_RADIAN:
                break
        return turns, shifts, places + self.centre_mm

    def undetermined(self, turns: Array) -> tuple[bool, Array]:
        """Whether a scanner rotation is undetermined, and the undetermined common shifts as directions (K, 3)."""
        count = len(self.setups)
        turned = self._residual(turns, np.zeros((count, 3)), np.zeros((len(self.targets), 3)))[1]
        every = np.concatenate([self._turn_columns(turned), self._shift_columns], axis=1)
        every = np.concatenate([every, self._attitude_changes()])
        _, s, vt = np.linalg.svd(every, full_matrices=True)
        size = np.concatenate([s, np.zeros(len(vt) - len(s))])
        undetermined_rotation = bool(np.any(np.abs(vt[size <= _OPEN * size[0], : 3 * count]) > 1e-3))
        along = vt[size <= _HARDLY_KNOWN * size[0], 6 * count :].reshape(-1, 3)
        _, s, vt = np.linalg.svd(along, full_matrices=False)
        return undetermined_rotation, vt[s > 0.1]

    def _attitude_changes(self) -> Array:
        """Derivative (3 K, 6 S + 3 T), by the unknowns, of the jig's orientation in the world less its mean."""
        width = 6 * len(self.setups) + 3 * len(self.targets)
        if self.scanner_R_jig is None:
            return np.zeros((0, width))
        known = np.isfinite(self.scanner_R_jig).all(axis=(1, 2))
        turns = np.einsum("ms,mij->misj", self.setup[known], self.rotation[known])
        turns = (turns - turns.mean(axis=0)).reshape(3 * np.count_nonzero(known), -1)
        return np.concatenate([turns, np.zeros((len(turns), width - turns.shape[1]))], axis=1)


def _rotations_of_cube() -> Array:
    """The 24 rotations (24, 3, 3) that take a cube to itself; no rotation is farther than 63 deg from one of them."""
    flips = [np.diag(signs) for signs in product((1.0, -1.0), repeat=3)]
    signed = [flip[list(order)] for order in permutations(range(3)) for flip in flips]
    return np.array([matrix for matrix in signed if np.linalg.det(matrix) > 0.0])


_START_ROTATIONS = _rotations_of_cube()


def _least_squares_rotation(form: Array, right: Array, starts: Array) -> Array:
    """Rotation X (3, 3) with the least |form vec(X) + right|^2, by damped Gauss-Newton from K starts (K, 3, 3)."""
    turns, damping = starts, np.full(len(starts), 1e-3)
    columns = form.reshape(-1, 3, 3)  # by X_ij
    cost = np.sum((np.einsum("rij,kij->kr", columns, turns) + right) ** 2, axis=1)
    for _ in range(_STEPS):
        residual = np.einsum("rij,kij->kr", columns, turns) + right
        # d X = [w]x X
        by_turn = np.stack(
            [np.einsum("rij,kij->kr", columns, frames.skew(axis) @ turns) for axis in np.eye(3)], axis=-1
        )
        square = np.swapaxes(by_turn, 1, 2) @ by_turn
        scale = np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        step = (
            -np.linalg.pinv(square + damping[:, None, None] * scale)
            @ np.einsum("krw,kr->kw", by_turn, residual)[..., None]
        )
        trial = frames.rotation_from_rotvec(step[..., 0]) @ turns
        trial_cost = np.sum((np.einsum("rij,kij->kr", columns, trial) + right) ** 2, axis=1)
        better = trial_cost < cost
        turns = np.where(better[:, None, None], trial, turns)
        cost = np.where(better, trial_cost, cost)
        damping = np.where(better, 0.2 * damping, 10.0 * damping)
    return np.asarray(turns[np.argmin(cost)])
