"""Nonlinear least squares by Gauss-Newton steps in a trust region, parameters scaled by their tolerances.

Millimetres and radians share the vector, so each column is scaled by its parameter's tolerance. The step comes from
the singular values of the scaled Jacobian; while the full Gauss-Newton step (Jang eq 16: the pseudo-inverse) lowers the
cost as predicted it is taken whole, which is why exact data are met in a handful of iterations. Where it does not, the
step is limited to a radius (More and Sorensen 1983): in near-redundant directions the pseudo-inverse divides by
almost nothing and its steps are far too long.

Where the residual is large, its curvature makes full steps too short or too long, and they shrink slowly. Then the last
few are combined so that their steps cancel best (Anderson 1965), and the combination is taken where it lowers the cost
further.

The prior is a normal distribution of each correction, its mean zero unless arms of the type tell another one, its sigma
the manufacturing tolerance. Its weight is the noise
estimated from the residual, at least the declared noise, so that degenerate arms (links without length) cannot lower
it. For exact data a last step, near that fit, lowers the weight further.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.errors import FitError
from calib.fitting.fit import Fit, Iteration
from calib.fitting.residual import Residuals

_NULL = 1e-10  # share of the largest singular value, below which a direction carries no information
_FLOOR = 1e-9  # share of the first residual, below which the residual is rounding
_LOOSE = 0.05  # share of a parameter in null directions that makes it undetermined; less is curvature
_NO_INFLUENCE = 1e-6  # sigmas by which a whole tolerance moves the residual, below which it has no influence
_WEIGHINGS = 8  # of the prior against the noise, at the most
_SLOW_WEIGHINGS = 25  # where each is settled before the next
_SUSPECT = 15.0  # tolerances that a parameter was moved by, from which a fit is looked for nearer to the nominal arm
_OVERDETERMINED = 0.2  # share of the equations that have to be left over without the floor
_ELSEWHERE = 5.0  # tolerances, the most that a parameter moves by where the noise is taken as less than the floor
_CONVERGED = 3e-4  # a full step would move no parameter by more than this share of its sigma
_MEMORY = 5  # full steps that are remembered
_SLOW = 0.3  # of the full step before


def solve(
    residuals: Residuals, *, start: ArrayLike | None = None, prior: bool = True, max_iterations: int = 100
) -> Fit:
    """Least-squares fit: minimum of the squared residuals and, with a prior, of squared corrections over tolerances.

    Args:
        residuals: the problem.
        start: (P,) first guess, such as an earlier fit; zeros, the nominal robot, where None.
        prior: normal prior on each correction, with `Parameter.prior_mean` as mean and `Parameter.scale` as sigma.
        max_iterations: largest number of accepted steps.

    Raises:
        FitError: no free parameter, too few rows, or a residual that is not finite at the start.
    """
    if not residuals.parameters:
        raise FitError("no free parameter: everything is fixed; free at least one")
    descent = _Descent(residuals, start, max_iterations)
    if not prior:
        descent.run(weight=0.0)
        return descent.fit(weight=0.0)
    weight = _settle(descent, residuals.noise_floor)
    if float(np.max(np.abs(descent.from_mean))) > _SUSPECT:
        # A step that promised much may have led where the prior no longer counts: slowly, from the start.
        slow = _Descent(residuals, start, max_iterations)
        slow_weight = _settle(slow, residuals.noise_floor, hurry=False)
        if slow.surprise(slow_weight) < descent.surprise(weight):
            descent, weight = slow, slow_weight
    return _below_floor(descent, weight, residuals.noise_floor)


def _settle(descent: _Descent, floor: float, *, hurry: bool = True) -> float:
    """Weight of the prior after descending until it equals the residual's noise or the floor, the larger one.

    Without a floor, an arm without length would meet any constraint (a ball in a socket, a tip on a plane) at no cost.
    """
    weight = max(descent.first_weight(), floor)
    while hurry and descent.steps < descent.limit:
        # One step for one weight: the prior's weight follows the residual down. A weight far below the residual's noise
        # would take long steps in near-redundant directions, which the next weight would have to take back.
        descent.run(weight, steps=1)
        noise = max(descent.noise(weight), floor)
        if descent.reason or not noise > floor or abs(noise - weight) <= 0.05 * weight:
            break
        weight = max(floor, min(noise, max(descent.promised_noise(), 0.01 * weight)))
    for _ in range(_WEIGHINGS if hurry else _SLOW_WEIGHINGS):
        descent.run(weight)
        noise = descent.noise(weight)
        if not np.isfinite(noise) or abs(max(noise, floor) - weight) <= 0.05 * weight:
            break
        weight = max(noise, floor)
    return weight


def _below_floor(descent: _Descent, weight: float, floor: float) -> Fit:
    """Fit whose prior weighs less, for residuals far below the declared noise, as of computed points.

    It is lowered only with many degrees of freedom, and only as far as no parameter changes by several tolerances.
    """
    fit, before = descent.fit(weight), descent.z
    if not fit.reduced_chi < floor:
        return fit
    noise = fit.reduced_chi
    for _ in range(_WEIGHINGS):
        if not noise > 1e-9:
            break
        weight = noise
        descent.run(weight)
        noise = descent.noise(weight)
        if abs(noise - weight) <= 0.05 * weight:
            break
    below, further = descent.fit(weight), float(np.max(np.abs(descent.z - before)))
    overdetermined = below.degrees_of_freedom > _OVERDETERMINED * (fit.rows - descent.residuals.degrees_spent)
    return below if overdetermined and further <= _ELSEWHERE else fit


@dataclass(frozen=True)
class _Factors:
    """Singular value decomposition of the linearised problem A z + b, with A = U diag(s) V^T and g = U^T b."""

    s: Array
    v: Array
    g: Array

    def with_prior(self, weight: float, from_mean: Array) -> _Factors:
        """Decomposition of the linearised problem with the prior's rows added.

        These are the factors of [A; w 1] with right-hand side [b; w (z - mean)], whose V is that of A.

        Directions without information are left out.
        """
        s = np.hypot(self.s, weight)
        g = (self.s * self.g + weight**2 * (self.v.T @ from_mean)) / np.maximum(s, 1e-300)
        keep = s > _NULL * max(float(s[0]), 1e-300)
        return _Factors(s[keep], self.v[:, keep], g[keep])

    @property
    def possible_drop(self) -> float:
        """Largest possible decrease of the squared norm in the linear model."""
        return float(self.g @ self.g)

    def step(self, radius: float) -> tuple[Array, float]:
        """Step within a radius that minimises the linearised problem, and the predicted decrease of its square."""

        def damped(mu: float) -> Array:
            return -self.s * self.g / (self.s**2 + mu)

        y = damped(0.0)
        if np.linalg.norm(y) > radius:
            low, high = 1e-30 * self.s[0] ** 2, float(np.linalg.norm(self.s * self.g)) / radius
            while high > 1.01 * low:
                middle = float(np.sqrt(low * high))
                low, high = (middle, high) if np.linalg.norm(damped(middle)) > radius else (low, middle)
            y = damped(high)
        return self.v @ y, self.possible_drop - float(np.sum((self.g + self.s * y) ** 2))


def _factorise(matrix: Array, rhs: Array) -> _Factors:
    """Singular value decomposition of a linear problem with matrix (R, P) and right-hand side (R,)."""
    # R of [A b] carries the whole problem in P + 1 rows, however many poses there are.
    r = np.asarray(np.linalg.qr(np.column_stack([matrix, rhs]), mode="r"))
    count = matrix.shape[1]
    u, s, vt = np.linalg.svd(r[:, :-1])
    return _Factors(_padded(s, count), vt.T, _padded((u.T @ r[:, -1])[:count], count))


def _padded(values: Array, count: int) -> Array:
    return np.concatenate([values, np.zeros(count - len(values))])


def _is_slow(full: list[tuple[Array, Array]]) -> bool:
    """Whether the last full step is hardly shorter than the one before, as in slow linear convergence."""
    return len(full) > 1 and bool(np.linalg.norm(full[-1][1]) > _SLOW * np.linalg.norm(full[-2][1]))


def _limit(full: list[tuple[Array, Array]]) -> Array:
    """Extrapolated limit of slowly converging steps: the mix of the last points whose steps cancel best (Anderson)."""
    points, steps = np.array(full).transpose(1, 2, 0)  # each (P, points)
    moves, changes = np.diff(points), np.diff(steps)
    mix = np.linalg.lstsq(changes, steps[:, -1], rcond=1e-6)[0]
    return points[:, -1] + steps[:, -1] - (moves + changes) @ mix


class _Descent:
    """State of one run of the solver: z = x / tolerance (P,), its cost and factors, and the iterations so far."""

    def __init__(self, residuals: Residuals, start: ArrayLike | None, max_iterations: int) -> None:
        self.residuals = residuals
        self.scales = np.array([p.scale for p in residuals.parameters])
        self.mean = np.array([p.prior_mean for p in residuals.parameters]) / self.scales
        self.z = np.zeros(len(self.scales)) if start is None else np.asarray(start, dtype=float) / self.scales
        self.limit = max_iterations
        residual = residuals.residual(self.z * self.scales)
        if not np.all(np.isfinite(residual)):
            raise FitError("the residual is not finite at the start; check the points and the robot's table")
        self.cost = float(residual @ residual)
        self.history = [Iteration(self.z * self.scales, self.cost, 0.0)]
        self.converged, self.reason = False, ""
        self._linearise()
        s = (self._factors_at(0.0 * self.z) if np.any(self.z) else self.factors).s
        self.rank = int(np.sum(s > max(1e-9 * float(s[0]), _NO_INFLUENCE)))

    def _factors_at(self, z: Array) -> _Factors:
        at = self.residuals.linearise(z * self.scales)
        self.rows = len(at.residual)
        return _factorise(at.jacobian * self.scales, at.residual)

    def _linearise(self) -> None:
        self.factors = self._factors_at(self.z)

    @property
    def from_mean(self) -> Array:
        """Difference (P,) of the parameters from the prior's mean, in tolerances."""
        return self.z - self.mean

    @property
    def steps(self) -> int:
        return len(self.history) - 1

    def first_weight(self) -> float:
        """Prior's weight at the start: residual sigma over declared sigma; 1 where no degree of freedom is left."""
        noise = self.noise(1.0)
        return noise if np.isfinite(noise) and noise > 0.0 else 1.0

    def promised_noise(self) -> float:
        """Predicted residual sigma over declared sigma after a full step without prior, in the linear model."""
        factors = self.factors.with_prior(0.0, self.from_mean)
        left = self.rows - self.residuals.degrees_spent - len(factors.s)
        return float(np.sqrt(max(self.cost - factors.possible_drop, 0.0) / left)) if left > 0 else np.inf

    def run(self, weight: float, steps: int | None = None) -> None:
        """Descend to the minimum of |residual|^2 + weight^2 |z - mean|^2, by at most `steps` steps."""
        radius = np.inf
        last = None if steps is None else self.steps + steps
        full: list[tuple[Array, Array]] = []  # the last points, each with its full step
        self._stop(False, "")
        while True:
            factors = self.factors.with_prior(weight, self.from_mean)
            objective = self.cost + weight**2 * float(self.from_mean @ self.from_mean)
            if factors.possible_drop <= _CONVERGED**2 * objective / self.rows:
                return self._stop(True, "the gradient vanishes")
            if self.steps == last:
                return None
            if self.steps >= self.limit:
                return self._stop(False, f"the limit of {self.limit} iterations was reached")
            step, predicted = factors.step(radius)
            drop, cost = self._drop(step, weight, objective)
            if np.linalg.norm(step) < 0.99 * radius:
                full = [*full[-_MEMORY:], (self.z, step)]
            if _is_slow(full):
                further = _limit(full) - self.z
                further_drop, further_cost = self._drop(further, weight, objective)
                if further_drop > drop:
                    step, drop, cost = further, further_drop, further_cost
            while not (drop > 0.0 and drop >= 1e-4 * predicted):
                if self._at_floor() or predicted <= 1e-12 * objective:
                    return self._stop(True, "no step lowers the cost beyond rounding")
                radius = 0.25 * float(np.linalg.norm(step))
                if radius < 1e-12:
                    return self._stop(False, "no step lowers the cost, although the gradient does not vanish")
                step, predicted = factors.step(radius)
                drop, cost = self._drop(step, weight, objective)
            length = float(np.linalg.norm(step))
            if drop > 0.75 * predicted:
                radius = max(radius, 3.0 * length)
            elif drop < 0.25 * predicted:
                radius = 0.5 * length
            self.z, self.cost = self.z + step, cost
            self.history.append(Iteration(self.z * self.scales, cost, length))
            self._linearise()
            if self._at_floor() and drop < 0.9 * objective:
                return self._stop(True, "the residual is at the level of rounding")

    def _drop(self, step: Array, weight: float, objective: float) -> tuple[float, float]:
        """Decrease of the objective by a step, and the squared residual after the step."""
        z = self.z + step
        residual = self.residuals.residual(z * self.scales)
        cost = float(residual @ residual) if np.all(np.isfinite(residual)) else np.inf
        from_mean = z - self.mean
        return objective - cost - weight**2 * float(from_mean @ from_mean), cost

    def _at_floor(self) -> bool:
        return self.cost <= _FLOOR**2 * self.history[0].cost

    def _stop(self, converged: bool, reason: str) -> None:
        self.converged, self.reason = converged, reason

    def degrees_of_freedom(self, weight: float) -> float:
        """Degrees of freedom: rows minus eliminated unknowns minus effective number of parameters."""
        s2 = self.factors.s**2
        penalty = weight**2 if weight > 0.0 else (_NULL**2) * float(s2.max())
        return self.rows - self.residuals.degrees_spent - float(np.sum(s2 / (s2 + penalty)))

    def noise(self, weight: float) -> float:
        """Residual sigma over declared sigma (reduced chi); nan where no degree of freedom is left."""
        left = self.degrees_of_freedom(weight)
        return float(np.sqrt(self.cost / left)) if left > 0.5 else float("nan")

    def surprise(self, weight: float) -> float:
        """Negative log posterior density of parameters and noise, times two, up to a constant."""
        left = max(self.degrees_of_freedom(weight), 1.0)
        variance = max(self.cost / left, self.residuals.noise_floor**2)
        return float(left * np.log(variance) + self.cost / variance + self.from_mean @ self.from_mean)

    def fit(self, weight: float) -> Fit:
        noise = self.noise(weight)
        sigma = noise if np.isfinite(noise) and noise > 0.0 else 1.0
        s, v = self.factors.s, self.factors.v
        is_null = s <= 1e-9 * max(float(s[0]), 1e-300)
        information = np.where(is_null, 0.0, s**2) / sigma**2 + (1.0 if weight > 0.0 else 0.0)
        variance = np.divide(1.0, information, out=np.zeros_like(information), where=information > 0.0)
        covariance = (v * variance) @ v.T
        loose = np.linalg.norm(v[:, is_null], axis=1) > _LOOSE
        return Fit(
            parameters=self.residuals.parameters,
            x=self.z * self.scales,
            covariance=covariance * np.outer(self.scales, self.scales),
            undetermined=loose & (weight == 0.0),
            iterations=tuple(self.history),
            converged=self.converged,
            reason=self.reason,
            rank=self.rank,
            known=int(np.sum(s / sigma > 1.0)),
            rows=self.rows,
            degrees_of_freedom=self.degrees_of_freedom(weight),
            reduced_chi=noise,
        )
