"""Hand-eye calibration of an arm as its table has it, from places of a ball, a third of which may be wrong.

    m_i = X^T (R_i^T (p - b_i) - t) / k

with the flange's frame (R_i, b_i), the camera's frame on it (X, t) and the ball's place p in the base frame. A camera
in the room before a ball on the flange obeys the same equation with the flange's inverse frames. How far away a ball
is follows from its size, so that a ball k times as large as told is k times as far as measured.

Least trimmed squares (Rousseeuw 1984): from fits of a few places drawn at random, those that fit best are fitted again
in turns, and the best such fit counts; then all places that agree with it are fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray, IndexArray
from calib.distributions import chi_median
from calib.kinematics.hand_eye import solve_hand_eye

_DRAWN, _DRAWS = 5, 40  # places a draw; of a third wrong, one draw of 40 has none in 99 of 100 cases
_GOOD = 3.0  # trimmed misfit over noise of a fit that is not to be bettered
_TRIMMED = 0.6  # share of the places that is fitted
_FEWEST = 7
_TURNS, _STEPS = 4, 12
_FINAL_TURNS = 8
_SETTLED = 1e-9
_ARM_MM = 0.5  # error of an arm as delivered, beside a place's own noise
_FAR = 5.0  # times the usual misfit, from which a place is wrong
_MM_PER_RADIAN, _MM_OF_SCALE = 500.0, 500.0


@dataclass(frozen=True)
class BallHandEye:
    """Misfit of M places of a ball about an arm without errors, and the size of the ball that fits best."""

    kept: BoolArray  # (M,) places that agree with each other and the arm
    error_mm: Array  # (M, 3) predicted minus measured, camera frame
    misfit: float  # usual error over the noise of places and arm
    scale: float  # of the ball, and of the measured lengths, at which they agree best with the arm's
    scale_sigma: float  # inf where the poses do not tell


def ball_hand_eye(
    base_T_flange: Array, seen_mm: Array, covariance_mm2: Array, rng: np.random.Generator, *, on_flange: bool
) -> BallHandEye:
    """Hand-eye calibration from M poses of the flange (M, 4, 4) and places of the ball (M, 3), camera's frame.

    covariance_mm2  # (M, 3, 3) of the places; on_flange: whether the camera is on the flange.
    """
    whiten = np.linalg.inv(np.linalg.cholesky(covariance_mm2 + _ARM_MM**2 * np.eye(3)))
    problem = _Places(base_T_flange if on_flange else frames.invert(base_T_flange), seen_mm, whiten)
    count = len(seen_mm)
    fitted = min(count, max(int(np.ceil(_TRIMMED * count)), _FEWEST))
    best, least = None, np.inf
    for draw in range(_DRAWS):
        few: IndexArray = np.arange(count) if draw == 0 else rng.choice(count, min(_DRAWN, count), replace=False)
        fit = problem.started(few)
        for _ in range(_TURNS):
            nearest = np.argsort(problem.far(fit))[:fitted]
            fit = problem.solved(fit, nearest)
        cost = float(np.sum(np.sort(problem.far(fit))[:fitted] ** 2))
        if best is None or cost < least:
            best, least = fit, cost
        if least < 3.0 * fitted * _GOOD**2:
            break
    assert best is not None
    kept: BoolArray = np.zeros(count, dtype=bool)
    kept[np.argsort(problem.far(best))[:fitted]] = True
    for _ in range(_FINAL_TURNS):
        far = problem.far_from_others(best, kept)
        misfit = max(float(np.median(far)) / chi_median(3), 1e-9)
        now = far < _FAR * max(misfit, 1.0)
        best = problem.solved(best, np.flatnonzero(now))
        if np.array_equal(now, kept):
            break
        kept = now
    return BallHandEye(kept, problem.errors(best)[0], misfit, best.scale, problem.scale_sigma(best, kept))


@dataclass(frozen=True)
class _Fit:
    """Unknowns of the equation above."""

    turn: Array  # (3, 3) X
    shift_mm: Array  # (3,) t
    place_mm: Array  # (3,) p
    scale: float


@dataclass(frozen=True)
class _Places:
    """Measured places of a ball, with the frames of the body that carries the camera."""

    base_T_carrier: Array  # (M, 4, 4)
    seen_mm: Array  # (M, 3)
    whiten: Array  # (M, 3, 3)

    def started(self, rows: IndexArray) -> _Fit:
        """Fit of some places with equal weights at the told scale."""
        names = np.full(len(rows), "")
        found = solve_hand_eye(self.base_T_carrier[rows], self.seen_mm[rows], names, names)
        at = found.flange_T_scanner[""]
        return _Fit(at[:3, :3], at[:3, 3], found.position_mm[""], 1.0)

    def errors(self, fit: _Fit) -> tuple[Array, Array]:
        """Predicted minus measured places (M, 3), and the predicted ones in the carrier's axes about the camera."""
        away = fit.place_mm - self.base_T_carrier[:, :3, 3]
        about = np.einsum("mji,mj->mi", self.base_T_carrier[:, :3, :3], away) - fit.shift_mm
        return about @ fit.turn / fit.scale - self.seen_mm, about

    def far(self, fit: _Fit) -> Array:
        """Lengths (M,) of the whitened errors."""
        return np.asarray(np.linalg.norm(np.einsum("mij,mj->mi", self.whiten, self.errors(fit)[0]), axis=1))

    def far_from_others(self, fit: _Fit, kept: BoolArray) -> Array:
        """Lengths (M,) of the whitened errors from a fit of the places kept without the place itself.

        They are those of T of `calib.fitting.robust`.
        """
        error, columns = self._columns(fit)
        flat = columns[kept].reshape(-1, 10)
        lever = columns @ np.linalg.pinv(flat.T @ flat, rcond=1e-12, hermitian=True) @ np.swapaxes(columns, 1, 2)
        spread = (1.0 + 1e-9) * np.eye(3) + np.where(kept[:, None, None], -lever, lever)
        return np.asarray(np.sqrt(np.einsum("mi,mi->m", error, np.linalg.solve(spread, error[:, :, None])[:, :, 0])))

    def _columns(self, fit: _Fit) -> tuple[Array, Array]:
        """Whitened errors (M, 3) and their derivatives (M, 3, 10) by turn, shift, place, and logarithm of the scale.

        Turns and scale are in units of a mm at usual lengths.
        """
        error, about = self.errors(fit)
        back = fit.turn.T / fit.scale
        by_turn = back @ frames.skew(about) / _MM_PER_RADIAN
        by_place = back @ np.swapaxes(self.base_T_carrier[:, :3, :3], 1, 2)
        by_scale = -(error + self.seen_mm)[:, :, None] / _MM_OF_SCALE
        by_shift = np.broadcast_to(-back, by_place.shape)
        columns = np.concatenate([by_turn, by_shift, by_place, by_scale], axis=2)
        return np.einsum("mij,mj->mi", self.whiten, error), self.whiten @ columns

    def solved(self, fit: _Fit, rows: IndexArray) -> _Fit:
        """Least-squares fit of some places, from another one, by Gauss-Newton."""
        for _ in range(_STEPS):
            error, columns = self._columns(fit)
            step = np.linalg.lstsq(columns[rows].reshape(-1, 10), -error[rows].ravel(), rcond=1e-6)[0]
            turn = frames.rotation_from_rotvec(step[:3] / _MM_PER_RADIAN) @ fit.turn
            scale = fit.scale * float(np.exp(np.clip(step[9] / _MM_OF_SCALE, -0.5, 0.5)))
            fit = _Fit(turn, fit.shift_mm + step[3:6], fit.place_mm + step[6:9], scale)
            if np.max(np.abs(step)) < _SETTLED * _MM_PER_RADIAN:
                break
        return fit

    def scale_sigma(self, fit: _Fit, kept: BoolArray) -> float:
        """Standard deviation of the scale, by what the fit of the places kept leaves."""
        error, columns = self._columns(fit)
        flat = columns[kept].reshape(-1, 10)
        dof = len(flat) - 10
        _, size, ways = np.linalg.svd(flat, full_matrices=False)
        if dof <= 0 or len(size) < 10 or size[-1] < 1e-6 * size[0]:
            return float("inf")
        variance = float(np.sum((ways[:, 9] / size) ** 2)) * float(np.sum(error[kept] ** 2)) / dof
        return fit.scale * float(np.sqrt(variance)) / _MM_OF_SCALE
