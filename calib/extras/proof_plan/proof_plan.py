"""The cheapest change of one condition that proves which of several causes is true, and its probability.

A change is another payload, the other side of approach, or another temperature. Poses measured already are measured
again under the changed condition, where theirs is known; else both poses of each pair are new. The probability is found
by simulation: a cause is drawn with its sizes, as the measured poses leave them possible, the pairs are measured with
noise, and `calib.intervention.proof.decided` judges them as it will judge the real ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import IndexArray
from calib.blas_threads import one_blas_thread
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset, Poses
from calib.diagnosis.result import Diagnosis
from calib.effects.effect import Effect
from calib.errors import CalibError, FitError
from calib.extras.proof_plan.plugin import PROVE
from calib.extras.proof_plan.simulated_pairs import (
    TEMPERATURE,
    ConditionChange,
    DrawnCause,
    Offer,
    PairCell,
    chosen_from,
    joined_poses,
    under,
)
from calib.intervention.pairs import APPROACH, PAYLOAD, find_pairs
from calib.intervention.proof import FEWEST_PAIRS, follows, with_masses
from calib.planning.criterion import BaseCriterion, DesignProblem, Outcome, PlanTask, PoseReason
from calib.planning.effect_hypotheses import HypothesisSet, coefficient_posteriors, hypothesis_sets
from calib.planning.start import FromFit, Start, offered_poses
from calib.workcell.pose_conditions import COLD_C, WARM_C

PROOF_PAYLOAD_KG = 2.0
"""Payload that is hung on the flange, where the user has no other."""
WORTH_A_CHANGE = 0.5
"""Probability from which a change is advised."""
_BETTER = 0.15  # of probability, by which new pairs have to be better than poses measured again
_EASE = {APPROACH: 0.0, PAYLOAD: 0.02, TEMPERATURE: 0.1}  # of probability, that a change's trouble counts as
_TRIALS = 60  # simulated follow-ups
_CAUSES = 30  # drawn causes that pairs are chosen for
_NEW = 200  # new poses that are offered
_SIGNS = 20  # draws of a size that has to be positive


@dataclass(frozen=True)
class NextChange(Outcome):
    """Poses to measure under a changed condition, and the probability that their differences prove the true cause."""

    calibration: Calibration  # that left the hypotheses open
    hypotheses: tuple[str, ...]
    change: ConditionChange
    poses: Poses  # to measure, in their conditions, the most informative first
    again: tuple[str, ...]  # measured poses that these repeat, one for each; () where both poses of a pair are new
    assumed: bool  # whether the condition of the measured poses is taken for `change.before`, as no column has it
    pairs: int
    probability: float
    others: tuple[tuple[ConditionChange, float], ...]  # further changes, and what they would reach

    @property
    def power(self) -> float:
        """Probability that the pairs prove which hypothesis is true."""
        return self.probability


# ---- what stays open ------------------------------------------------------------------------------------------------


def next_change(
    diagnosis: Diagnosis,
    *,
    payload_kg: float | None = None,
    count: int | None = None,
) -> NextChange | None:
    """Change that most probably proves which effect of a diagnosis' first confounded set is true; the easiest first.

    None where nothing is confounded, or no change moves any of the effects.

    Args:
        diagnosis: that left effects confounded.
        payload_kg: payload to hang on the flange.
        count: number of poses to measure; None: the fewest that are nearly as good as 40.
    """
    for hypothesis_set in hypothesis_sets(diagnosis):
        try:
            found = change_for(hypothesis_set, payload_kg=payload_kg, count=count)
        except FitError:  # too few poses to fit a hypothesis at all
            continue
        if found is not None:
            return found
    return None


def advised_change(diagnosis: Diagnosis) -> NextChange | None:
    """Change of one condition to advise after a diagnosis, where it is likely to prove which effect is true."""
    found = next_change(diagnosis)
    return found if found is not None and found.probability >= WORTH_A_CHANGE else None


@one_blas_thread()
def change_for(
    hypothesis_set: HypothesisSet,
    *,
    payload_kg: float | None = None,
    count: int | None = None,
) -> NextChange | None:
    """Change that most probably proves which hypothesis is true; None where no change does, see `next_change`.

    Raises FitError where no degree of freedom is left, and CalibError for fewer poses than make four pairs.
    """
    calibration = hypothesis_set.calibration
    if count is not None and count < FEWEST_PAIRS:
        raise CalibError(
            f"found {count} poses to prove a cause by; it takes {FEWEST_PAIRS} pairs: ask for {FEWEST_PAIRS}"
        )
    hypotheses = [hypothesis for hypothesis in hypothesis_set.hypotheses if hypothesis.members]
    if not hypotheses:
        return None
    posteriors = coefficient_posteriors(calibration, hypotheses)
    rng = np.random.default_rng(0)
    evidence = np.array([hypothesis.log_evidence for hypothesis in hypotheses])
    likely = np.exp(evidence - evidence.max())
    drawn = []
    for k in rng.choice(len(hypotheses), max(_CAUSES, _TRIALS), p=likely / likely.sum()):
        members = hypotheses[k].members
        positive = np.array([p.positive for member in members for p in member.parameters])
        for values in (posteriors.draw(int(k), rng) for _ in range(_SIGNS)):
            if np.all(values[positive] >= 0.0):
                break
        ends = np.cumsum([len(member.parameters) for member in members])[:-1]
        each = np.split(np.where(positive, np.abs(values), values), ends)
        drawn.append(DrawnCause(hypotheses[k].name, dict(zip(members, each, strict=True))))
    robot = with_masses(calibration.model.calibrated_robot(calibration.fit.x))
    cell = PairCell(calibration.dataset, robot, dict(calibration.after.scanner_T_base), posteriors.sigma_mm)
    found: list[tuple[float, Offer]] = []
    for change in _changes(calibration.dataset, [m for one in hypotheses for m in one.members], payload_kg):
        best = _best_offer(cell, _offers(calibration, change), drawn[:_CAUSES], count)
        if best is not None:
            found.append(best)
    if not found:
        return None
    found.sort(key=lambda one: _EASE[one[1].change.condition] - one[0])
    offer = found[0][1]
    made = cell.measured(offer.both)
    return NextChange(
        calibration=calibration,
        hypotheses=tuple(hypothesis.name for hypothesis in hypotheses),
        change=offer.change,
        poses=offer.to_measure,
        again=offer.before.ids if offer.is_again else (),
        assumed=offer.assumed,
        pairs=len(offer.before),
        probability=0.0 if made is None else made.settled_share(drawn[:_TRIALS], rng),
        others=tuple((other.change, reached) for reached, other in found[1:]),
    )


def _changes(dataset: Dataset, members: Sequence[Effect], payload_kg: float | None) -> list[ConditionChange]:
    """Changes of one condition that move any of some effects."""
    poses = dataset.poses
    known = np.zeros(1) if poses.payload_kg is None else poses.payload_kg
    low, high = float(known.min()), float(known.max())
    cold = COLD_C if poses.temperature_c is None else float(np.median(poses.temperature_c))
    changes = (
        ConditionChange(APPROACH, None, None),
        ConditionChange(PAYLOAD, low, high if high > low else low + (payload_kg or PROOF_PAYLOAD_KG)),
        ConditionChange(TEMPERATURE, cold, cold + WARM_C - COLD_C),
    )
    return [change for change in changes if any(follows(member, (change.condition,)) for member in members)]


# ---- pairs that can be measured -------------------------------------------------------------------------------------


def _offers(calibration: Calibration, change: ConditionChange) -> list[Offer]:
    """Pairs that can be measured: poses measured again, and new ones."""
    offered, rng = offered_poses(calibration, count=_NEW), np.random.default_rng(1)
    sides = rng.choice([-1.0, 1.0], offered.q.shape)
    values = sides if change.before is None else np.full(len(offered), change.before)
    new = Offer.of(offered, change, values, again=False)
    again = _again(calibration, change)
    return [new] if again is None else [again, new]


def _again(calibration: Calibration, change: ConditionChange) -> Offer | None:
    """Training poses to be measured again under the changed condition; None where theirs is not known."""
    dataset, poses = calibration.fitted_dataset, calibration.fitted_dataset.poses
    assert dataset.points is not None
    recorded = getattr(poses, change.condition)
    if recorded is None and change.condition != PAYLOAD:
        return None
    paired = {int(i) for one in find_pairs(dataset) if change.condition in one.conditions for i in one.poses}
    trained = [i for i in np.unique(dataset.points.pose).tolist() if not poses.is_test[i] and i not in paired]
    if len(trained) < FEWEST_PAIRS:
        return None
    values = np.full(len(trained), change.before) if recorded is None else recorded[trained]
    offer = Offer.of(poses.select(np.array(trained)), change, values, again=True, assumed=recorded is None)
    last = poses.setup[trained[int(np.argmax(poses.order[trained]))]]
    return replace(offer, after=replace(offer.after, setup=np.full(len(trained), last)))


def _best_offer(
    cell: PairCell, offers: Sequence[Offer], drawn: Sequence[DrawnCause], count: int | None
) -> tuple[float, Offer] | None:
    """Chosen pairs with nearly their probability; measured poses again, unless new ones are clearly better."""
    best: tuple[float, Offer] | None = None
    for offer in offers:
        found = chosen_from(cell, offer, drawn, count)
        if found is not None and (best is None or found[0] > best[0] + _BETTER):
            best = found
    return best


# ---- the criterion --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PairReason(PoseReason):
    """Reason for a pose: it is measured under a changed condition, at the joints of another one."""

    again: str | None  # the pose measured before that it repeats; None where both are new
    condition: str  # column of poses.csv
    level: float | None  # its value; None for sides of approach


@dataclass(frozen=True)
class ForProof(BaseCriterion):
    """Criterion: prove which hypothesis is true by pairs of poses, which are chosen already."""

    chosen: NextChange
    start: FromFit
    name = PROVE
    keeps_temperature = True
    effects: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Number of poses to measure."""
        return len(self.chosen.poses)

    def prepared(self, start: Start, offered: Poses) -> Poses:
        """The chosen poses first, then candidates as offered, under the condition before the change."""
        change, poses, n = self.chosen.change, self.chosen.poses, len(offered)
        for name in ("payload_kg", "temperature_c", "approach"):
            values = getattr(poses, name)
            usual = None if values is None else np.repeat(values[:1], n, axis=0)
            if name == change.condition != APPROACH and change.before is not None:
                usual = np.full(n, change.before)
            offered = under(offered, name, usual)
        return joined_poses(self.chosen.poses, offered)

    def choose(self, problem: DesignProblem, count: int) -> IndexArray:
        """Indices of the chosen poses, which are the first of the candidates."""
        return np.arange(min(count, self.count))

    def reasons(self, problem: DesignProblem, chosen: IndexArray) -> tuple[PairReason, ...]:
        """For each pose, the measured pose that it repeats, and its condition."""
        again, condition = self.chosen.again, self.chosen.change.condition
        levels = None if condition == APPROACH else getattr(self.chosen.poses, condition)
        return tuple(
            PairReason(again[k] if again else None, condition, None if levels is None else float(levels[k]))
            for k in chosen.tolist()
        )

    def outcome(self, problem: DesignProblem, chosen: IndexArray) -> NextChange:
        """The change, and the probability that it proves which hypothesis is true."""
        return self.chosen


def task_of_diagnosis(diagnosis: Diagnosis, payload_kg: float | None, count: int | None) -> PlanTask:
    """Poses that prove one of the effects that a diagnosis left confounded; as many as it takes where none is given.

    Raises CalibError where nothing was left confounded, or no change moves any of it.
    """
    name, found = diagnosis.calibration.dataset.name, next_change(diagnosis, payload_kg=payload_kg, count=count)
    if found is not None:
        proof = ForProof(found, FromFit(found.calibration))
        return PlanTask(proof.start, proof.count, proof)
    sets = hypothesis_sets(diagnosis)
    if not sets:
        raise CalibError(
            f"dataset {name}: its diagnosis left no effects confounded (verdict {diagnosis.verdict}), so there is "
            "nothing to prove; plan for calibration, or for an effect"
        )
    raise CalibError(
        f"dataset {name}: neither a payload, nor the side of approach, nor the temperature moves any of "
        f"{', '.join(sets[0].names)}, so pairs of poses prove none; --for split plans other poses"
    )
