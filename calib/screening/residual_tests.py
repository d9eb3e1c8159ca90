"""Tests of the residual of a fit: a systematic pattern over any input, outlying poses, and a size beyond the noise.

A residual that is noise has no pattern. For each input (a joint angle, a torque, the temperature, the place, any column
of poses.csv) smooth bumps over it are correlated with the residual's components; the largest response over all
inputs and widths is compared with that of simulated noise that went through the same fit (Westfall and Young 1993),
which corrects for the number of inputs and places.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from calib.array_types import Array, BoolArray
from calib.blas_threads import one_blas_thread
from calib.brief import Brief
from calib.calibration.noise_level import noise_of_repeats
from calib.dataset.dataset import Dataset
from calib.dataset.repeats import SIGMA_DOUBT
from calib.screening.projected_residual import ProjectedResidual
from calib.screening.scan_statistic import Channel, ScanStatistic, sum_by_pose
from calib.screening.smooth_motions import JointFault, smooth_motion
from calib.statistics import axis_sigma, chi2_sf, f_sf

DRAWS = 999
SETTLING_DRAWS = 15_999  # where the strongest pattern's p-value is near a level, which few draws leave to chance
_UNSETTLED_P = 0.05  # of 999 draws, up to which more draws may decide otherwise
STRUCTURE_LEVEL = 0.01
WEAK_LEVEL = 0.002  # p of the strongest pattern, from which on the residual's size has to speak too
NOISES_SIZE = 1.1  # residual over noise, up to which it is as large as noise is
OUTLIER_LEVEL = 0.002
_TOO_LARGE_P = 0.01
_BLIND = 1e-5  # mean response to noise over the largest one, below which the fit takes what a test would see
FAULT_EVIDENCE = 6.0  # log evidence from which a fault of one joint is reported
FAULT_EVIDENCE_ALONE = 3.0  # the same where no noise is known, so that the residual's size says nothing
_BLOCK = 3_000_000  # numbers of noise held at once


@dataclass(frozen=True)
class InputTest:
    """Test for a systematic pattern of the residual over one input; p-value corrected for all patterns searched.

    All patterns are all inputs, channels and widths.
    """

    input: str
    p_value: float
    channel: Channel  # where the pattern is strongest
    alone_p_value: float = 1.0  # corrected for the channels and widths of this input alone


@dataclass(frozen=True)
class ResidualTests(Brief):
    """Results of all tests of the residual of one fit."""

    lack_of_fit_p: float | None  # of the residual's size against the noise; None where no noise is known
    noise_mm: float  # sigma per coordinate with which the residual was compared
    noise_from: str  # "repeats", "dataset" or "fit"
    residual_mm: float  # sigma per coordinate of the residual
    inputs: tuple[InputTest, ...]  # the strongest pattern first
    outlier_poses: tuple[str, ...]
    fault: JointFault | None = None  # a motion of one joint that no effect of the catalogue describes
    # Log evidence that masses differ from robot.toml by what is allowed for:
    masses_evidence: float = field(default=0.0, metadata={"key": "masses_log_evidence"})

    @property
    def structured(self) -> tuple[str, ...]:
        """Inputs over which the residual has a systematic pattern beyond noise.

        Weak ones count only where the residual is larger than the noise, or no noise is known.
        """
        found = tuple(test for test in self.inputs if test.p_value < STRUCTURE_LEVEL)
        of_noises_size = self.noise_from != "fit" and self.residual_mm < NOISES_SIZE * self.noise_mm
        weak = bool(found) and found[0].p_value >= WEAK_LEVEL
        return () if weak and of_noises_size else tuple(test.input for test in found)

    @property
    def strongest_joint(self) -> int | None:
        """Joint, counted from 1, whose motion explains the residual best; None where no joint does."""
        joint = self.inputs[0].channel.joint if self.structured else None
        joint = joint if self.fault is None else self.fault.joint
        return None if joint is None else joint + 1

    @property
    def too_large(self) -> bool:
        """Whether the residual is larger than noise, a declared sigma being taken as accurate to 25 %."""
        return self.lack_of_fit_p is not None and self.lack_of_fit_p < _TOO_LARGE_P

    @property
    def is_noise(self) -> bool:
        """Whether the residual is noise, apart from outliers: no pattern, no error motion of a joint, no excess."""
        return not (self.fault or self.structured or self.too_large)


def asked_of_joints(tests: ResidualTests, joints: Collection[int]) -> ResidualTests:
    """The tests with patterns over the angles of some joints (from 0) corrected for these joints alone.

    An effect that was named on a joint and is not quite its cause leaves its pattern there, not anywhere.
    """
    names = {f"q{joint + 1}" for joint in joints}
    inputs = []
    for test in tests.inputs:
        of_these = len(names) * test.alone_p_value
        shows = test.input in names and of_these < min(STRUCTURE_LEVEL, test.p_value)
        inputs.append(replace(test, p_value=of_these) if shows else test)
    return replace(tests, inputs=tuple(sorted(inputs, key=lambda test: test.p_value)))


@one_blas_thread()
def run_residual_tests(dataset: Dataset, projected: ProjectedResidual, *, draws: int = DRAWS) -> ResidualTests:
    """All tests: outlying poses; patterns and faults without the outliers; then the size of the whole residual."""
    noise = _noise_again(projected, draws)
    outliers = _outliers(projected, noise)
    lack, noise_mm, source, residual_mm = _lack_of_fit(dataset, projected)
    poses, row = projected.residuals.observed.used_poses
    inputs = _structure(projected, outliers[row], noise)
    weak_counts = source == "fit" or residual_mm >= NOISES_SIZE * noise_mm
    surely_shown = 1.5 / (draws + 1) if weak_counts else 0.0  # above the least p-value: no draw was as large
    if inputs and surely_shown < inputs[0].p_value < _UNSETTLED_P:
        inputs = _structure(projected, outliers[row], lambda: _noise(projected, max(draws, SETTLING_DRAWS)))
    fault = smooth_motion(_without(projected, outliers[row]))
    least = FAULT_EVIDENCE_ALONE if source == "fit" else FAULT_EVIDENCE
    return ResidualTests(
        lack_of_fit_p=lack,
        noise_mm=noise_mm,
        noise_from=source,
        residual_mm=residual_mm,
        inputs=inputs,
        outlier_poses=tuple(poses.ids[i] for i in np.flatnonzero(outliers)),
        fault=fault if fault is not None and fault.log_evidence > least else None,
        masses_evidence=0.0 if projected.nuisance is None else projected.nuisance.log_evidence,
    )


def is_too_large(dataset: Dataset, projected: ProjectedResidual) -> bool:
    """Whether a residual is larger than noise, as `ResidualTests.too_large`, without the other tests."""
    lack = _lack_of_fit(dataset, projected)[0]
    return lack is not None and lack < _TOO_LARGE_P


def is_of_noises_size(dataset: Dataset, projected: ProjectedResidual) -> bool:
    """Whether a residual is as large as a known noise is."""
    _, noise_mm, source, residual_mm = _lack_of_fit(dataset, projected)
    return source != "fit" and residual_mm < NOISES_SIZE * noise_mm


def _noise(projected: ProjectedResidual, draws: int) -> Iterator[Array]:
    """Simulated noise (R, D), projected and scaled like the residual of the fit, in blocks of `draws` draws in total.

    The same data give the same noise and so the same verdict, in whatever order their points are listed.
    """
    rng, points = np.random.default_rng(0), projected.residuals.observed.points
    listed = np.lexsort((*points.xyz_mm.T, points.target, points.pose))
    drawn_row = np.empty(len(projected.residual), dtype=np.int64)  # of the noise, for each row of the residual
    drawn_row.reshape(len(listed), -1)[listed] = np.arange(len(drawn_row)).reshape(len(listed), -1)
    rows, size = len(projected.residual), float(np.linalg.norm(projected.residual))
    block = max(_BLOCK // rows, 1)
    for first in range(0, draws, block):
        noise = projected.project(rng.standard_normal((rows, min(block, draws - first)))[drawn_row])
        yield noise * (size / np.linalg.norm(noise, axis=0))


def _noise_again(projected: ProjectedResidual, draws: int) -> Callable[[], Iterable[Array]]:
    """Function that gives the same simulated noise on every call, stored if small, else drawn again."""
    if draws * len(projected.residual) > _BLOCK:
        return lambda: _noise(projected, draws)
    kept = list(_noise(projected, draws))
    return lambda: kept


def _without(projected: ProjectedResidual, outlier: BoolArray) -> ProjectedResidual:
    """Projected residual set to zero at outlying points (M,), so that one wrong pose is not taken for a pattern."""
    residual = projected.residual.copy()
    residual[np.repeat(outlier, projected.coordinates)] = 0.0
    return replace(projected, residual=residual)


def _outliers(projected: ProjectedResidual, noise: Callable[[], Iterable[Array]]) -> BoolArray:
    """Mask (N,) of poses whose residual exceeds the largest one expected in a whole dataset of noise."""
    of_pose, rng = sum_by_pose(projected), np.random.default_rng(1)
    numbers = float(projected.coordinates) * np.asarray(of_pose.sum(axis=1))  # (N, 1) coordinates at each pose

    def mean_square(values: Array) -> Array:
        of_points = values.reshape(of_pose.shape[1], projected.coordinates, -1)
        return of_pose @ np.sum(of_points**2, axis=1) / numbers

    residual, draws = projected.residual, noise()
    if projected.whitening is not None:
        residual = projected.whitening.unweighted(residual)
        draws = (projected.whitening.with_tails(block, rng) for block in draws)
    ours = mean_square(residual)[:, 0]
    largest = [np.max(theirs / _median(theirs), axis=0) for theirs in map(mean_square, draws)]
    # A large outlier swells the common scale, so each is compared with the median of its own dataset.
    limit = np.quantile(np.concatenate(largest), 1.0 - OUTLIER_LEVEL)
    return ours / _median(ours) > limit


def _median(values: Array) -> Array:
    """Median along the first axis, at least slightly above zero, as over half of exact data's values may be zero."""
    return np.maximum(np.median(values, axis=0), np.maximum(1e-12 * np.max(values, axis=0), 1e-300))


def _structure(
    projected: ProjectedResidual, outlier: BoolArray, noise: Callable[[], Iterable[Array]]
) -> tuple[InputTest, ...]:
    """Test of each input with its Westfall-Young corrected p-value, the strongest pattern first."""
    statistic = ScanStatistic.at(projected, outlier)
    ours = statistic.scores(projected.residual[:, None])
    blocks = [statistic.scores(block) for block in noise()]
    most = max(float(scores.mean(axis=1).max()) for scores in blocks[0].values())
    standard, where = {}, {}
    for name, channels in statistic.channels_of.items():
        theirs = np.concatenate([scores[name] for scores in blocks], axis=1)
        mean, spread = theirs.mean(axis=1, keepdims=True), theirs.std(axis=1, keepdims=True)
        spread = np.where(mean > _BLIND * most, np.maximum(spread, 1e-300), np.inf)
        score = (np.column_stack([ours[name], theirs]) - mean) / spread
        standard[name] = np.max(score, axis=0)
        where[name] = channels[int(np.argmax(score[:, 0])) // (len(score) // len(channels))]
    largest = np.max(np.stack([s[1:] for s in standard.values()]), axis=0)
    tests = [
        InputTest(name, _share_above(largest, score[0]), where[name], _share_above(score[1:], score[0]))
        for name, score in standard.items()
    ]
    order = sorted(range(len(tests)), key=lambda i: -list(standard.values())[i][0])
    return tuple(tests[i] for i in order)


def _share_above(values: Array, least: float) -> float:
    """Share of simulated values at or above one, which counts among them: a p-value that is never zero."""
    return float((1 + np.sum(values >= least)) / (len(values) + 1))


def _lack_of_fit(dataset: Dataset, projected: ProjectedResidual) -> tuple[float | None, float, str, float]:
    """p-value of the residual's size, the noise sigma it is compared with, its source, and the residual sigma; mm."""
    observed = projected.residuals.observed
    declared_mm = axis_sigma(observed.covariance_mm2)
    residual_mm = projected.sigma * declared_mm
    square = float(projected.residual @ projected.residual)
    repeats = noise_of_repeats(dataset)
    noise_mm, dof = repeats or (0.0, 0)
    counts_as = observed.points.counts_as
    if repeats is not None and counts_as is not None:
        # Points are means of repeats, whose scatter is no part of the residual.
        single = observed.covariance_mm2 * counts_as[:, None, None]
        single_mm = axis_sigma(single)
        ratio = square / projected.dof / (noise_mm / single_mm) ** 2
        mean_noise_mm = noise_mm * declared_mm / single_mm
        return f_sf(ratio, projected.dof, dof), mean_noise_mm, "repeats", residual_mm
    if repeats is not None:
        # Repeats are part of the residual; what exceeds them is compared with them.
        pure = dof * (noise_mm / declared_mm) ** 2
        rest = projected.dof - dof
        if rest > 0:
            ratio = max(square - pure, 0.0) / rest / (noise_mm / declared_mm) ** 2
            return f_sf(ratio, rest, dof), noise_mm, "repeats", residual_mm
    if dataset.declares_noise:
        doubted = square / SIGMA_DOUBT**2
        return chi2_sf(doubted, projected.dof), declared_mm, "dataset", residual_mm
    return None, residual_mm, "fit", residual_mm
