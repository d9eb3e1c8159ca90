"""Generalised least squares of changes of a cell against new residuals whose covariance is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.distributions import f_sf
from calib.monitoring.alarm import chance_of_least, weight
from calib.monitoring.kinds import ChangeModel, kind_words
from calib.monitoring.prediction_spread import Spread

ALARM = 0.005  # probability of an alarm where nothing changed, over all kinds
NOISIER = 0.0005  # probability of telling more noise where there is none
NAMED = 0.003  # of a change of the arm whatever the scanner did, over all kinds, where it explains everything alone
NAMED_BESIDE = 0.0003  # the same where the scanner shows beside it
ALONE = 0.05  # p-value of the scanner beside a change of the arm, from which on that explains everything alone
AS_WELL = 6.0  # chi squared by which another change may explain less and still be said
_ROUNDING = 1e-6  # share of a movement: what shows no more of it is not seen
_EACH = 2.5  # chi squared that each number of a change has to explain
SEEN_Z = 3.8 + 1.645  # sigmas of a size that passes NAMED 19 times of 20


@dataclass(frozen=True)
class Change:
    """One change. `vector`: of the tool its shift in its own frame, of the scanner shift (mm) and turn (rad)."""

    what: str
    joint: int | None
    parameter: str
    size: float
    sigma: float
    unit: str
    p_value: float
    as_well: tuple[str, ...]  # other changes that these poses do not tell from it
    vector: tuple[float, ...] = ()


@dataclass(frozen=True)
class Detectable:
    """The size from which on one kind of change is found 19 times of 20; None: these poses never show it."""

    what: str
    joint: int | None
    parameter: str
    size: float | None
    unit: str
    moves_mm: float | None  # how far that much moves the points, RMS


@dataclass(frozen=True)
class ChangeTest:
    """One kind against the residuals. `basis`: (3 M, K) what it makes of them, orthonormal."""

    kind: ChangeModel
    gain: float  # of chi squared
    p_value: float
    basis: Array

    @property
    def weighted(self) -> float:
        """The p-value over the kind's weight: small for what is usual."""
        return self.p_value / weight(self.kind)

    @property
    def score(self) -> float:
        """Twice the log odds of this change against none, beside a constant."""
        return self.gain - _EACH * self.kind.count + 2.0 * float(np.log(weight(self.kind)))


def the_likeliest(tests: list[ChangeTest]) -> ChangeTest | None:
    """The change that explains most for its numbers, usual kinds before others."""
    return max(tests, key=lambda test: test.score, default=None)


def as_well(tests: list[ChangeTest], best: ChangeTest) -> tuple[str, ...]:
    """Changes of no more numbers that explain about as much as the best."""
    return tuple(
        kind_words(t.kind)
        for t in tests
        if t is not best
        and (fewer := best.kind.count - t.kind.count) >= 0
        and t.gain > best.gain - AS_WELL - _EACH * fewer
        and t.p_value < ALARM
    )


@dataclass(frozen=True)
class ChangeTests:
    """New residuals with unit covariance, and what turns movements of the points (M, 3, K) into their rows."""

    y: Array  # (3 M,) zero along what the spread is blind to
    spread: Spread
    blocks: Array  # (M, 3, 3) from movements in the base frame, mm, to the residuals before they are whitened
    base_freedom: float  # of the noise, from the earlier fit

    @classmethod
    def of(cls, residual: Array, spread: Spread, blocks: Array, base_freedom: float) -> ChangeTests:
        """The tests for residuals (3 M,) whose covariance is that of `spread`."""
        return cls(spread.whiten(residual), spread, blocks, base_freedom)

    def rows(self, kind: ChangeModel) -> Array:
        """(3 M, K)"""
        moved = np.einsum("mij,mjk->mik", self.blocks, kind.columns)
        return self.spread.whiten(moved.reshape(len(self.y), -1))

    def _rest(self, given: list[ChangeModel]) -> tuple[Array, Array]:
        basis = np.zeros((len(self.y), 0))
        if given:
            u, s, _ = np.linalg.svd(np.concatenate([self.rows(k) for k in given], axis=1), full_matrices=False)
            basis = u[:, s > 1e-9 * s[0]]
        return self.y - basis @ (basis.T @ self.y), basis

    def tests(self, kinds: tuple[ChangeModel, ...], given: list[ChangeModel] | None = None) -> list[ChangeTest]:
        """The test of each kind given others; kinds that these poses cannot show beside those are left out."""
        rest, basis = self._rest(given or [])
        usual = np.sqrt(self.spread.total_weight(self.blocks) / len(self.y))  # by how much a movement counts
        out = []
        for kind in kinds:
            columns = self.rows(kind)
            length = np.linalg.norm(columns, axis=0)
            whole = usual * np.linalg.norm(kind.columns, axis=(0, 1))
            columns = np.where(length > _ROUNDING * whole, columns / np.maximum(length, 1e-300), 0.0)  # mm beside rad
            free = columns - basis @ (basis.T @ columns)
            u, s, _ = np.linalg.svd(free, full_matrices=False)
            seen = s > 1e-3
            if not seen.any() or any(kind.key == g.key for g in given or []):
                continue
            gain = float(np.sum((u[:, seen].T @ rest) ** 2))
            count = float(seen.sum())
            out.append(ChangeTest(kind, gain, f_sf(gain / count, count, self.base_freedom), u[:, seen]))
        return out

    def chance(self, tests: list[ChangeTest]) -> float:
        """Family-wise p-value of the most striking of these tests."""
        least = min((test.weighted for test in tests), default=1.0)
        bases, weights = [t.basis for t in tests], [weight(t.kind) for t in tests]
        return chance_of_least(bases, weights, least, self.base_freedom)

    def freedom(self, given: list[ChangeModel]) -> float:
        """Degrees of freedom that are left beside these changes."""
        return float(self.spread.rows - self._rest(given)[1].shape[1])

    def noise_ratio(self, given: list[ChangeModel]) -> float:
        """The new noise over the one that was expected."""
        rest, basis = self._rest(given)
        return float(np.sqrt(rest @ rest / max(self.spread.rows - basis.shape[1], 1)))

    def p_rest(self, given: list[ChangeModel]) -> float:
        """p-value of the residual left after fitting the given changes, under the noise that was expected."""
        free = self.freedom(given)
        return f_sf(self.noise_ratio(given) ** 2, free, self.base_freedom) if free >= 1.0 else 1.0

    @property
    def p_noise(self) -> float:
        """p-value of the residual under the noise that was expected, where nothing changed."""
        return self.p_rest([])

    def noise_explains(self, given: list[ChangeModel], kind: ChangeModel) -> bool:
        """Whether more noise explains what this kind would: by the noise that the new points themselves show."""
        if self.p_rest([*given, kind]) > ALARM:
            return False  # with it the noise is as it was
        test = next(t for t in self.tests((kind,), given=given))
        count = float(kind.count)
        free = max(self.freedom([*given, kind]), 1.0)
        own = f_sf(test.gain / count / self.noise_ratio([*given, kind]) ** 2, count, free)
        return own > NAMED_BESIDE

    def found(self, kind: ChangeModel, kinds: list[ChangeModel]) -> Change:
        """Size and sigma of one of several changes, fitted together."""
        columns = np.concatenate([self.rows(k) for k in kinds], axis=1)
        inverse = np.linalg.pinv(columns, rcond=1e-9)
        values, covariance = inverse @ self.y, inverse @ inverse.T
        start = sum(k.count for k in kinds[: kinds.index(kind)])
        own = slice(start, start + kind.count)
        vector, spread = values[own], covariance[own, own]
        size = float(vector[0]) if len(vector) == 1 else float(np.linalg.norm(vector))
        along = vector / max(float(np.linalg.norm(vector)), 1e-300)
        sigma = float(np.sqrt(along @ spread @ along))
        shown = tuple(float(v) for v in vector) if len(vector) > 1 else ()
        return Change(kind.what, kind.joint, kind.parameter, size, sigma, kind.unit, 1.0, (), shown)

    def detectable(self, kind: ChangeModel) -> Detectable:
        """The size that is found 19 times of 20, in the direction that shows least."""
        columns = self.rows(kind)
        whole = np.linalg.norm(kind.columns) / np.sqrt(len(kind.columns))
        s = np.linalg.svd(columns, compute_uv=False)
        if s[-1] < 1e-3 * max(float(s[0]), 1e-300) or s[0] < 1e-9:
            return Detectable(kind.what, kind.joint, kind.parameter, None, kind.unit, None)
        size = SEEN_Z / float(s[-1])
        moves = float(size * whole / np.sqrt(kind.count))
        return Detectable(kind.what, kind.joint, kind.parameter, float(size), kind.unit, moves)
