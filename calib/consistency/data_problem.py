"""Test for mistakes in the data or in the robot's table, before any physical effect is considered.

A joint of opposite sign, columns or rows in another order, another unit, the table of another robot type: each is a
hypothesis with as many parameters as the fit has, so the fits are compared by their log evidence alone. The misfit of
the nominal arm, in closed form, selects the hypotheses that are worth a fit. A hypothesis is accepted at once where the
residual of the data as they are is beyond all physical effects and that of the hypothesis a small part of it. A smaller
residual may have either cause: a last joint of opposite sign whose tool is near its axis moves the points as a wobble
of that axis does. Such a hypothesis stays open until effects were searched for, and is accepted where it makes one of
them superfluous.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.calibration.evaluation import Evaluation
from calib.calibration.result import Calibration
from calib.consistency.agreement import Sample, misfit_mm, points_of_poses, training_sample
from calib.consistency.hypotheses import (
    JOINT_SIGN,
    ROBOT_TABLE,
    ROW_ORDER,
    DataHypothesis,
    column_names,
    of_matching,
    of_mirroring,
    of_other_lengths,
    of_reading,
    of_shifts,
    of_sister_tables,
    of_units,
    simplest_of,
)
from calib.consistency.joint_convention import likely_conventions
from calib.consistency.joint_reading import simple_readings
from calib.consistency.row_matching import matched_rows
from calib.dataset.dataset import Dataset
from calib.errors import CalibError
from calib.kinematics.chain import target_points
from calib.kinematics.robot import Robot
from calib.statistics import rms_length

QUIET = 1.15  # residual sigma over the declared one, up to which no mistake is looked for
BEYOND_EFFECTS = 0.003  # 3D error over the arm's length, above which no physical effect explains it
MIN_GAIN = 20.0  # log Bayes factor over the data as they are
LEAST_FACTOR = 3.0  # by which the residual has to fall
REACHES_NOISE = 1.3  # residual sigma over the declared one
MIN_TABLE_GAIN = 50.0  # the same for a table, whose residual is no smaller where the fit has changed links into it
_BENT = 6.0  # tolerances: a link that a fit has changed by more may be of another robot type
_NOT_WORSE = 1.2  # times the misfit of the nominal arm, up to which a hypothesis is fitted
_BETTER = 0.8  # the same for one that changes several things
_OFF_SCALE = 2.0  # by which the points' spread and the nominal arm's differ only where units are wrong
_MOST_TURNED = 2  # joints whose sign may look like an effect
_MOST_FITS = 14
_NEAR_ENOUGH = 1.5  # times the residual of the data as they are, up to which another sign of a joint stays open
_HOPELESS = 2.0  # of places alone over `_NEAR_ENOUGH`: errors that all points share are no unknowns of theirs
_LEAST_DOF = 4.0  # degrees of freedom at least
MIN_LEAD = 4.0  # log evidence over the effects that were found, where it makes one of them superfluous
CHOICE = 4.4  # log of what an effect may be chosen from, some thirty families of a scale that is fitted to the data
NOT_NOISIER = 1.1  # times the noise that those effects leave, which it may leave without that one
_ONE_PLACE_MM = 1e-6  # spread of points that are one: rounding of their mean
_LENGTH_COST = 10.0  # log of a range of half a metre over some ten micrometres
_SLACK = 0.03  # share of the most log evidence that a simpler hypothesis may lack
_AS_GOOD = 3.0  # log evidence by which another hypothesis may be behind and still be as good

Refit = Callable[[Dataset], Calibration]


@dataclass(frozen=True)
class DataProblem:
    """A mistake in the data or the table, with the errors before and after its correction."""

    hypothesis: DataHypothesis
    mended: Dataset
    now_mm: float  # 3D RMSE of all points by the fit; of units and tables by the arm as delivered
    then_mm: float
    gain: float  # log Bayes factor
    rivals: tuple[DataHypothesis, ...] = ()  # as simple and as good
    effects: tuple[str, ...] = ()  # in both fits
    instead_of: str = ""  # the effect that would explain the residual where the data are right

    @property
    def kind(self) -> str:
        """Kind of mistake: joint_sign, joint_order, joint_zero, joint_sum, units, robot_table or row_order."""
        return self.hypothesis.kind

    @property
    def joints(self) -> tuple[int, ...]:
        """Numbers, from 1, of the joints at fault."""
        return self.hypothesis.joints

    @property
    def remedy(self) -> str:
        """Remedy for a mistake in the data or the table, as a clause."""
        others = "".join(f", or {rival.remedy}" for rival in self.rivals[:2])
        return f"{self.hypothesis.remedy}{others}"

    @property
    def mistake(self) -> str:
        """Mistake in the data or the table, as a clause."""
        others = "".join(f", or {rival.mistake}" for rival in self.rivals[:2])
        return f"{self.hypothesis.mistake}{others}{': these poses do not tell which' if self.rivals else ''}"

    @property
    def warning(self) -> str:
        """Warning with the mistake, the errors before and after its correction, and the remedy.

        A text of the data, like those of `Dataset.warnings`: an import says it before there is any result.
        """
        effects = f" with {' and '.join(self.effects)} in the model" if self.effects else ""
        instead = f" (as the data stand, only {self.instead_of} brings that)" if self.instead_of else ""
        return (
            f"{self.mistake}: {self.hypothesis.change} the error falls from {self.now_mm:.3g} to {self.then_mm:.3g} mm"
            f"{effects}{instead}; {self.remedy}"
        )


@dataclass(frozen=True)
class Suspicions:
    """Suspected mistakes in the data: an accepted one, or open hypotheses that an effect may explain as well."""

    problem: DataProblem | None
    open: tuple[DataHypothesis, ...] = ()
    likeliest: DataProblem | None = None  # open hypothesis that is clearly more probable than the data as they are


def is_quiet(now: Calibration) -> bool:
    """Whether the residual is no larger than the declared noise and no link parameter is implausible."""
    return now.dataset.declares_noise and now.fit.reduced_chi < QUIET and not _is_bent(now)


def suspicions(now: Calibration, refit: Refit, names: Sequence[str] = (), by_places: Refit | None = None) -> Suspicions:
    """Suspected mistakes in the data, judged by refits of the geometry to corrected data.

    now: the fit of the links and of the effects taken as present.
    refit: makes the same fit of another dataset.
    names: (n,) the user's names of the joints' columns; those of poses.csv where empty.
    by_places: makes a quicker fit of the places alone, where `refit` fits full poses: what leaves much more than the
        data as they are there does so with attitudes too, and is not fitted.
    """
    dataset = now.dataset
    if dataset.points is None or dataset.points.lengths is not None:  # lengths alone tell too little of it
        return Suspicions(None)
    sample = training_sample(dataset)
    if sample is not None and _is_off_scale(dataset.robot, sample):
        found = _units_problem(now, refit, sample)
        if found is not None:
            return Suspicions(found)
    of_one_place = sample is not None and not sample.spread_mm > _ONE_PLACE_MM
    if is_quiet(now) or not _is_judged(now) or of_one_place:
        return Suspicions(None)
    tried = _FittedHypotheses(now, refit, by_places)
    names = names or column_names(dataset.robot)
    simple = tuple(of_reading(r, names) for r in simple_readings(dataset.robot.is_revolute))
    if sample is None:
        tried.fit_all([h for h in simple if h.edits == 1])
        return tried.judged()
    as_it_is = misfit_mm(dataset.robot, sample)
    if not tried.beyond_effects:
        turned = [h for h in simple if _turns_joints(h) and h.edits <= _MOST_TURNED]
        tried.fit_all(_worth_a_fit(dataset, sample, as_it_is, turned))
        if _is_bent(now):
            tried.fit_all(_worth_a_fit(dataset, sample, as_it_is, of_sister_tables(dataset.robot)))
        return tried.judged()
    units, tables = of_units(dataset.robot, sample), of_sister_tables(dataset.robot)
    tried.fit_all(_worth_a_fit(dataset, sample, as_it_is, [*simple, *units, of_mirroring()]))
    tried.fit_all(_worth_a_fit(dataset, sample, as_it_is, tables))
    tried.fit_all(_worth_a_fit(dataset, sample, as_it_is, of_shifts(dataset)))
    if tried.judged().problem is None and len(sample.groups) == 1:
        likely = likely_conventions(dataset.robot, sample.q, sample.points_mm)
        tried.fit_all(of_reading(reading, names, dataset.robot.is_revolute) for reading in likely)
    if tried.judged().problem is None:
        tried.fit_all(of_other_lengths(dataset.robot, sample))
    if tried.judged().problem is None:
        tried.fit_all(_by_matching(dataset))
    return tried.judged()


def _is_off_scale(robot: Robot, sample: Sample) -> bool:
    """Whether the measured points spread so differently from the nominal arm's that only a wrong unit explains it."""
    mine = replace(sample, points_mm=target_points(robot, sample.q)).spread_mm
    return mine > 0.0 and sample.spread_mm > 0.0 and abs(np.log(sample.spread_mm / mine)) > np.log(_OFF_SCALE)


def _units_problem(now: Calibration, refit: Refit, sample: Sample) -> DataProblem | None:
    """Mistake in units, where other units give the error of an arm with unchanged links; else None.

    The residual with the present units is not compared: with links of length zero a fit may reduce it to nothing.
    """
    best: DataProblem | None = None
    for hypothesis in of_units(now.dataset.robot, sample):
        try:
            fit = refit(hypothesis.of_dataset(now.dataset))
        except (CalibError, np.linalg.LinAlgError):  # such data cannot be fitted at all
            continue
        train = fit.after.train
        if train is None or is_beyond_effects(train.rmse_mm, now.dataset.robot) or _is_bent(fit):
            continue
        problem = DataProblem(hypothesis, fit.dataset, error_mm(now.before), error_mm(fit.after), np.inf)
        if best is None or problem.then_mm < best.then_mm:
            best = problem
    return best


@dataclass(frozen=True)
class FitVariant:
    """A model with effects, to be fitted to the data both as measured and as corrected under a hypothesis."""

    effects: tuple[str, ...]  # in the model
    without: str  # found effect that is left out of the model; "" for none
    fit: Callable[[Dataset], Calibration]


def problem_given_effects(
    now: Calibration, open_hypotheses: Sequence[DataHypothesis], models: Sequence[FitVariant]
) -> DataProblem | None:
    """Data mistake that is clearly more probable than the effects found without it; None where there is none.

    It makes one of the effects superfluous, or removes most of their residual.

    now: the last fit, with its effects.
    """
    if not _is_judged(now):
        return None
    best: DataProblem | None = None
    for hypothesis in open_hypotheses:
        mended = hypothesis.of_dataset(now.dataset)
        for model in models:
            least, most_noise = MIN_LEAD, NOT_NOISIER * now.fit.reduced_chi
            if not model.without:
                reached = REACHES_NOISE if now.dataset.declares_noise else 0.0
                least, most_noise = (
                    MIN_GAIN,
                    max(now.fit.reduced_chi / LEAST_FACTOR, min(reached, 0.9 * now.fit.reduced_chi)),
                )
            try:
                fit = model.fit(mended)
            except (CalibError, np.linalg.LinAlgError):  # such data cannot be fitted at all
                continue
            if not _is_judged(fit) or fit.fit.reduced_chi > most_noise:
                continue
            gain = log_evidence(fit) - log_evidence(now) + (CHOICE if model.without else 0.0)
            if gain > least and (best is None or gain > best.gain):
                as_it_is = error_mm(model.fit(now.dataset).after)
                best = DataProblem(
                    hypothesis, mended, as_it_is, error_mm(fit.after), gain, (), model.effects, model.without
                )
    return best


def log_evidence(fitted: Calibration) -> float:
    """Log evidence of a fit by Laplace's approximation at its residual noise, up to a constant of the data.

    -n log s - (|r|^2 / s^2 + |z|^2) / 2 + log det(C / C_prior) / 2 with n rows beyond the frames, the residual r in
    declared sigmas, s its sigma, z the parameters in tolerances and C their covariance.
    """
    fit = fitted.fit
    scales = fitted.model.scales
    z = fit.x / scales
    cost = fit.iterations[-1].cost
    dof = fit.degrees_of_freedom
    count = dof + _determined(fitted)
    scaled = fit.covariance / np.outer(scales, scales)
    volume = 0.5 * float(np.linalg.slogdet(scaled)[1]) if fitted.options.prior else 0.0
    penalty = float(z @ z) if fitted.options.prior else 0.0
    return -count * float(np.log(fit.reduced_chi)) - 0.5 * (cost / fit.reduced_chi**2 + penalty) + volume


def _determined(fitted: Calibration) -> float:
    """Effective number of parameters that the data determine."""
    scaled = np.diag(fitted.fit.covariance) / fitted.model.scales**2
    return float(np.sum(1.0 - np.minimum(scaled, 1.0))) if fitted.options.prior else float(fitted.fit.rank)


def is_beyond_effects(error_mm: float, robot: Robot) -> bool:
    """Whether a 3D error, relative to the length of links and slides, is larger than physical effects explain."""
    slides = [abs((joint.max or 0.0) - (joint.min or 0.0)) for joint in robot.joints if not joint.is_revolute]
    return error_mm > BEYOND_EFFECTS * float(np.sum(np.abs(robot.table[:, [0, 2]])) + sum(slides))


def error_mm(errors: Evaluation) -> float:
    """3D RMSE of all measured points, mm; mistakes may be in training or in test poses."""
    return rms_length(errors.error_mm)


def _is_judged(fitted: Calibration) -> bool:
    return bool(
        np.isfinite(fitted.fit.reduced_chi)
        and fitted.fit.reduced_chi > 0.0
        and fitted.fit.degrees_of_freedom > _LEAST_DOF
    )


def _is_bent(now: Calibration) -> bool:
    """Whether a fit changed a link parameter (tool excluded) far beyond manufacturing tolerances."""
    z = np.abs(now.fit.x / now.model.scales)
    names = [p.name for p in now.fit.parameters]
    own = np.array([name in now.model.geometry_names and not name.endswith("TCP") for name in names], dtype=bool)
    return bool(own.any() and z[own].max() > _BENT)


def _worth_a_fit(
    dataset: Dataset, sample: Sample, as_it_is_mm: float, hypotheses: Iterable[DataHypothesis]
) -> list[DataHypothesis]:
    """Best and simplest hypotheses on mistakes, among those that hardly raise the nominal arm's misfit."""
    found: list[tuple[float, DataHypothesis]] = []
    for hypothesis in hypotheses:
        robot, of_it = hypothesis.robot or dataset.robot, hypothesis.of_sample(sample, dataset.robot)
        if hypothesis.rows:
            seen = training_sample(hypothesis.of_dataset(dataset))
            if seen is None:
                continue
            of_it = seen
        misfit = misfit_mm(robot, of_it) / of_it.spread_mm
        most = _NOT_WORSE if hypothesis.edits == 1 else _BETTER
        if misfit < most * as_it_is_mm / sample.spread_mm:
            found.append((misfit, hypothesis))
    found.sort(key=lambda pair: pair[0])
    likely = found[: 2 * _MOST_FITS]
    likely.sort(key=lambda pair: (pair[1].edits, pair[0]))
    chosen = [hypothesis for _, hypothesis in likely[:_MOST_FITS]]
    best = [hypothesis for _, hypothesis in found[:2] if hypothesis not in chosen]
    return [*best, *chosen]


def _by_matching(dataset: Dataset) -> list[DataHypothesis]:
    """Hypotheses on the order of rows, by matching points to rows, for points measured from one station."""
    poses, points_mm = points_of_poses(dataset)
    if len(set(dataset.poses.setup[poses].tolist())) != 1:
        return []
    source = matched_rows(target_points(dataset.robot, dataset.poses.q[poses]), points_mm)
    if source is None or np.array_equal(source, np.arange(len(source))):
        return []
    return [of_matching(dataset, poses, poses[source])]


class _FittedHypotheses:
    """Fits of hypotheses on mistakes, compared with the fit of the unchanged data."""

    def __init__(self, now: Calibration, refit: Refit, by_places: Refit | None = None) -> None:
        self.now, self.refit, self.by_places = now, refit, by_places
        self.evidence = log_evidence(now)
        train = now.after.train
        self.beyond_effects = train is not None and is_beyond_effects(train.rmse_mm, now.dataset.robot)
        self.fits: dict[DataHypothesis, Calibration] = {}

    def fit_all(self, hypotheses: Iterable[DataHypothesis]) -> None:
        for hypothesis in hypotheses:
            try:
                mended = hypothesis.of_dataset(self.now.dataset)
                if self._is_hopeless(mended):
                    continue
                fitted = self.refit(mended)
            except (CalibError, np.linalg.LinAlgError):  # such data cannot be fitted at all
                continue
            if _is_judged(fitted):
                self.fits[hypothesis] = fitted

    def _is_hopeless(self, mended: Dataset) -> bool:
        """Whether the places alone leave so much that full poses cannot come near what the data as they are leave.

        The squared residual of places is part of that of full poses, so that it bounds it from below.
        """
        if self.by_places is None:
            return False
        least = self.by_places(mended).fit.iterations[-1].cost / self.now.fit.degrees_of_freedom
        return bool(np.sqrt(least) > _HOPELESS * _NEAR_ENOUGH * self.now.fit.reduced_chi)

    def judged(self) -> Suspicions:
        """Accepted mistake with equally good alternatives, else the hypotheses that remain open."""
        believed = [h for h in self.fits if self._is_believed(h)]
        if not believed:
            return self._undecided()
        most = max(map(self._gain, believed))
        enough = [h for h in believed if self._gain(h) > most - max(_AS_GOOD, _SLACK * most)]
        good = sorted(simplest_of(enough), key=self._gain, reverse=True)
        best = good[0]
        as_good = tuple(h for h in good[1:] if self._gain(h) > self._gain(best) - _AS_GOOD)
        return Suspicions(self._problem(best, as_good))

    def _undecided(self) -> Suspicions:
        """Hypotheses still open where none is accepted, with the likeliest fault of the data if it is evident."""
        still_open = tuple(h for h in self.fits if self._is_open(h))
        best = max(still_open, key=self._gain, default=None)
        if best is None or self._gain(best) <= MIN_GAIN:
            return Suspicions(None, still_open)
        return Suspicions(None, still_open, self._problem(best))

    def _problem(self, hypothesis: DataHypothesis, rivals: tuple[DataHypothesis, ...] = ()) -> DataProblem:
        fits = (self.now, self.fits[hypothesis])
        now_mm, then_mm = (error_mm(f.before if hypothesis.kind == ROBOT_TABLE else f.after) for f in fits)
        mended = hypothesis.of_dataset(self.now.dataset)
        return DataProblem(hypothesis, mended, now_mm, then_mm, self._gain(hypothesis), rivals)

    def _gain(self, hypothesis: DataHypothesis) -> float:
        fitted = self.fits[hypothesis]
        # Of fewer points each counts as much as one of all.
        share = self.now.fit.rows / fitted.fit.rows
        return share * log_evidence(fitted) - self.evidence - _cost(hypothesis)

    def _is_believed(self, hypothesis: DataHypothesis) -> bool:
        now, then = self.now.fit.reduced_chi, self.fits[hypothesis].fit.reduced_chi
        gain = self._gain(hypothesis)
        by_table = hypothesis.kind == ROBOT_TABLE and gain > MIN_TABLE_GAIN and then < 1.05 * now
        if not by_table and (not self.beyond_effects or gain <= MIN_GAIN or now <= LEAST_FACTOR * then):
            return False
        # What still leaves most points where no effect could is not the mistake, or not the whole of it.
        left_mm = float(np.median(np.linalg.norm(self.fits[hypothesis].after.error_mm, axis=1)))
        return not is_beyond_effects(left_mm, self.now.dataset.robot)

    def _is_open(self, hypothesis: DataHypothesis) -> bool:
        return (
            _turns_joints(hypothesis)
            and self.fits[hypothesis].fit.reduced_chi < _NEAR_ENOUGH * self.now.fit.reduced_chi
        )


def _turns_joints(hypothesis: DataHypothesis) -> bool:
    """Whether a hypothesis on a mistake changes only signs of joints."""
    reading = hypothesis.reading
    return hypothesis.kind == JOINT_SIGN and reading is not None and not any(reading.offsets_rad)


def _cost(hypothesis: DataHypothesis) -> float:
    """Penalty on a hypothesis' log evidence: log of the number of alternatives, for orders of rows and for lengths.

    Each length costs what it was chosen from, and the width of its values over the precision to which they are fitted.
    """
    if hypothesis.chosen_from > 1:
        return hypothesis.edits * (float(np.log(hypothesis.chosen_from)) + _LENGTH_COST)
    if hypothesis.kind != ROW_ORDER or hypothesis.edits < 2:
        return 0.0
    moved = hypothesis.moved_rows
    return float(np.sum(np.log(np.arange(1, moved + 1)))) + 2.0 * moved
