"""Rules by which a candidate effect is added to a model, left open, refused, or replaced by learned curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.calibration.plausibility import beyond_nature
from calib.calibration.result import Calibration
from calib.dataset.repeats import repeat_groups
from calib.diagnosis.verdict import Refusal
from calib.screening.candidates import MIN_CONFOUNDED_OVERLAP, MIN_LOG_BAYES_FACTOR, Candidate, Screening, Untestable
from calib.screening.curves.joint_curves import MIN_LOG_EVIDENCE as MIN_CURVE_EVIDENCE
from calib.screening.curves.joint_curves import LearnedCurves
from calib.screening.left_out import left_out_gain
from calib.statistics import group_means, group_numbers

MAX_P_VALUE = 0.01  # of an effect, Holm-corrected
MIN_LOG_EVIDENCE = 3.0
SURE_LOG_EVIDENCE = 6.0  # the same where what is left is as large as noise: what can be seen at all has ten and more
# Two effects are equivalent if all of these hold:
EQUIVALENT_ALIGNMENT = 0.98  # squared cosine between the residuals that they explain, at least
EQUIVALENT_OVERLAP = 0.9995  # share of what the better one explains that the other could make, at least
EQUIVALENT_LOG_BAYES_FACTOR = 8.0  # of the better one over the worse, at most
PARAMETER_COST = 2.5  # nats that a parameter costs which is not needed: half the log of the equations
EQUIVALENT_REST = 1.15  # sum of squares that the worse one leaves over that of the better one, at most
FEWER_PARAMETERS = 0.5  # that the data determine, by which an effect of one parameter is simpler than another
SPECIAL_CASE_OVERLAP = 0.95  # share of what an effect explains that a special case of it could, to come first
CURVES_SHARE = 1.1  # how many times the evidence of a cause of one place or pose curves need to take its place
MAX_WORSENING = 0.5  # standard errors by which a first effect may not raise the test poses' squared error
MIN_LEAD_OVER_TEST = 4.0  # log Bayes factor, below which a first effect may not raise that error at all
_RIVALS = 3  # that are looked at
MIN_GAIN = 1.0  # standard errors by which an effect has to lower the squared error of poses that no fit used


def is_convincing(candidate: Candidate) -> bool:
    """Whether a candidate effect has a significant F test, corrected for all candidates, and enough log evidence."""
    return candidate.p_holm < MAX_P_VALUE and candidate.log_evidence > MIN_LOG_EVIDENCE


def rank_candidates(screening: Screening) -> tuple[Candidate, Candidate | None, tuple[Candidate, ...]]:
    """Best candidate effect, its nearest rival, and the contenders between which the data do not decide.

    A contender could explain most of what the best one explains, and has as much evidence within
    `MIN_LOG_BAYES_FACTOR`. A candidate that explains something else is none: it may be a second cause, and is tested
    again in the next step. A special case of the best one comes first where it says nearly as much, and what contains
    it is no contender: if more than the special case is there, that shows beside it.
    """
    best = _special_case(screening.candidates) or screening.candidates[0]
    wider = {c.name for c in screening.candidates if best.name in c.family.contains}
    others = [
        c
        for c in screening.candidates
        if c is not best and (c.name not in wider or c.log_evidence <= best.log_evidence)
    ]
    confounded = [c for c in others if best.overlaps.get(c.name, 0.0) > MIN_CONFOUNDED_OVERLAP]
    nearest = (*confounded, *others)[:1]
    contenders = [
        c
        for c in confounded
        if best.log_evidence - c.log_evidence <= MIN_LOG_BAYES_FACTOR and c.log_evidence > 0.0 and c.name not in wider
    ]
    return best, (nearest[0] if nearest else None), (best, *contenders) if contenders else ()


def _special_case(candidates: Sequence[Candidate]) -> Candidate | None:
    """Convincing special case of the first candidate that is as likely, or that leaves no more than it would."""
    first = candidates[0]
    for other in candidates[1:]:
        as_much = first.log_evidence - other.log_evidence <= EQUIVALENT_LOG_BAYES_FACTOR
        leaves_as_much = 1.0 - other.explained_share < EQUIVALENT_REST * (1.0 - first.explained_share)
        nearly_all = leaves_as_much and first.overlaps.get(other.name, 0.0) > SPECIAL_CASE_OVERLAP
        if other.name in first.family.contains and is_convincing(other) and (as_much or nearly_all):
            return other
    return None


def are_equivalent(one: Candidate, other: Candidate, dof: int) -> bool:
    """Whether two candidates explain the same part of a residual about equally well.

    Their fits differ by less than noise decides, so that only their priors would. A special case of the other one is
    not: that nothing of the rest shows speaks for it.

    Args:
        dof: degrees of freedom of the residual.
    """
    if not one.members or not other.members:
        return False
    better, worse = sorted((one, other), key=lambda candidate: -candidate.log_evidence)
    unneeded = PARAMETER_COST * max(worse.determined - better.determined, 0.0)
    near = better.log_evidence - worse.log_evidence < EQUIVALENT_LOG_BAYES_FACTOR + unneeded
    if is_simpler(better, worse):
        return False
    if better.family.finer is not None and not worse.family.sparse:  # the best of many constants: others come near
        return near and better.overlaps.get(worse.name, 0.0) > SPECIAL_CASE_OVERLAP
    if better.overlaps.get(worse.name, 0.0) < EQUIVALENT_OVERLAP or better.name in worse.family.contains:
        return False
    rest = sorted((max(1.0 - one.explained_share, 1e-300), max(1.0 - other.explained_share, 1e-300)))
    same_fit = dof * np.log(rest[1] / rest[0]) < 2.0 * MIN_LOG_BAYES_FACTOR
    return bool(are_aligned(one, other) and near and rest[1] < EQUIVALENT_REST * rest[0] and same_fit)


def are_aligned(one: Candidate, other: Candidate) -> bool:
    """Whether two candidates explain the same part of a residual, up to its size."""
    size = float(one.explained @ one.explained) * float(other.explained @ other.explained)
    return float(one.explained @ other.explained) ** 2 > EQUIVALENT_ALIGNMENT * size > 0.0


def is_simpler(better: Candidate, worse: Candidate) -> bool:
    """Whether a candidate leads by explaining with a single number what another one needs several for.

    What the others would do is not there: that speaks for the single one, and is no matter of its prior.
    """
    leads = better.log_evidence - worse.log_evidence > MIN_LOG_BAYES_FACTOR
    return leads and len(better.values) == 1 and better.determined + FEWER_PARAMETERS < worse.determined


def is_tied(own: Candidate, rival: Candidate) -> bool:
    """Whether a rival explains the same as an effect's part on one joint, by no more than a little less.

    Both may be the cause. A rival of one law with a grid of constants comes near its best fit only, and may be further
    behind.
    """
    behind = EQUIVALENT_LOG_BAYES_FACTOR if rival.family.finer is not None else MIN_LOG_BAYES_FACTOR
    if is_simpler(own, rival):
        return False
    return are_aligned(own, rival) and rival.log_evidence > own.log_evidence - behind


def led_rivals(best: Candidate, screening: Screening) -> tuple[Candidate, ...]:
    """The few next candidates that a candidate leads, and that could explain what it explains."""
    rivals = [
        c
        for c in screening.candidates
        if best.overlaps.get(c.name, 0.0) > MIN_CONFOUNDED_OVERLAP
        and best.log_evidence - c.log_evidence > MIN_LOG_BAYES_FACTOR
        and c.members
        and c.log_evidence > 0.0
    ]
    return tuple(rivals[:_RIVALS])


def can_stand_for(best: Candidate, others: Sequence[Candidate], dof: int) -> bool:
    """Whether the best candidate may represent all other effects of its confounded set in the model."""
    return all(other.name in best.family.confounded_with or are_equivalent(best, other, dof) for other in others)


def equivalent_to(name: str, screening: Screening | None) -> tuple[str, ...]:
    """Names of the candidate effects of a screening that are equivalent to a given one."""
    one = next((c for c in screening.candidates if c.name == name), None) if screening is not None else None
    if screening is None or one is None:
        return ()
    dof = screening.projected.dof
    return tuple(c.name for c in screening.candidates if c is not one and are_equivalent(one, c, dof))


def untestable_names(untestable: Sequence[Untestable]) -> tuple[str, ...]:
    """Names of the effects that this dataset cannot test, except those that no dataset can test (scanner scale)."""
    return tuple(family.name for family in untestable if not family.never)


def predicts_worse(before: Calibration, after: Calibration, *, scatter: float = MAX_WORSENING) -> bool:
    """Whether a new fit failed, or predicts the test poses worse than the earlier fit by more than their scatter.

    Paired over test points: the mean change of the squared error against `scatter` standard errors of it. Poses of
    which it is unknown whether they precede or follow a step in the new model test nothing.
    """
    if not after.fit.converged:
        return True
    rows = after.after.is_tested[before.after.pose]
    if rows.sum() < 3:
        return False
    change = np.sum(after.after.error_mm[rows] ** 2, axis=1) - np.sum(before.after.error_mm[rows] ** 2, axis=1)
    if before.averaged is not None:  # repeats of one pose change together
        stand = repeat_groups(before.dataset)[before.after.pose[rows]]
        change = group_means(change, group_numbers(stand), len(np.unique(stand)))
        if len(change) < 3:
            return False
    return bool(change.mean() > scatter * change.std(ddof=1) / np.sqrt(len(change)))


def refusal(
    candidate: Candidate, screening: Screening, before: Calibration, after: Calibration, *, further: bool, strict: bool
) -> Refusal | None:
    """Reason not to add a candidate effect after its trial fit; None where the effect may be added.

    Its size has to be one that such a cause can have. Poses that its fit did not use have to confirm it: a first effect
    may not raise the test poses' error beyond chance, and the error of all poses that were left out, the test poses and
    the training poses one by one, has to fall beyond chance. A further effect stands beside one whose own law may be a
    little off, which leaves pattern enough for a second name: it may not raise the test poses' error at all.

    Args:
        before: the fit that was screened.
        after: the fit with the candidate.
        further: whether an effect was added before.
        strict: whether the test poses' error may not rise at all, be it by chance.
    """
    beyond = beyond_nature(after)
    if beyond:
        return Refusal(candidate.name, "nature", beyond)
    if predicts_worse(before, after, scatter=0.0 if strict else MAX_WORSENING):
        return Refusal(candidate.name, "test poses")
    gain = left_out_gain(before, after)
    helps_nowhere = gain is not None and gain.standard_errors < MIN_GAIN
    if helps_nowhere or (further and candidate.cv_rmse_mm >= screening.cv_rmse_mm):
        return Refusal(candidate.name, "no gain")
    return None


def may_be_curves(best: Candidate, calibration: Calibration, screening: Screening) -> bool:
    """Whether learned curves could have clearly more evidence than the best candidate, if that acts at one place.

    Curves that leave the declared noise alone have nu / 2 log(r^2 / nu) in log evidence, less what they cost.
    """
    if not best.family.sparse:
        return False
    if not calibration.dataset.declares_noise:
        return True
    projected = screening.projected
    total = float(projected.residual @ projected.residual)
    least = min(projected.dof, (1.0 - best.explained_share) * total)
    most = 0.5 * projected.dof * float(np.log(total / max(least, 1e-300))) - MIN_CURVE_EVIDENCE
    return most > best.log_evidence + MIN_LOG_BAYES_FACTOR


def ranking_given_curves(screening: Screening, curves: LearnedCurves | None) -> Screening:
    """Ranking of candidates, without effects of one place or pose if learned curves have clearly more evidence.

    Such a cause follows a part of what the curves follow whole, and would send someone to open a healthy gear.
    """
    least = -np.inf if curves is None else (curves.log_evidence - MIN_LOG_BAYES_FACTOR) / CURVES_SHARE
    kept = tuple(c for c in screening.candidates if not c.family.sparse or c.log_evidence >= least)
    return replace(screening, candidates=kept)


def left_to_curves(screening: Screening, curves: LearnedCurves | None, chosen: Candidate) -> tuple[str, ...]:
    """Effects of one place or pose that learned curves clearly surpass, among those ranked above the chosen one."""
    above = [c for c in screening.candidates if c.family.sparse and c.log_evidence > chosen.log_evidence]
    if not above:
        return ()
    kept = {c.name for c in ranking_given_curves(screening, curves).candidates}
    return tuple(c.name for c in above if c.name not in kept)
