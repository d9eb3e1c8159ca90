"""Choice of poses that discriminate between hypotheses on the missing effect, and their power.

The log Bayes factor of two hypotheses is the log of the ratio of their evidence. New poses add the log ratio of the
predictive distributions; its expectation, where the first hypothesis is true, is the Kullback-Leibler divergence of the
two, each refitted at these poses too (Hunter and Reiner 1965; Box and Hill 1967; Atkinson and Fedorov 1975).

Poses are chosen one by one, then exchanged. The criterion, which is minimised, is the confusion of the hypotheses over
all ordered pairs,

    sum over i of w_i sum over j of exp(-b_ij / 2),

w_i the probability of hypothesis i and b_ij its expected log Bayes factor over j where i is true. The least b_ij
dominates the sum, and a pair that is discriminated already adds nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations, permutations

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.blas_threads import one_blas_thread
from calib.calibration.result import Calibration
from calib.dataset.dataset import Poses
from calib.diagnosis.result import Diagnosis
from calib.effects.effect import describe
from calib.errors import CalibError, FitError
from calib.planning.criterion import BaseCriterion, DesignProblem, DiscriminationOutcome, PlanTask, SeparationReason
from calib.planning.effect_hypotheses import (
    EffectHypothesis,
    HypothesisPrediction,
    HypothesisPredictions,
    HypothesisSet,
    hypothesis_sets,
    predict,
)
from calib.planning.purpose import FURTHER, SPLIT, purposes
from calib.planning.start import FromFit, Start, offered_poses, under_conditions
from calib.planning.unknowns import require_points
from calib.plugins import load
from calib.screening.candidates import MIN_LOG_BAYES_FACTOR
from calib.workcell.pose_conditions import PAYLOAD_KG, conditions_for

NEXT_POSES = 5  # poses that are advised where effects are confounded
ENOUGH_POWER = 0.9  # power that is enough
MOST_POSES = 20  # poses that are tried to find how many would be enough
_DRAWS = 400  # draws of the measurements, for each hypothesis
_NEAR = 0.1  # share of each joint's range within which two poses are one place
_ROUNDS = 3  # rounds of exchanges


@dataclass(frozen=True)
class DiscriminatingPose:
    """Pose to measure next, with the least separation of any two hypotheses at that pose."""

    q: Array  # (n,) commanded joints, rad or mm
    separation_mm: float  # difference of the predicted points beyond what a refit absorbs


@dataclass(frozen=True)
class NextPoses:
    """Poses to measure next, which discriminate between the hypotheses of a diagnosis."""

    discrimination: Discrimination | None  # None where no poses under the same conditions discriminate
    poses: tuple[DiscriminatingPose, ...]  # the largest separation first
    change: object | None = None  # what tells more than such poses, where there is: a result to be presented
    purpose: str = SPLIT  # word of `plan --for` that plans it


def next_poses(diagnosis: Diagnosis) -> NextPoses | None:
    """Next poses to measure, which tell effects that a diagnosis left confounded apart.

    They discriminate between the first set of these effects, or are what a purpose of a plug-in advises. None where no
    effects are confounded, or nothing promises anything.
    """
    points = diagnosis.calibration.dataset.points
    if points is not None and points.lengths is not None:  # poses are planned for points
        return None
    discrimination = _next_discrimination(diagnosis)
    purpose, change = _advised(diagnosis)
    if discrimination is None:
        return None if change is None else NextPoses(None, (), change, purpose)
    return NextPoses(discrimination, commanded_poses(discrimination, diagnosis.calibration), change, purpose)


def _advised(diagnosis: Diagnosis) -> tuple[str, object | None]:
    """First purpose that advises something else than poses that discriminate, and its advice; None without any."""
    for purpose in purposes().values():
        advice: object | None = load(purpose.advice)(diagnosis) if purpose.advice else None
        if advice is not None:
            return purpose.name, advice
    return SPLIT, None


def _next_discrimination(diagnosis: Diagnosis) -> Discrimination | None:
    sets = hypothesis_sets(diagnosis)
    if not sets or len(sets[0].hypotheses) < 2:
        return None
    first = sets[0]
    try:
        return discriminate(first.calibration, first.hypotheses, offered_poses(first.calibration), NEXT_POSES)
    except FitError:  # too few poses to fit a hypothesis at all
        return None


# ---- the choice and what it achieves --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Discrimination:
    """Chosen poses, and the power with which they discriminate between hypotheses."""

    hypotheses: tuple[str, ...]
    poses: Poses  # (K) with their conditions, in the order chosen
    separation_mm: Array  # (K,) least separation of any two hypotheses, beyond what a refit absorbs
    power: float  # probability that the true hypothesis has a log Bayes factor of MIN_LOG_BAYES_FACTOR over all others
    power_by_count: tuple[float, ...]  # power of none, the first, the first two, ... of the poses
    equivalent: tuple[tuple[str, str], ...]  # pairs that the offered poses do not discriminate
    enough: int | None  # number of poses with `ENOUGH_POWER`; None where unknown


@one_blas_thread()
def discriminate(
    calibration: Calibration, hypotheses: Sequence[EffectHypothesis], offered: Poses, count: int
) -> Discrimination | None:
    """Poses, chosen from those offered, that discriminate best between hypotheses, with their power.

    None for fewer than two hypotheses with members, or no poses.

    Args:
        calibration: a fit; effects of the hypotheses that are in its model are removed from it.
        hypotheses: hypotheses of which one is true.
        offered: poses that can be measured, with their conditions.
        count: number of poses to choose.

    Raises FitError where no degree of freedom is left, and for measured lengths, for which no poses are planned.
    """
    require_points(calibration.dataset)
    hypotheses = [hypothesis for hypothesis in hypotheses if hypothesis.members]
    if len(hypotheses) < 2 or not len(offered):
        return None
    predictions = predict(calibration, hypotheses, offered)
    return evaluated(predictions, offered, choose(predictions, offered, count))


def commanded_poses(discrimination: Discrimination, calibration: Calibration) -> tuple[DiscriminatingPose, ...]:
    """Chosen poses with commanded joints, the largest separation first."""
    commanded = calibration.dataset.robot.commands_of(discrimination.poses.q)
    separation_mm = discrimination.separation_mm
    order = np.argsort(-separation_mm, kind="stable")
    return tuple(DiscriminatingPose(commanded[i], float(separation_mm[i])) for i in order)


def choose(predictions: HypothesisPredictions, offered: Poses, count: int) -> IndexArray:
    """Indices (count,) of the offered poses that discriminate best, best first; fewer if there are not enough."""
    return choose_poses(predictions, count, places=offered.q, pairs=_pairs(equivalent_pairs(predictions)))


def evaluated(
    predictions: HypothesisPredictions, offered: Poses, chosen: IndexArray, *, find_enough: bool = False
) -> Discrimination:
    """Power and separation of hypotheses at chosen poses.

    Args:
        predictions: predictions at the offered poses.
        offered: poses that were chosen from.
        chosen: (K,) indices of the chosen poses.
        find_enough: whether to find how many poses would be enough, where the chosen ones are not.
    """
    equivalent = equivalent_pairs(predictions)
    pairs = _pairs(equivalent)
    names = [hypothesis.name for hypothesis in predictions.hypotheses]
    by_count = tuple(power(predictions, chosen[:k]) for k in range(len(chosen) + 1))
    return Discrimination(
        hypotheses=tuple(names),
        poses=offered.select(chosen),
        separation_mm=separations_mm(predictions, chosen, pairs),
        power=by_count[-1],
        power_by_count=by_count,
        equivalent=tuple((names[i], names[j]) for i, j in combinations(range(len(names)), 2) if equivalent[i, j]),
        enough=_enough(predictions, chosen, by_count, offered.q, pairs, find_enough and not equivalent.any()),
    )


def _pairs(equivalent: BoolArray) -> BoolArray:
    """Mask (I, I) of the pairs of hypotheses that poses can discriminate; all pairs if no pair can be."""
    others = ~np.eye(len(equivalent), dtype=bool)
    return others & ~equivalent if (others & ~equivalent).any() else others


def _enough(
    predictions: HypothesisPredictions,
    chosen: IndexArray,
    by_count: Sequence[float],
    places: Array,
    pairs: BoolArray,
    find_enough: bool,
) -> int | None:
    """Number of poses needed for the power `ENOUGH_POWER`, counting the chosen ones first; None where unknown."""
    within = next((k for k, probability in enumerate(by_count) if probability >= ENOUGH_POWER), None)
    if within is not None or not find_enough:
        return within
    while len(chosen) < MOST_POSES:
        extended = _extended(chosen.tolist(), predictions, len(chosen) + 1, places=places, pairs=pairs)
        if len(extended) == len(chosen):
            return None
        chosen = extended
        if power(predictions, chosen) >= ENOUGH_POWER:
            return len(chosen)
    return None


# ---- expected log Bayes factors and power ---------------------------------------------------------------------------


def probabilities(predictions: HypothesisPredictions) -> Array:
    """Posterior probability (I,) of each hypothesis by its evidence at the measured poses."""
    evidence = np.array([hypothesis.log_evidence for hypothesis in predictions.hypotheses])
    likely = np.exp(evidence - evidence.max())
    return likely / likely.sum()


def expected_log_bayes_factors(predictions: HypothesisPredictions, poses: IndexArray) -> Array:
    """Expected log Bayes factor (I, I) of hypothesis i over j, where i is true.

    Args:
        predictions: predictions at C poses.
        poses: (K,) indices of the poses that are measured in addition.
    """
    hypotheses = predictions.hypotheses
    expected = np.zeros((len(hypotheses), len(hypotheses)))
    for i, j in permutations(range(len(hypotheses)), 2):
        now = hypotheses[i].log_evidence - hypotheses[j].log_evidence
        expected[i, j] = now + _divergence(hypotheses[i], hypotheses[j], poses)
    return expected


def equivalent_pairs(predictions: HypothesisPredictions) -> BoolArray:
    """Mask (I, I) of the pairs of hypotheses that even all predicted poses together do not discriminate."""
    expected = expected_log_bayes_factors(predictions, np.arange(len(predictions.hypotheses[0].mean)))
    near = np.minimum(expected, expected.T) < MIN_LOG_BAYES_FACTOR
    return near & ~np.eye(len(expected), dtype=bool)


def separations_mm(predictions: HypothesisPredictions, poses: IndexArray, pairs: BoolArray) -> Array:
    """Least distance (K,), mm, at each pose, between any two hypotheses' predictions, beyond what a refit absorbs."""
    hypotheses = predictions.hypotheses
    least = np.full(len(poses), np.inf)
    for i, j in permutations(range(len(hypotheses)), 2):
        if not pairs[i, j]:
            continue
        off = hypotheses[i].mean[poses] - hypotheses[j].mean[poses]
        spread = hypotheses[j].spread[poses]
        beyond, own = np.linalg.eigh(spread @ np.swapaxes(spread, 1, 2))  # beyond the noise, which is 1
        along = np.einsum("kvw,kv->kw", own, off)
        least = np.minimum(least, np.sqrt(np.sum(along**2 / (1.0 + np.clip(beyond, 0.0, None)), axis=1)))
    return np.where(np.isfinite(least), least * predictions.sigma_mm, 0.0)


def power(
    predictions: HypothesisPredictions, poses: IndexArray, *, log_bayes_factor: float = MIN_LOG_BAYES_FACTOR
) -> float:
    """Probability that, with given poses measured, the true hypothesis has at least a given log Bayes factor.

    Averaged by draws from the predictive distributions: over which hypothesis is true (by its evidence), the size of
    the effect and the noise.
    """
    hypotheses = predictions.hypotheses
    likely = probabilities(predictions)
    rng = np.random.default_rng(0)
    joint = [_joint(hypothesis, poses) for hypothesis in hypotheses]
    draws = rng.standard_normal((len(joint[0][0]), _DRAWS))
    dof = predictions.dof
    total = 0.0
    for i, (mean, _) in enumerate(joint):
        measured = mean[:, None] + joint[i][1] @ draws
        after = np.empty((len(joint), _DRAWS))
        for j, (predicted, root) in enumerate(joint):
            off = np.linalg.solve(root, measured - predicted[:, None])
            # The noise is estimated with each hypothesis: a Student distribution, as the screening's evidence.
            fit = 0.5 * (dof + len(off)) * np.log1p(np.sum(off**2, axis=0) / dof)
            after[j] = hypotheses[j].log_evidence - fit - np.sum(np.log(np.diag(root)))
        others = np.delete(after, i, axis=0).max(axis=0)
        total += float(likely[i] * np.mean(after[i] - others > log_bayes_factor))
    return total


def _joint(hypothesis: HypothesisPrediction, poses: IndexArray) -> tuple[Array, Array]:
    """Mean (K W,) and covariance root (K W, K W) of one hypothesis' joint prediction at K poses."""
    spread = hypothesis.spread[poses].reshape(-1, hypothesis.spread.shape[2])
    # Cholesky's factor of 1 + L L^T, without the square, in which a wide spread would hide the noise.
    upper = np.asarray(np.linalg.qr(np.concatenate([np.eye(len(spread)), spread.T]), mode="r"))
    return hypothesis.mean[poses].ravel(), (upper * np.where(np.diag(upper) < 0.0, -1.0, 1.0)[:, None]).T


def _divergence(true: HypothesisPrediction, other: HypothesisPrediction, poses: IndexArray) -> float:
    """Kullback-Leibler divergence between the joint predictions of two hypotheses at given poses.

    By Woodbury in the other's few parameters: (1 + L L^T)^-1 = 1 - L (1 + L^T L)^-1 L^T, for any number of poses.
    """
    own = true.spread[poses].reshape(-1, true.spread.shape[2])
    spread = other.spread[poses].reshape(-1, other.spread.shape[2])
    off = (true.mean[poses] - other.mean[poses]).ravel()
    inner = np.eye(spread.shape[1]) + spread.T @ spread
    apart = np.column_stack([own, off])
    along = spread.T @ apart
    beyond = float(np.sum(apart**2)) - float(np.sum(along * np.linalg.solve(inner, along)))
    absorbed = spread.shape[1] - float(np.trace(np.linalg.inv(inner)))
    logs = np.linalg.slogdet(inner)[1] - np.linalg.slogdet(np.eye(own.shape[1]) + own.T @ own)[1]
    return 0.5 * (beyond - absorbed + float(logs))


# ---- the choice by exchange -----------------------------------------------------------------------------------------


def choose_poses(predictions: HypothesisPredictions, count: int, *, places: Array, pairs: BoolArray) -> IndexArray:
    """Indices (count,) of the predicted poses that discriminate best, best first; fewer if there are not enough.

    Args:
        predictions: predictions at C poses.
        count: number of poses to choose.
        places: (C, n) joints; poses at nearly the same joints are not taken twice.
        pairs: (I, I) pairs of hypotheses to discriminate.
    """
    chosen = _extended((), predictions, count, places=places, pairs=pairs).tolist()
    for _ in range(_ROUNDS if len(chosen) > 1 else 0):
        before = list(chosen)
        for k in range(len(chosen)):
            best = _best_given(predictions, [*chosen[:k], *chosen[k + 1 :]], places, pairs)
            chosen[k] = chosen[k] if best is None else best
        if chosen == before:
            break
    return np.array(chosen, dtype=np.int64)


def _extended(
    start: Sequence[int], predictions: HypothesisPredictions, count: int, *, places: Array, pairs: BoolArray
) -> IndexArray:
    """Chosen poses extended up to `count`, by the best pose given those chosen before."""
    chosen = list(start)
    while len(chosen) < count:
        best = _best_given(predictions, chosen, places, pairs)
        if best is None:
            break
        chosen.append(best)
    return np.array(chosen, dtype=np.int64)


def _best_given(
    predictions: HypothesisPredictions, chosen: Sequence[int], places: Array, pairs: BoolArray
) -> int | None:
    """Index of the pose that discriminates best in addition to the chosen poses; None where no pose is free."""
    span = np.maximum(np.ptp(places, axis=0), 1e-9)
    free = np.ones(len(places), dtype=bool)
    for k in chosen:
        free &= np.max(np.abs(places - places[k]) / span, axis=1) > _NEAR
    if not free.any():
        return None
    return int(np.argmin(np.where(free, log_confusion(predictions, chosen, pairs), np.inf)))


def log_confusion(predictions: HypothesisPredictions, chosen: Sequence[int], pairs: BoolArray) -> Array:
    """Log of the hypotheses' probability of confusion (C,), with the chosen poses and each of C further poses.

    See the module.
    """
    hypotheses = predictions.hypotheses
    conditional = [_Conditional(hypothesis, chosen) for hypothesis in hypotheses]
    terms = []
    for i, j in permutations(range(len(hypotheses)), 2):
        if pairs[i, j]:
            now = hypotheses[i].log_evidence - hypotheses[j].log_evidence
            expected = now + conditional[j].divergence_from(conditional[i])
            terms.append(np.log(probabilities(predictions)[i]) - 0.5 * expected)
    return np.logaddexp.reduce(np.stack(terms), axis=0)


class _Conditional:
    """Prediction of one hypothesis at every pose, conditional on measurements at the chosen poses."""

    def __init__(self, hypothesis: HypothesisPrediction, chosen: Sequence[int]) -> None:
        self.hypothesis = hypothesis
        spread = hypothesis.spread
        self.inside = spread[list(chosen)].reshape(-1, spread.shape[2])  # (S, P)
        self.mean_inside = hypothesis.mean[list(chosen)].ravel()
        self.covariance = np.eye(len(self.inside)) + self.inside @ self.inside.T
        # By singular values, so that nothing cancels where a hypothesis spreads far beyond the noise.
        axes, size, turn = np.linalg.svd(self.inside, full_matrices=False)
        self.inverse_inside = np.eye(len(axes)) - (axes * (size**2 / (1.0 + size**2))) @ axes.T
        along = spread @ turn.T  # (C, W, k)
        self.gain = (along * (size / (1.0 + size**2))) @ axes.T
        root = spread - (along * (1.0 - 1.0 / np.sqrt(1.0 + size**2))) @ turn
        beyond, own = np.linalg.eigh(root @ np.swapaxes(root, 1, 2))  # beyond the noise, which is 1
        beyond = np.clip(beyond, 0.0, None)
        self.inverse = (own / (1.0 + beyond)[:, None, :]) @ np.swapaxes(own, 1, 2)
        self.log_det = np.sum(np.log1p(beyond), axis=1) + np.sum(np.log1p(size**2))

    def divergence_from(self, true: _Conditional) -> Array:
        """Kullback-Leibler divergence (C,) from the true hypothesis, for the chosen poses and one more of C."""
        off_inside = true.mean_inside - self.mean_inside
        inside = np.sum(self.inverse_inside * true.covariance) + off_inside @ self.inverse_inside @ off_inside
        off = true.hypothesis.mean - self.hypothesis.mean - self.gain @ off_inside
        spread = true.hypothesis.spread - self.gain @ true.inside
        total = self.gain @ np.swapaxes(self.gain, 1, 2) + spread @ np.swapaxes(spread, 1, 2)
        trace = np.einsum("cij,cji->c", self.inverse, total + np.eye(off.shape[1]))
        apart = np.einsum("ci,cij,cj->c", off, self.inverse, off)
        rows = off.shape[1] + len(off_inside)
        return 0.5 * (inside + trace + apart - rows + self.log_det - true.log_det)


@dataclass(frozen=True, eq=False)
class ForDiscrimination(BaseCriterion):
    """Criterion: discriminate between the hypotheses of one confounded set."""

    hypothesis_set: HypothesisSet
    payload_kg: float | None = None  # payload that the arm may carry at some poses, where the measured one is constant
    name = SPLIT
    effects: tuple[str, ...] = ()
    _predicted: list[tuple[Poses, HypothesisPredictions]] = field(default_factory=list, init=False, repr=False)

    @property
    def start(self) -> FromFit:
        """Start of the plan: the fit that left the hypotheses open."""
        return FromFit(self.hypothesis_set.calibration)

    @property
    def _helped_by_payload(self) -> bool:
        """Whether a varying payload would separate the hypotheses, and the data have no varying payload."""
        members = [hypothesis.members[0] for hypothesis in self.hypothesis_set.hypotheses if hypothesis.members]
        wanted = conditions_for(describe(member) for member in members)
        payload_kg = self.hypothesis_set.calibration.dataset.poses.payload_kg
        varies = payload_kg is not None and bool(payload_kg.min() < payload_kg.max())
        return bool(wanted.payloads_kg) and not varies

    def prepared(self, start: Start, offered: Poses) -> Poses:
        """Candidate poses with conditions that vary like the measured ones, and with the payload where it helps."""
        payloads = (0.0, self.payload_kg) if self.payload_kg and self._helped_by_payload else ()
        return offered if start.measured is None else under_conditions(offered, start.measured, payloads)

    def choose(self, problem: DesignProblem, count: int) -> IndexArray:
        """Indices (count,) of the candidates that discriminate best, in the order chosen."""
        return choose(self._predictions(problem.candidates), problem.candidates, count)

    def reasons(self, problem: DesignProblem, chosen: IndexArray) -> tuple[SeparationReason, ...]:
        """For each chosen candidate, the distance between the hypotheses' predictions."""
        return tuple(SeparationReason(float(mm)) for mm in self._evaluated(problem, chosen).separation_mm)

    def outcome(self, problem: DesignProblem, chosen: IndexArray) -> DiscriminationOutcome:
        """Power by the number of poses, and advice where the power is low."""
        achieved = self._evaluated(problem, chosen, find_enough=True)
        weak = achieved.power < ENOUGH_POWER
        hopeless = bool(achieved.equivalent) or (weak and achieved.enough is None)
        hypotheses = self.hypothesis_set.hypotheses
        confirm = [(h.name, str(getattr(h.members[0], "confirm", ""))) for h in hypotheses if h.members]
        return DiscriminationOutcome(
            hypotheses=achieved.hypotheses,
            power_by_count=achieved.power_by_count,
            equivalent=achieved.equivalent,
            enough=achieved.enough if weak else None,
            enough_power=ENOUGH_POWER,
            payload_kg=PAYLOAD_KG if weak and self._helped_by_payload and not self.payload_kg else None,
            confirm=tuple((name, text) for name, text in confirm if text) if hopeless else (),
            untested=self.hypothesis_set.untested,
            would_help=self.hypothesis_set.would_help,
        )

    def _predictions(self, candidates: Poses) -> HypothesisPredictions:
        """Predictions of all hypotheses at the candidates, cached for one set of candidates."""
        if not self._predicted or self._predicted[0][0] is not candidates:
            hypotheses = [hypothesis for hypothesis in self.hypothesis_set.hypotheses if hypothesis.members]
            self._predicted[:] = [(candidates, predict(self.hypothesis_set.calibration, hypotheses, candidates))]
        return self._predicted[0][1]

    def _evaluated(self, problem: DesignProblem, chosen: IndexArray, *, find_enough: bool = False) -> Discrimination:
        """Power and separation of the chosen candidates."""
        candidates = problem.candidates
        return evaluated(self._predictions(candidates), candidates, chosen, find_enough=find_enough)


def for_confounded(diagnosis: Diagnosis, payload_kg: float | None = None) -> ForDiscrimination:
    """Criterion for the first set of effects, left confounded by a diagnosis, that poses can discriminate.

    Raises CalibError where no effects were left confounded, or the data lack the means to test them.
    """
    sets = hypothesis_sets(diagnosis)
    name = diagnosis.calibration.dataset.name
    if not sets:
        raise CalibError(
            f"dataset {name}: its diagnosis left no effects confounded (verdict {diagnosis.verdict}), so there is "
            "nothing to discriminate; plan for calibration, or for an effect"
        )
    for hypothesis_set in sets:
        if sum(bool(hypothesis.members) for hypothesis in hypothesis_set.hypotheses) > 1:
            return ForDiscrimination(hypothesis_set, payload_kg)
    would_help = next((each.would_help for each in sets if each.would_help), "")
    raise CalibError(
        f"dataset {name}: no pose discriminates between {', '.join(sets[0].names)}, which these data cannot test"
        + (f"; {would_help}" if would_help else "")
    )


def task_of_confounded(diagnosis: Diagnosis, payload_kg: float | None, count: int | None) -> PlanTask:
    """Poses that discriminate between effects left confounded by a diagnosis. Raises as `for_confounded`."""
    criterion = for_confounded(diagnosis, payload_kg)
    return PlanTask(criterion.start, FURTHER if count is None else count, criterion)
