"""Generalised least squares of changes of a cell against new residuals whose covariance is known.

The usual changes have most of the alarm rate: each p-value is divided by the weight of the change before the least is
taken (weighted Bonferroni: Genovese, Roeder, Wasserman 2006). Changes overlap, so that fewer unchanged cells alarm than
the bound says; draws of unchanged cells would find changes that are 0.05 (a series: 0.1) sigma smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.extras.watch.change_models import LARGEST_BY_UNIT, USUAL, Change, ChangeModel, change_label
from calib.extras.watch.spread import Spread
from calib.statistics import f_sf

ALARM = 0.005  # p-value over all changes, below which something changed
NOISIER = 0.0005  # p-value below which the noise is larger than before
NAMED = 0.003  # p-value over all changes of the arm, scanner free, of a change that explains everything alone
NAMED_GIVEN_OTHERS = 0.0003  # the same for a change of the arm that does not
ALONE = 0.05  # p-value of the scanner's motion given a change of the arm, from which on that explains everything alone
CONFOUNDED = 6.0  # chi squared by which another change may explain less than the best and be confounded with it
UNUSUAL_WEIGHT = 0.05  # weight of a length, an angle, a compliance: parts wear and slip more often than they bend
_ROUNDING = 1e-6  # share of a movement below which the residuals do not show it
PER_PARAMETER = 2.5  # chi squared that each parameter of a change has to explain
DETECTABLE_Z = 3.8 + 1.645  # sigmas of a size that passes NAMED 19 times of 20


@dataclass(frozen=True)
class Detectable:
    """Least size of one change of a cell that is detected 19 times of 20."""

    what: str
    joint: int | None
    parameter: str
    size: float | None  # None: these poses never show the change
    unit: str
    moves_mm: float | None  # RMS motion of the points by a change of that size


@dataclass(frozen=True)
class ChangeTest:
    """F test of one possible change of a cell against the new residuals."""

    model: ChangeModel
    gain: float  # chi squared that the change explains
    p_value: float

    @property
    def score(self) -> float:
        """Twice the log odds of the change against no change, up to a constant; each onset of a step is as likely."""
        odds = float(np.log(weight(self.model) / self.model.places))
        return self.gain - PER_PARAMETER * self.model.count + 2.0 * odds


def most_likely(tests: Sequence[ChangeTest]) -> ChangeTest | None:
    """Test with the highest score: most explained for its number of parameters, with usual changes preferred."""
    return max(tests, key=lambda test: test.score, default=None)


def confounded_with(tests: Sequence[ChangeTest], best: ChangeTest) -> tuple[str, ...]:
    """Labels of changes that explain about as much as the best one with no more parameters."""
    return tuple(
        change_label(*t.model.key)
        for t in tests
        if t is not best
        and (fewer := best.model.count - t.model.count) >= 0
        and t.gain > best.gain - CONFOUNDED - PER_PARAMETER * fewer
        and t.p_value < ALARM
    )


@dataclass(frozen=True)
class ChangeTests:
    """Tests of changes of a cell, by whitened new residuals and their derivatives by motions of the points."""

    y: Array  # (3 M,) whitened residual, zero in the blind directions of `spread`
    spread: Spread
    blocks: Array  # (M, 3, 3) from movements in the base frame, mm, to the residuals before they are whitened
    noise_dof: float  # degrees of freedom of the noise, from the earlier fit
    tails: float = 1.0  # variance of squared errors over that of normal ones

    def rows(self, model: ChangeModel) -> Array:
        """Derivatives (3 M, K) of the whitened residuals by a change's parameters."""
        moved = np.einsum("mij,mjk->mik", self.blocks, model.columns)
        return self.spread.whiten(moved.reshape(len(self.y), -1))

    def _residual_given(self, given: Sequence[ChangeModel]) -> tuple[Array, Array]:
        """Residual (3 M,) left after fitting the given changes, and an orthonormal basis (3 M, K) of these."""
        basis = np.zeros((len(self.y), 0))
        if given:
            u, s, _ = np.linalg.svd(np.concatenate([self.rows(k) for k in given], axis=1), full_matrices=False)
            basis = u[:, s > 1e-9 * s[0]]
        return self.y - basis @ (basis.T @ self.y), basis

    def tests(self, models: Sequence[ChangeModel], given: Sequence[ChangeModel] = ()) -> list[ChangeTest]:
        """Test of each possible change, given other changes; changes that these poses do not show are omitted."""
        residual, basis = self._residual_given(given)
        usual = np.sqrt(self.spread.total_weight(self.blocks) / len(self.y))  # weight of a typical movement
        tests = []
        for model in models:
            columns = self.rows(model)
            length = np.linalg.norm(columns, axis=0)
            whole = usual * np.linalg.norm(model.columns, axis=(0, 1))
            # To unit length, as mm and rad are many powers of ten apart.
            columns = np.where(length > _ROUNDING * whole, columns / np.maximum(length, 1e-300), 0.0)
            free = columns - basis @ (basis.T @ columns)
            u, s, _ = np.linalg.svd(free, full_matrices=False)
            shown = s > 1e-3
            if not shown.any() or any(model.key == g.key for g in given):
                continue
            gain = float(np.sum((u[:, shown].T @ residual) ** 2))
            count = float(shown.sum())
            tests.append(ChangeTest(model, gain, f_sf(gain / count, count, self.noise_dof)))
        return tests

    def dof(self, given: Sequence[ChangeModel]) -> float:
        """Degrees of freedom of the residual left after fitting the given changes."""
        return float(self.spread.rows - self._residual_given(given)[1].shape[1])

    def noise_ratio(self, given: Sequence[ChangeModel]) -> float:
        """Ratio of the noise left after fitting the given changes to the expected noise."""
        residual, basis = self._residual_given(given)
        return float(np.sqrt(residual @ residual / max(self.spread.rows - basis.shape[1], 1)))

    def p_rest(self, given: Sequence[ChangeModel]) -> float:
        """p-value of the residual left after fitting the given changes, under the expected noise."""
        dof = self.dof(given)
        return f_sf(self.noise_ratio(given) ** 2, dof / self.tails, self.noise_dof) if dof >= 1.0 else 1.0

    def noise_explains(self, given: Sequence[ChangeModel], model: ChangeModel) -> bool:
        """Whether a change is insignificant against the noise of the new points, given other changes."""
        if self.p_rest([*given, model]) > ALARM:
            return False  # with the change the noise is as before
        (test,), count = self.tests([model], given), float(model.count)
        dof = max(self.dof([*given, model]), 1.0)
        p_value = f_sf(test.gain / count / self.noise_ratio([*given, model]) ** 2, count, dof)
        return p_value > NAMED_GIVEN_OTHERS

    def estimate(self, model: ChangeModel, models: Sequence[ChangeModel]) -> Change:
        """Size and sigma of one of several changes of a cell that are fitted together."""
        columns = np.concatenate([self.rows(k) for k in models], axis=1)
        inverse = np.linalg.pinv(columns, rcond=1e-9)
        values, covariance = inverse @ self.y, inverse @ inverse.T
        start = sum(k.count for k in models[: models.index(model)])
        own = slice(start, start + model.count)
        vector, own_covariance = values[own], covariance[own, own]
        size = float(np.linalg.norm(vector)) if len(vector) > 1 else float(vector[0])
        along = vector / max(float(np.linalg.norm(vector)), 1e-300)
        sigma = float(np.sqrt(along @ own_covariance @ along))
        components = tuple(float(v) for v in vector) if len(vector) > 1 else ()
        return Change(*model.key, size, sigma, model.unit, 1.0, (), components)

    def detectable(self, model: ChangeModel) -> Detectable:
        """Least size of a change that is detected 19 times of 20, in its least visible direction."""
        columns = self.rows(model)
        whole = np.linalg.norm(model.columns) / np.sqrt(len(model.columns))
        s = np.linalg.svd(columns, compute_uv=False)
        size = DETECTABLE_Z / max(float(s[-1]), 1e-300)
        if s[-1] < 1e-3 * s[0] or s[0] < 1e-9 or size > LARGEST_BY_UNIT[model.unit]:
            return Detectable(*model.key, None, model.unit, None)
        return Detectable(*model.key, size, model.unit, float(size * whole / np.sqrt(model.count)))


def weight(model: ChangeModel) -> float:
    """Prior weight of a change's p-value: 1 for usual changes, less for others."""
    return 1.0 if model.what in USUAL else UNUSUAL_WEIGHT


def family_wise_p_value(tests: Sequence[ChangeTest]) -> float:
    """Bound of the probability, if nothing changed, of a test as significant as the most significant of several."""
    least = min((test.p_value / weight(test.model) for test in tests), default=1.0)
    return min(1.0, least * sum(weight(test.model) for test in tests))
