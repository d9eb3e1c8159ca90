"""Evidence for smooth error curves of joints in a residual: a Gaussian process, written as a sum of harmonics.

A member's curve is f(u) = sum over n of a_n sin(n phase) + b_n cos(n phase). Its coefficients are N(0, s_n^2) with a
size A of its own and a spectrum that all curves over joint angles share,

    s_n = A / sqrt(1 + (n / n0)^(2 p)),

which is flat up to the bandwidth n0 and falls as n^-p beyond it; curves over other inputs have n0 = 2, p = 2. With
whitened columns X, noise N(0, sigma^2) and sigma unknown,

    log E = -1/2 log det(1 + X S^2 X^T) - nu/2 log(r^T (1 + X S^2 X^T)^-1 r / r^T r),

the gain over "no curve" (Rasmussen and Williams 2006, eq 5.8, sigma maximised out). Its gradient by log s_k is
nu m_k^2 / quadratic - s_k^2 x_k^T (1 + X S^2 X^T)^-1 x_k, m the posterior mean over s: no more work than the value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dtrtri

from calib.array_types import Array, BoolArray, IndexArray

_STARTS = ((3.0, 2.0), (20.0, 2.5))  # bandwidth n0 and slope p
_FIRST_STEPS, _LAST_STEPS = 7, 20
_BANDWIDTHS = (0.7, 200.0)
_SLOPES = (0.6, 4.0)
_OTHER_BANDWIDTH, _OTHER_SLOPE = 2.0, 2.0
_SETTLED = 1e-5  # relative change of log E that ends the climb
_FAINT = 1e-5  # share of the noise that a harmonic moves: all of them together stay below 0.01 in log E
_LEAST_LOG_SIZE = -20.0  # of the usual size: it moves nothing
_MOST_LOG_SIZE = 4.6
_UNSEEN = 1e-200  # squared length of columns
_BLOCK_SIZES = np.geomspace(1e-3, 1e2, 26)


@dataclass(frozen=True)
class CurveColumns:
    """Columns of a linear model of the residual: the change by each harmonic of M error curves of joints."""

    columns: Array  # (R, K) whitened, projected; of a coefficient of 1 rad (1 mm for a prismatic joint)
    member: IndexArray  # (K,) from 0
    order: IndexArray  # (K,) n
    shares: BoolArray  # (K,) whether the spectrum is the one that all curves over angles share

    @staticmethod
    def of_one_size(columns: Array) -> CurveColumns:
        """Columns (R, K) of one curve whose coefficients have one size and no spectrum."""
        zero = np.zeros(columns.shape[1], dtype=np.int64)
        return CurveColumns(columns, zero, zero, zero.astype(bool))

    def joined(self, other: CurveColumns) -> CurveColumns:
        """The columns of these curves followed by the columns of other curves."""
        after = int(self.member.max()) + 1 if len(self.member) else 0
        return CurveColumns(
            np.concatenate([self.columns, other.columns], axis=1),
            np.concatenate([self.member, other.member + after]),
            np.concatenate([self.order, other.order]),
            np.concatenate([self.shares, other.shares]),
        )


@dataclass(frozen=True)
class Spectrum:
    """Hyperparameters of the curves, as logarithms: size of each curve, common bandwidth, and slope of the spectrum."""

    logs: Array  # (M + 2,)

    @staticmethod
    def with_size(before: Spectrum | None, log_size: float) -> Spectrum:
        """Spectrum with a further curve; `before`: without it, None where it is the first."""
        logs = np.log([20.0, 2.0]) if before is None else before.logs
        return Spectrum(np.concatenate([logs[:-2], [log_size], logs[-2:]]))


class CurveEvidence:
    """Log evidence of error curves in a residual as a function of the curves' sizes and spectrum."""

    def __init__(self, curve: CurveColumns, residual: Array, dof: int, *, before: CurveEvidence | None = None) -> None:
        """Take the `residual` (R,), measured minus predicted, whitened and projected, with `dof` degrees of freedom.

        before: evidence of the first of these curves, from which products are taken.
        """
        self.curve, self.residual, self.dof = curve, residual, dof
        self.total = float(residual @ residual)
        self.members = int(curve.member.max()) + 1 if len(curve.member) else 0
        x = curve.columns
        self.square = np.sum(x**2, axis=0)
        rows, count = map(float, x.shape)
        # Which of two equal ways is less work.
        few_rows = 2.0 * rows**2 * count + rows**3 / 3.0 < count**3
        self.few_rows: bool = few_rows if before is None else before.few_rows
        self.gram: Array | None = None if self.few_rows else _gram(x, None if before is None else before.gram)
        self.towards = x.T @ residual

    @property
    def usual_size(self) -> float:
        """Size, rad or mm, at which all curves together would be as large as the residual."""
        return float(np.sqrt(self.total / max(float(np.sum(self.square)), 1e-300)))

    def prior_sigma(self, spectrum: Spectrum) -> tuple[Array, Array]:
        """Prior sigmas (K,) of the harmonics' coefficients, and their relative orders (n / n0)^(2 p) (K,)."""
        n0 = np.where(self.curve.shares, np.exp(spectrum.logs[-2]), _OTHER_BANDWIDTH)
        p = np.where(self.curve.shares, np.exp(spectrum.logs[-1]), _OTHER_SLOPE)
        relative = (self.curve.order / n0) ** (2.0 * p)
        return np.exp(spectrum.logs[:-2])[self.curve.member] / np.sqrt(1.0 + relative), relative

    def at(self, spectrum: Spectrum) -> CurvePosterior:
        """Posterior of the curves for given sizes and spectrum."""
        return self._at_with_share(spectrum, wanted=False)[0]

    def _at_with_share(self, spectrum: Spectrum, *, wanted: bool) -> tuple[CurvePosterior, Array]:
        """Posterior of the curves and, if wanted, the share (K,) of each prior variance that the data remove."""
        sigma, _ = self.prior_sigma(spectrum)
        if self.few_rows:
            shaped = self.curve.columns * sigma
            factor = _factor(shaped @ shaped.T)
            mean = shaped.T @ cho_solve((factor, True), self.residual, check_finite=False)
            half_log_det = _sum_log_diagonal(factor)
            share = np.zeros(0)
            if wanted:
                share = np.sum(solve_triangular(factor, shaped, lower=True, check_finite=False) ** 2, axis=0)
        else:
            assert self.gram is not None
            share = sigma**2 * self.square
            # A harmonic that moves next to nothing is taken to first order.
            shown = np.flatnonzero(share >= min(_FAINT, float(share.max())))
            factor = _factor(sigma[shown, None] * self.gram[np.ix_(shown, shown)] * sigma[shown])
            found = cho_solve((factor, True), sigma[shown] * self.towards[shown], check_finite=False)
            mean = sigma * (self.towards - self.gram[:, shown] @ (sigma[shown] * found))
            mean[shown] = found
            half_log_det = _sum_log_diagonal(factor) + 0.5 * float(np.sum(np.delete(share, shown)))
            if wanted:
                inverse = dtrtri(factor, lower=1)[0]
                share[shown] = 1.0 - np.einsum("ij,ij->j", inverse, inverse)  # (L L^T)^-1 = L^-T L^-1
        quadratic = self.total - float(mean @ (sigma * self.towards))
        value = -0.5 * self.dof * float(np.log(max(quadratic, 1e-300) / max(self.total, 1e-300))) - half_log_det
        return CurvePosterior(value, sigma, mean, quadratic), share

    def best(self, starts: tuple[Spectrum, ...] = ()) -> tuple[float, Spectrum]:
        """Largest log evidence over all sizes and spectra, and the spectrum that attains it."""
        from scipy.optimize import Bounds, minimize  # takes a sixth of a second to load

        usual = np.log(self.usual_size)
        sizes = (usual + _LEAST_LOG_SIZE, usual + _MOST_LOG_SIZE)
        low, high = np.array([*[sizes] * self.members, np.log(_BANDWIDTHS), np.log(_SLOPES)]).T
        bounds = Bounds(low, high)

        def climb(start: Array, steps: int) -> tuple[float, Array]:
            found = minimize(
                self._falling, start, jac=True, method="L-BFGS-B", bounds=bounds,
                options={"maxiter": steps, "ftol": _SETTLED, "gtol": 1e-5},
            )  # fmt: skip
            return -float(found.fun), np.asarray(found.x)

        widest = max(int(self.curve.order.max()), 1)
        if len(starts) == 1:
            value, logs = climb(starts[0].logs, _FIRST_STEPS + _LAST_STEPS)
            return value, Spectrum(logs)
        tried = [climb(start.logs, _FIRST_STEPS) for start in starts]
        for bandwidth, slope in () if starts else _STARTS:
            size = usual + 0.5 * np.log(widest / min(bandwidth, widest))
            start = np.concatenate([np.full(self.members, size), np.log([bandwidth, slope])])
            tried.append(climb(start, _FIRST_STEPS))
        value, logs = climb(max(tried, key=lambda one: one[0])[1], _LAST_STEPS)
        return value, Spectrum(logs)

    def _falling(self, logs: Array) -> tuple[float, Array]:
        """Negative log evidence and its gradient by the logarithms of the spectrum, for a minimiser."""
        spectrum = Spectrum(logs)
        now, taken = self._at_with_share(spectrum, wanted=True)
        by_sigma = self.dof * now.mean**2 / now.quadratic - taken
        _, relative = self.prior_sigma(spectrum)
        share = np.where(self.curve.shares, by_sigma * relative / (1.0 + relative), 0.0)
        gradient = np.concatenate(
            [
                np.bincount(self.curve.member, by_sigma, minlength=self.members),
                [np.sum(share) * np.exp(logs[-1])],
                [-0.5 * np.sum(share * np.log(np.maximum(relative, 1e-300)))],
            ]
        )
        return -now.log_evidence, -gradient

    def gains(self, spectrum: Spectrum | None, blocks: Sequence[CurveColumns]) -> list[tuple[float, float]]:
        """Gain in log evidence by adding each of some further curves alone at its best size, and the log of that size.

        spectrum: of the curves before; None where there is none yet.
        """
        return self.gains_of(spectrum, self.further(blocks)) if blocks else []

    def further(self, blocks: Sequence[CurveColumns]) -> FurtherCurves:
        """Some further curves as `gains_of` takes them: products that stay the same whatever the spectrum."""
        shaped = [b.columns / np.sqrt(1.0 + (b.order / _OTHER_BANDWIDTH) ** (2.0 * _OTHER_SLOPE)) for b in blocks]
        stacked = np.concatenate([*shaped, self.residual[:, None]], axis=1)
        ends = tuple(np.cumsum([b.shape[1] for b in shaped]).tolist())
        return FurtherCurves(stacked, ends, None if self.few_rows else self.curve.columns.T @ stacked)

    def gains_of(self, spectrum: Spectrum | None, further: FurtherCurves) -> list[tuple[float, float]]:
        """Log evidence that each further curve adds, and the log of its best size, for curves prepared by `further`."""
        # B^T M^-1 B of each curve's columns B, M being 1 + X S^2 X^T, and of the residual.
        shown, less = self._whitened(spectrum, further)
        quadratic = float(shown[:, -1] @ shown[:, -1] - less[:, -1] @ less[:, -1])
        towards = shown.T @ shown[:, -1] - less.T @ less[:, -1]
        starts, widths = np.array([0, *further.ends[:-1]]), np.diff([0, *further.ends])
        out = [(0.0, 0.0)] * len(widths)
        for width in np.unique(widths):  # all curves of as many columns at once
            alike = np.flatnonzero(widths == width)
            own = starts[alike, None] + np.arange(width)  # (curves, width)
            inner = _squares(shown[:, own]) - _squares(less[:, own])
            square, turn = np.linalg.eigh(inner)
            along = np.einsum("gwv,gw->gv", turn, towards[own]) ** 2
            seen = np.sum(np.maximum(square, 0.0), axis=1)
            unit = np.sqrt(quadratic / np.where(seen > _UNSEEN, seen, quadratic))
            s2 = (unit[:, None] * _BLOCK_SIZES)[..., None] ** 2  # (curves, sizes, 1)
            grow = 1.0 + s2 * np.maximum(square, 0.0)[:, None]
            rest = quadratic - np.sum(along[:, None] * s2 / grow, axis=2)
            values = -0.5 * self.dof * np.log(rest / quadratic) - 0.5 * np.sum(np.log(grow), axis=2)
            best = np.argmax(values, axis=1)
            log_sizes = np.log(unit * _BLOCK_SIZES[best])
            for k, value, log_size in zip(alike, values.max(axis=1).tolist(), log_sizes.tolist(), strict=True):
                out[k] = (value, log_size)
        return out

    def _whitened(self, spectrum: Spectrum | None, further: FurtherCurves) -> tuple[Array, Array]:
        """Two matrices U (., L) and V (., L) with B^T (1 + X S^2 X^T)^-1 B = U^T U - V^T V for further columns B.

        By the smaller of two equal systems: of as many rows as the residual has, or as the curves have columns.
        """
        columns = further.columns
        if spectrum is None:
            return columns, np.zeros((0, columns.shape[1]))
        sigma, _ = self.prior_sigma(spectrum)
        if further.towards is None:
            shaped = self.curve.columns * sigma
            factor = _factor(shaped @ shaped.T)
            return solve_triangular(factor, columns, lower=True, check_finite=False), np.zeros((0, columns.shape[1]))
        assert self.gram is not None
        factor = _factor(sigma[:, None] * self.gram * sigma)
        return columns, solve_triangular(factor, sigma[:, None] * further.towards, lower=True, check_finite=False)

    def joined(self, block: CurveColumns) -> CurveEvidence:
        """Evidence of these curves with further ones."""
        return CurveEvidence(self.curve.joined(block), self.residual, self.dof, before=self)


def _gram(columns: Array, before: Array | None) -> Array:
    """Gram matrix (K, K) of columns (R, K), of the first of which it is known."""
    if before is None:
        return columns.T @ columns
    known = len(before)
    cross = columns.T @ columns[:, known:]
    return np.block([[before, cross[:known]], [cross[:known].T, cross[known:]]])


@dataclass(frozen=True)
class FurtherCurves:
    """Columns of further curves, shaped as their spectrum is, then the residual; with their products with the others'.

    Those of the k-th curve end at column `ends[k]`.
    """

    columns: Array  # (R, L)
    ends: tuple[int, ...]
    towards: Array | None  # (K, L) X^T columns; None where there are fewer rows than columns

    def beside(self, block: CurveColumns) -> FurtherCurves:
        """The same curves, to be added to evidence that `joined` a block."""
        if self.towards is None:
            return self
        return replace(self, towards=np.concatenate([self.towards, block.columns.T @ self.columns]))


@dataclass(frozen=True)
class CurvePosterior:
    """Posterior of error curves given a residual and a spectrum, in units of the remaining noise."""

    log_evidence: float
    prior_sigma: Array  # (K,) s, over the noise
    mean: Array  # (K,) posterior mean of each coefficient over its s
    quadratic: float  # r^T (1 + X S^2 X^T)^-1 r


def _squares(columns: Array) -> Array:
    """Gram matrices (G, W, W) of G sets of W columns (R, G, W)."""
    by_set = np.moveaxis(columns, 0, 1)
    return np.swapaxes(by_set, 1, 2) @ by_set


def _factor(inner: Array) -> Array:
    """Lower Cholesky factor of 1 + `inner` (K, K), which is overwritten."""
    inner[np.diag_indices_from(inner)] += 1.0
    return np.asarray(cholesky(inner, lower=True, overwrite_a=True, check_finite=False))


def _sum_log_diagonal(factor: Array) -> float:
    return float(np.sum(np.log(np.diag(factor))))
