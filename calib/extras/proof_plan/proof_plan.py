"""The cheapest change of one condition that proves which of several causes is true, and its probability.

A change is another payload, the other side of approach, or another temperature. Poses measured already are measured
again under the changed condition, where theirs is known; else both poses of each pair are new. The probability is found
by simulation: a cause is drawn with its sizes, as the measured poses leave them possible, the pairs are measured with
noise, and `calib.intervention.proof.decided` judges them as it will judge the real ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.blas_threads import one_blas_thread
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset, Poses
from calib.diagnosis.result import Diagnosis
from calib.effects.effect import Effect, exceeded_bound, family_name
from calib.errors import CalibError, FitError
from calib.extras.proof_plan.pair_design import exchanged_pairs, greedy_pairs
from calib.extras.proof_plan.simulated_pairs import (
    TEMPERATURE,
    ConditionChange,
    DrawnCause,
    Needed,
    Offer,
    PairCell,
    chosen_from,
    design_of,
    needed,
    new_pairs,
    settled_share,
    under,
)
from calib.intervention.pairs import APPROACH, PAYLOAD, find_pairs
from calib.intervention.proof import FEWEST_PAIRS, candidates_of, follows, with_masses
from calib.planning.effect_hypotheses import HypothesisSet, coefficient_posteriors, hypothesis_sets
from calib.planning.offered_poses import offered_poses
from calib.planning.start import FromRobot
from calib.statistics import rms
from calib.workcell.candidates import candidate_poses
from calib.workcell.measurable import measurable
from calib.workcell.pose_conditions import COLD_C, WARM_C
from calib.workcell.workcell import Workcell

PROOF_PAYLOAD_KG = 2.0
"""Payload that is hung on the flange, where the user has no other."""
WORTH_A_CHANGE = 0.5
"""Probability from which a change is advised."""
_BETTER = 0.15  # of probability, by which new pairs have to be better than poses measured again
_EASE = {APPROACH: 0.0, PAYLOAD: 0.02, TEMPERATURE: 0.1}  # of probability, that a change's trouble counts as
_TRIALS = 60  # simulated follow-ups
_CAUSES = 30  # drawn causes that pairs are chosen for
_NEW = 200  # new poses that are offered
_NEW_OF_ROBOT = 600  # and where nothing was measured yet: the best few are far better than most
GIVES_WAY = ("joint_compliance", "link_bending", "base_compliance")
"""Effects of which one is thought true where nothing is known of an arm."""
_STEPS_DEG = (60.0, 30.0, 15.0, 8.0)  # by which chosen poses of a free choice are moved, to find better ones
_NEIGHBOURS = 10
_MARGINAL = 1.5  # root mean square of a cause's differences over the noise, where its proof hangs in the balance
_GOALS = ((1.0, 0.6), (2.0, 0.9))
"""Sizes of a cause over the noise, at usual poses, and the probability of proving it that a plan says the price of."""
_SIGNS = 20  # draws of a size that has to be positive


@dataclass(frozen=True)
class NextChange:
    """Poses to measure under a changed condition, and the probability that their differences prove the true cause."""

    calibration: Calibration | None  # fit that left the hypotheses open; None for an arm that was never measured
    hypotheses: tuple[str, ...]
    change: ConditionChange
    poses: Poses  # to measure, in their conditions, the most informative first
    again: tuple[str, ...]  # measured poses that these repeat, one for each; () where both poses of a pair are new
    assumed: bool  # whether the condition of the measured poses is taken for `change.before`, as no column has it
    pairs: int
    probability: float
    others: tuple[tuple[ConditionChange, float], ...]  # further changes, and what they would reach
    needed: tuple[Needed, ...] = ()  # what it takes to prove the cause more probably, where that was asked for


# ---- what stays open ------------------------------------------------------------------------------------------------


def next_change(
    diagnosis: Diagnosis,
    *,
    payload_kg: float | None = None,
    count: int | None = None,
    least: float = 0.0,
    with_needed: bool = False,
) -> NextChange | None:
    """Change that most probably proves which effect of a diagnosis' first confounded set is true; the easiest first.

    None where nothing is confounded, or no change moves any of the effects.

    Args:
        diagnosis: that left effects confounded.
        payload_kg: payload to hang on the flange.
        count: number of poses to measure; None: the fewest that are nearly as good as 40.
        least: probability below which a change is worth nothing; an estimate of half of that ends the search.
        with_needed: whether to find out what it takes to prove the cause more probably.
    """
    for hypothesis_set in hypothesis_sets(diagnosis):
        try:
            found = change_for(hypothesis_set, payload_kg=payload_kg, count=count, least=least, with_needed=with_needed)
        except FitError:  # too few poses to fit a hypothesis at all
            continue
        if found is not None:
            return found
    return None


def advised_change(diagnosis: Diagnosis) -> NextChange | None:
    """Change of one condition to advise after a diagnosis, where it is likely to prove which effect is true."""
    return next_change(diagnosis, least=WORTH_A_CHANGE)


@one_blas_thread()
def change_for(
    hypothesis_set: HypothesisSet,
    *,
    payload_kg: float | None = None,
    count: int | None = None,
    least: float = 0.0,
    with_needed: bool = False,
) -> NextChange | None:
    """Change that most probably proves which hypothesis is true; None where no change does, see `next_change`.

    Raises FitError where no degree of freedom is left, and CalibError for fewer poses than make four pairs.
    """
    calibration = hypothesis_set.calibration
    if count is not None:
        _require_pairs(count, FEWEST_PAIRS)
    hypotheses = [hypothesis for hypothesis in hypothesis_set.hypotheses if hypothesis.members]
    if not hypotheses:
        return None
    posteriors = coefficient_posteriors(calibration, hypotheses)
    rng = np.random.default_rng(0)
    evidence = np.array([hypothesis.log_evidence for hypothesis in hypotheses])
    likely = np.exp(evidence - evidence.max())
    drawn = []
    for k in rng.choice(len(hypotheses), max(_CAUSES, _TRIALS), p=likely / likely.sum()):
        one = hypotheses[k]
        drawn.append(_drawn(one.name, one.members, partial(posteriors.draw, int(k), rng)))
    robot = with_masses(calibration.model.calibrated_robot(calibration.fit.x))
    scanner_T_base = calibration.after.scanner_T_base
    cell = PairCell(calibration.dataset, robot, dict(scanner_T_base), posteriors.sigma_mm)
    members = [member for hypothesis in hypotheses for member in hypothesis.members]
    found: list[tuple[float, Offer]] = []
    for change in _changes(calibration.dataset, members, payload_kg):
        best = _best_offer(cell, _offers(calibration, change), drawn[:_CAUSES], count)
        if best is not None:
            found.append(best)
    if not found:
        return None
    found.sort(key=lambda one: _EASE[one[1].change.condition] - one[0])
    reached, offer = found[0]
    if reached < 0.5 * least:
        return None
    probability = settled_share(cell.measured(offer.both), drawn[:_TRIALS], rng)
    if probability < least:
        return None
    return NextChange(
        calibration=calibration,
        hypotheses=tuple(hypothesis.name for hypothesis in hypotheses),
        change=offer.change,
        poses=offer.to_measure,
        again=offer.before.ids if offer.is_again else (),
        assumed=offer.assumed,
        pairs=len(offer.before),
        probability=probability,
        others=tuple((other.change, reached) for reached, other in found[1:]),
        needed=needed(cell, offer, _pool(calibration, offer), drawn[:_TRIALS], rng) if with_needed else (),
    )


def _pool(calibration: Calibration, chosen: Offer) -> Offer:
    """All pairs of the kind that was chosen."""
    return next(offer for offer in _offers(calibration, chosen.change) if offer.is_again == chosen.is_again)


def _require_pairs(count: int, least: int) -> None:
    if count < least:
        raise CalibError(f"found {count} poses to prove a cause by; it takes {FEWEST_PAIRS} pairs: ask for {least}")


def _drawn(effect: str, members: Sequence[Effect], draw: Callable[[], Array]) -> DrawnCause:
    """Cause with coefficients that have the signs they should have, where such are found."""
    positive = np.array([p.positive for member in members for p in member.parameters])
    for _ in range(_SIGNS):
        values = draw()
        if not np.any(values[positive] < 0.0):
            break
    values = np.where(positive, np.abs(values), values)
    ends = np.cumsum([len(member.parameters) for member in members])[:-1]
    return DrawnCause(effect, dict(zip(members, np.split(values, ends), strict=True)))


def _changes(dataset: Dataset, members: Sequence[Effect], payload_kg: float | None) -> list[ConditionChange]:
    """Changes of one condition that move any of some effects."""
    poses = dataset.poses
    out = []
    if any(follows(member, (APPROACH,)) for member in members):
        out.append(ConditionChange(APPROACH, None, None))
    if any(follows(member, (PAYLOAD,)) for member in members):
        low, high = _ends(poses.payload_kg, 0.0, payload_kg or PROOF_PAYLOAD_KG)
        out.append(ConditionChange(PAYLOAD, low, high))
    if any(follows(member, (TEMPERATURE,)) for member in members):
        cold = COLD_C if poses.temperature_c is None else float(np.median(poses.temperature_c))
        out.append(ConditionChange(TEMPERATURE, cold, cold + WARM_C - COLD_C))
    return out


def _ends(values: Array | None, low: float, more: float) -> tuple[float, float]:
    """Least and largest recorded value of a condition, or `more` above the only one."""
    if values is None:
        return low, more
    least, most = float(values.min()), float(values.max())
    return (least, most) if most > least else (least, least + more)


# ---- an arm that was never measured ---------------------------------------------------------------------------------


@one_blas_thread()
def change_for_robot(start: FromRobot, count: int, *, payload_kg: float | None = None, seed: int = 0) -> NextChange:
    """Pairs of poses without and with a payload that prove which joint, link or other part gives way.

    The probability is over arms of which one part gives way, by as much as is usual.

    Args:
        start: the arm and its cell.
        count: number of measurements, two a pair.
        payload_kg: payload to hang on the flange.
        seed: of the candidate poses.

    Raises:
        CalibError: fewer than eight measurements, or too few poses that can be measured.
    """
    _require_pairs(count, 2 * FEWEST_PAIRS)
    rng = np.random.default_rng(seed)
    change = ConditionChange(PAYLOAD, 0.0, payload_kg or PROOF_PAYLOAD_KG)
    base_T_scanner = start.cell.base_T_scanner
    scanner_T_base = np.eye(4) if base_T_scanner is None else frames.invert(base_T_scanner)
    cell = PairCell(start.dataset, with_masses(start.cell.robot), {start.setup: scanner_T_base}, start.noise_mm)
    offered = start.poses_at(candidate_poses(start.cell, _NEW_OF_ROBOT, rng=rng))
    pool = new_pairs(offered, change)
    offer = yielding_pairs(cell, offered, change, count // 2, rng)
    for degrees in _STEPS_DEG:
        near = _near(start.cell, offer.before.q, degrees, rng)
        offer = yielding_pairs(cell, start.poses_at(near), change, count // 2, rng, begin=True)
    drawn = _usual_causes(cell, offer, rng)
    return NextChange(
        calibration=None,
        hypotheses=tuple(dict.fromkeys(cause.effect for cause in drawn)),
        change=change,
        poses=offer.to_measure,
        again=(),
        assumed=False,
        pairs=len(offer.before),
        probability=settled_share(cell.measured(offer.both), drawn[:_TRIALS], rng),
        others=(),
        needed=tuple(
            replace(one, size_mm=times * start.noise_mm)
            for times, probability in _GOALS
            for one in needed(cell, offer, pool, _sized_causes(cell, pool, times, rng), rng, [probability])
        ),
    )


def yielding_pairs(
    cell: PairCell,
    offered: Poses,
    change: ConditionChange,
    count: int,
    rng: np.random.Generator,
    *,
    begin: bool = False,
) -> Offer:
    """Pairs of new poses, chosen so that it shows which part of an arm gives way where that hardly exceeds the noise.

    begin: whether the first offered poses are a choice that is only to be improved.

    Raises CalibError where no part shows by the change.
    """
    offer = new_pairs(offered, change)
    made = cell.measured(offer.both)
    drawn = _usual_causes(cell, offer, rng)
    found = None if made is None or not drawn else design_of(made, drawn[:_CAUSES], size=_MARGINAL)
    if found is None:
        raise CalibError(f"robot {cell.robot.name}: no part of it shows by a payload of {change.after:g} kg")
    design, _ = found
    chosen = np.arange(count) if begin else greedy_pairs(design, count)
    return offer.take(exchanged_pairs(design, chosen))


def _usual_causes(cell: PairCell, offer: Offer, rng: np.random.Generator) -> list[DrawnCause]:
    """Causes of one part each, families equally often, whose size is usual."""
    made = cell.measured(offer.both)
    members: dict[str, list[Effect]] = {}
    for candidate in [] if made is None else candidates_of(made.differences, made.dataset):
        name = family_name(candidate.member)
        if name in GIVES_WAY:
            members.setdefault(name, []).append(candidate.member)
    drawn = []
    for k in range(_TRIALS if members else 0):
        name = list(members)[k % len(members)]
        member = members[name][int(rng.integers(len(members[name])))]
        scales = np.array([parameter.scale for parameter in member.parameters])
        drawn.append(DrawnCause(name, {member: scales * np.abs(rng.standard_normal(len(scales)))}))
    return drawn


def _sized_causes(cell: PairCell, pool: Offer, times_noise: float, rng: np.random.Generator) -> list[DrawnCause]:
    """Causes of one part each that move the tool by some multiple of the noise, at usual poses under 2 kg.

    Parts that would have to be softer than any are left out.
    """
    made, load_kg = cell.measured(pool.both), pool.change.after
    sized: dict[str, list[tuple[Effect, Array]]] = {}
    for candidate in [] if made is None else candidates_of(made.differences, made.dataset):
        scales = np.array([parameter.scale for parameter in candidate.parameters])
        unit = rng.uniform(0.5, 1.5, len(scales))
        size = 2.0 * rms(candidate.columns @ unit)  # a row is half a difference, in sigmas
        assert load_kg is not None
        values = times_noise * load_kg / PROOF_PAYLOAD_KG / size * unit * scales
        member, name = candidate.member, family_name(candidate.member)
        natural = [exceeded_bound(member, p, v, 0.0) is None for p, v in zip(candidate.parameters, values, strict=True)]
        if name in GIVES_WAY and all(natural) and len(scales) == len(member.parameters):
            sized.setdefault(name, []).append((member, values))
    drawn = []
    for k in range(_TRIALS if sized else 0):
        name = list(sized)[k % len(sized)]
        member, values = sized[name][int(rng.integers(len(sized[name])))]
        drawn.append(DrawnCause(name, {member: values}))
    return drawn


def _near(cell: Workcell, q: Array, degrees: float, rng: np.random.Generator) -> Array:
    """Joint vectors (K, n) and, after them, some near them that can be measured."""
    step = np.where(cell.robot.is_revolute, np.radians(degrees), 4.0 * degrees)
    moved = np.repeat(q, _NEIGHBOURS, axis=0)
    moves = rng.random(moved.shape) < 0.5
    moves[~moves.any(axis=1)] = True
    moved = np.clip(moved + moves * step * rng.standard_normal(moved.shape), cell.low, cell.high)
    return np.concatenate([q, moved[measurable(cell, moved).ok]])


# ---- pairs that can be measured -------------------------------------------------------------------------------------


def _offers(calibration: Calibration, change: ConditionChange) -> list[Offer]:
    """Pairs that can be measured: poses measured again, and new ones."""
    offers = []
    again = _again(calibration, change)
    if again is not None:
        offers.append(again)
    return [*offers, new_pairs(offered_poses(calibration, count=_NEW), change)]


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
    last = poses.setup[trained[int(np.argmax(poses.order[trained]))]]
    before = replace(
        poses.select(np.array(trained)), time_s=None, order=np.zeros(0), came_from=np.zeros((0, 0)), selected_from=None
    )
    if change.condition == APPROACH:
        assert before.approach is not None
        changed = -before.approach
    else:
        assert change.before is not None
        assert change.after is not None
        if recorded is None:
            before = replace(before, payload_kg=np.full(len(before), change.before))
        now = np.zeros(len(before)) if recorded is None else recorded[trained]
        is_low = now < 0.5 * (change.before + change.after)
        changed = np.where(is_low, change.after, change.before)
    after = replace(under(before, change.condition, changed), setup=np.full(len(before), last))
    return Offer(change, before, after, is_again=True, assumed=recorded is None)


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
