"""The moves that lead from one model to the next, and the stepwise search that adds and drops effects.

An effect is added only if its family beats noise (F test with Holm's correction, and the evidence floor), leads the
second by more than `MIN_LOG_BAYES_FACTOR`, has a size that nature has, and helps at poses that no fit used. One of one
place or one pose gives way to curves of the joints, a step to a slow course of the same displacement, with more
evidence. What a later effect explains too is dropped once nothing is left to add.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from calib.calibration.plausibility import beyond_nature, implausibility_reason
from calib.calibration.result import Calibration
from calib.diagnosis.decision_rules import (
    EQUIVALENT_LOG_BAYES_FACTOR,
    MAX_WORSENING,
    MIN_LEAD_OVER_TEST,
    MIN_LOG_EVIDENCE,
    SURE_LOG_EVIDENCE,
    are_aligned,
    can_stand_for,
    is_convincing,
    is_tied,
    may_be_curves,
    predicts_worse,
    rank_candidates,
    ranking_given_curves,
    refusal,
)
from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import (
    SearchSpace,
    first_fit,
    reselect_members,
    step_after,
    with_candidate,
    without_one,
)
from calib.diagnosis.verdict import Refusal
from calib.effects.effect import Effect, Family, full_name
from calib.screening.candidates import MIN_CONFOUNDED_OVERLAP, MIN_LOG_BAYES_FACTOR, Candidate, Screening, screening_of
from calib.screening.curves.joint_curves import LearnedCurves
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.projected_residual import project_residual
from calib.screening.residual_tests import is_of_noises_size
from calib.screening.smooth_motions import slow_course

MAX_TRIED_AHEAD = 4  # contenders that are tried with a successor
MOST_BY_MASSES = 25.0  # nats behind the best, up to which doubtful masses may make an effect of load the better one
MAX_REFUSED = 3  # effects that are tried in a step
MAX_PARTS = 3  # joints of an effect whose part another effect may explain better
MIN_OVER_SELECTED = 6.0  # log Bayes factor of an effect over one in the model, from which it takes that one's place
_SURE = 5.0  # sigmas, from which an effect surely acts on a joint

Tell = Callable[[str], None]  # called with a line of text before each stage


@dataclass(frozen=True)
class AddEffect:
    """Move that adds the effect with clearly most evidence; in its fit, earlier effects may change members.

    It may take the place of an effect of the model that explains less, given all others. Where no effect leads, the
    best one is fitted on behalf of all.
    """

    candidate: Candidate
    log_bayes_factor: float | None  # over the next candidate
    runner_up: str  # the next candidate; "" where there is none
    selected: tuple[SelectedEffect, ...]
    calibration: Calibration
    instead_of: str = ""  # the effect whose place it takes
    on_behalf_of: tuple[str, ...] = ()  # effects that may be the cause in its place, which it does not lead

    @property
    def name(self) -> str:
        """Name of the effect that is added."""
        return self.candidate.name


@dataclass(frozen=True)
class DropEffect:
    """Move that drops an effect which is explained by the other effects, with the fit without that effect."""

    name: str
    selected: tuple[SelectedEffect, ...]
    calibration: Calibration


@dataclass(frozen=True)
class LeaveOutPoses:
    """Move that leaves out outlying poses, with the clean diagnosis of the rest."""

    diagnosis: Diagnosis
    poses: tuple[str, ...]  # ids


@dataclass(frozen=True)
class ShapeNoise:
    """Move that replaces the declared noise shape by an estimated one, with the clean diagnosis that results."""

    diagnosis: Diagnosis


@dataclass(frozen=True)
class AddCurves:
    """Move that adds learned curves of joints, with the diagnosis that results."""

    diagnosis: Diagnosis  # with the fit that has them as its last step
    curves: LearnedCurves


Move = AddEffect | DropEffect | LeaveOutPoses | ShapeNoise | AddCurves


@dataclass(frozen=True)
class PartlyConfounded:
    """An effect of the model of which other effects explain the part on each joint as well."""

    effect: str
    others: tuple[str, ...]


@dataclass(frozen=True)
class SearchEnd:
    """End of a search: no effect is to be added or dropped, with the reason."""

    implausible: str = ""  # why points and poses do not belong together, as a clause: no effect is their cause
    refused: Refusal | None = None  # an effect with evidence at the training poses, and something against it
    left_to_curves: bool = False  # learned curves have more evidence than the best effect, of one place or pose
    ties: tuple[PartlyConfounded, ...] = ()


def next_effect(
    space: SearchSpace, step: FitStep, dropped: Collection[str] = (), tell: Tell = lambda line: None
) -> AddEffect | DropEffect | SearchEnd:
    """Move that adds, drops or exchanges an effect of a model, or the end of the search with its reason.

    Args:
        space: settings of all fits.
        step: the model, with its screening.
        dropped: effects that are not to be added, such as those that were dropped before.
        tell: called before each stage.
    """
    assert step.screening is not None
    names = [effect.name for effect in step.selected]
    if LEARNED in names:  # an effect that shows beside curves of all joints was not worth a name without them
        return SearchEnd()
    implausible = implausibility_reason(step.calibration)
    if implausible:
        return SearchEnd(implausible=implausible)
    added = SearchEnd() if len(names) >= space.max_effects else _addition(space, step, dropped, tell)
    if isinstance(added, AddEffect) and not added.on_behalf_of:
        return added
    revised = _revision(space, step, dropped, tell) or _parts_given_up(space, step, dropped, tell)
    if not isinstance(revised, tuple):
        return revised
    return added if isinstance(added, AddEffect) else replace(added, ties=revised)


def dropped_effects(move: AddEffect | DropEffect) -> list[str]:
    """Name of the effect that a move takes out of the model, in a list; an empty one where it takes none out."""
    name = move.name if isinstance(move, DropEffect) else move.instead_of
    return [name] if name else []


def fit_step_after(step: FitStep, move: AddEffect | DropEffect) -> FitStep:
    """Fit step that results from adding or dropping an effect."""
    if isinstance(move, AddEffect):
        after = step_after(step, move.name, move.selected, move.calibration, move.candidate, move.log_bayes_factor)
        return replace(after, runner_up=move.runner_up, on_behalf_of=move.on_behalf_of)
    return FitStep(f"− {move.name}", move.selected, move.calibration, left_out=step.left_out)


# ---- adding and dropping --------------------------------------------------------------------------------------------


def _addition(
    space: SearchSpace, step: FitStep, dropped: Collection[str], tell: Tell, *, may_refuse: int = MAX_REFUSED
) -> AddEffect | SearchEnd:
    """Move that adds the best effect, with its fit, or the end of the search with its reason.

    Where the best is refused, one that explains less may be the cause that it stood in for: `may_refuse` are tried.
    """
    assert step.screening is not None
    screening = _without(step.screening, dropped)
    if is_of_noises_size(step.calibration.dataset, screening.projected):
        sure = tuple(c for c in screening.candidates if c.log_evidence > SURE_LOG_EVIDENCE)
        screening = replace(screening, candidates=sure)
    if not any(is_convincing(candidate) for candidate in screening.candidates):
        return SearchEnd()
    if may_be_curves(screening.candidates[0], step.calibration, screening):
        if not _outweighs_curves_with_a_second(space, step, screening.candidates[0]):
            screening = ranking_given_curves(screening, step.curves)
        if not any(is_convincing(candidate) for candidate in screening.candidates):
            return SearchEnd(left_to_curves=True)
        first = screening.candidates[0]
        if slow_course(screening.projected, first) > first.log_evidence + MIN_LOG_BAYES_FACTOR:
            return SearchEnd(left_to_curves=True)
    screening = _ranked_by_doubtful_masses(space, step, screening)
    best, second, contenders = rank_candidates(screening)
    log_bayes_factor = best.log_evidence - second.log_evidence if second is not None else None
    special = _special_case_with_another(space, step, screening, best)
    if special is not None:
        best, second, log_bayes_factor = special, best, None
    elif contenders:
        tell(f"looking one step ahead of {', '.join(c.name for c in contenders)}")
        ahead = _look_ahead(space, step, contenders)
        if ahead is None and not can_stand_for(best, contenders[1:], screening.projected.dof):
            return _on_behalf_of_all(space, step, screening, contenders)
        best, second, log_bayes_factor = ahead or (best, None, None)
    tell(f"adding {best.name}")
    trial = space.fit((*step.selected, SelectedEffect.of(best)), step.calibration)
    lead = best.log_evidence if log_bayes_factor is None else log_bayes_factor
    strict = bool(step.selected) or lead < MIN_LEAD_OVER_TEST
    refused = refusal(best, screening, step.calibration, trial, further=bool(step.selected), strict=strict)
    if refused is not None:
        rest = {*dropped, best.name}
        other = _addition(space, step, rest, tell, may_refuse=may_refuse - 1) if may_refuse > 1 else SearchEnd()
        return SearchEnd(refused=refused) if isinstance(other, SearchEnd) else _in_place_of(other, best, refused)
    runner_up = second.name if second is not None else ""
    selected, fitted = with_candidate(space, step, best, trial)
    if predicts_worse(trial, fitted, scatter=MAX_WORSENING) or beyond_nature(fitted):
        selected, fitted = (*step.selected, SelectedEffect.of(best)), trial
    return AddEffect(best, log_bayes_factor, runner_up, selected, fitted)


def _ranked_by_doubtful_masses(space: SearchSpace, step: FitStep, screening: Screening) -> Screening:
    """Ranking in which effects of load have the evidence that masses and centres of mass off by their sigmas give them.

    An effect that follows the load by robot.toml's masses leaves their errors to a rival that follows load otherwise.
    One that has another of them as its limit is not given more: what masses do to the limit is no evidence for it.
    """
    best = screening.candidates[0]
    rivals = [
        c
        for c in screening.candidates
        if best.overlaps.get(c.name, 0.0) > MIN_CONFOUNDED_OVERLAP
        and best.log_evidence - c.log_evidence < MOST_BY_MASSES
        and is_convincing(c)
    ]
    near = {c.name: c for c in (best, *rivals)} if rivals else {}
    gains: dict[str, float] = {}
    for one in (c for c in near.values() if near.keys().isdisjoint(c.family.contains)):
        trial = space.fit((*step.selected, SelectedEffect.of(one)), step.calibration)
        doubts = project_residual(trial).nuisance
        gains[one.name] = 0.0 if doubts is None else max(doubts.log_evidence, 0.0)
    if not any(gains.values()):
        return screening
    given = [replace(c, log_evidence=c.log_evidence + gains.get(c.name, 0.0)) for c in screening.candidates]
    return replace(screening, candidates=tuple(sorted(given, key=lambda c: -c.log_evidence)))


def _in_place_of(other: AddEffect, best: Candidate, refused: Refusal) -> AddEffect | SearchEnd:
    """Move that adds another effect than a refused one that explained more; the end where only nature's bounds speak.

    A bound of what such causes are known to be is no evidence for another one: what is clearly worse is not told before
    the refused one's part is explained, and one that explains the same about as well is fitted on behalf of both.
    """
    if refused.why != "nature":
        return other
    clearly_worse = best.log_evidence - other.candidate.log_evidence > EQUIVALENT_LOG_BAYES_FACTOR
    if clearly_worse and not are_aligned(best, other.candidate):
        return SearchEnd(refused=refused)
    alike = best.overlaps.get(other.name, 0.0) > MIN_CONFOUNDED_OVERLAP
    return replace(other, on_behalf_of=(*other.on_behalf_of, best.name)) if alike else other


def _on_behalf_of_all(
    space: SearchSpace, step: FitStep, screening: Screening, contenders: Sequence[Candidate]
) -> AddEffect | SearchEnd:
    """Move that adds the best of the contenders that is not refused, on behalf of all; else the search's end."""
    refusals: list[Refusal] = []
    for one in contenders:
        selected = (*step.selected, SelectedEffect.of(one))
        trial = space.fit(selected, step.calibration)
        refused = refusal(one, screening, step.calibration, trial, further=bool(step.selected), strict=True)
        if refused is None:
            others = tuple(other.name for other in contenders if other is not one)
            return AddEffect(one, None, "", selected, trial, on_behalf_of=others)
        refusals.append(refused)
    return SearchEnd(refused=refusals[0])


def _without(screening: Screening, names: Collection[str]) -> Screening:
    """Screening without some named candidates."""
    kept = tuple(c for c in screening.candidates if c.name not in names)
    return screening if len(kept) == len(screening.candidates) else replace(screening, candidates=kept)


def _look_ahead(
    space: SearchSpace, step: FitStep, contenders: Sequence[Candidate]
) -> tuple[Candidate, Candidate, float] | None:
    """Contender with clearly most evidence once a second effect is added to each, its rival, and the log Bayes factor.

    Two hidden causes may be confounded until both are in the model. The evidence of each contender with its best
    successor is compared; None where none leads, or where nothing convincing comes after any.
    """
    following = [_best_beside(space, step, candidate) for candidate in contenders[:MAX_TRIED_AHEAD]]
    totals = [one.log_evidence + more for one, more in zip(contenders, following, strict=False)]
    order = np.argsort(totals)[::-1]
    log_bayes_factor = totals[order[0]] - totals[order[1]]
    best, second = contenders[int(order[0])], contenders[int(order[1])]
    leads = any(following) and log_bayes_factor > MIN_LOG_BAYES_FACTOR
    return (best, second, float(log_bayes_factor)) if leads else None


def _best_beside(space: SearchSpace, step: FitStep, candidate: Candidate, without: str = "") -> float:
    """Log evidence of the best convincing effect beside a candidate; 0 where nothing convincing comes after it.

    without: an effect that is none of these.
    """
    trial = space.fit((*step.selected, SelectedEffect.of(candidate)), step.calibration)
    after = _without(space.screen(trial), [without]).candidates
    return next((c.log_evidence for c in after if is_convincing(c)), 0.0)


def _special_case_with_another(
    space: SearchSpace, step: FitStep, screening: Screening, best: Candidate
) -> Candidate | None:
    """Special case of the best candidate that leaves it no clear lead, with another effect beside; None for none.

    An effect that has simpler ones as its limits follows two of these at once, in members of its own.
    """
    special = next((c for c in screening.candidates if c.name in best.family.contains and is_convincing(c)), None)
    if special is None:
        return None
    together = special.log_evidence + _best_beside(space, step, special, without=best.name)
    return special if together > best.log_evidence - EQUIVALENT_LOG_BAYES_FACTOR else None


def _outweighs_curves_with_a_second(space: SearchSpace, step: FitStep, first: Candidate) -> bool:
    """Whether an effect of one place or pose has clearly more evidence than curves, once a second effect is beside it.

    Curves follow several causes at once, which the first of them alone does not.
    """
    curves = step.curves
    if curves is None or first.log_evidence > curves.log_evidence:
        return False
    together = first.log_evidence + _best_beside(space, step, first)
    return together > curves.log_evidence + MIN_LOG_BAYES_FACTOR


def _revision(space: SearchSpace, step: FitStep, dropped: Collection[str], tell: Tell) -> AddEffect | DropEffect | None:
    """Move that drops what the other effects explain, or exchanges an effect for a better one; None for neither.

    Each effect is weighed again given all others: it may have been added while another cause was not in the model yet.
    """
    if len(step.selected) < 2:
        return None
    # The last effect led all others when it was added, so that only its own family is screened.
    everything = [True] * (len(step.selected) - 1) + [False]
    weighed = [without_one(space, step, k, everything=every) for k, every in enumerate(everything)]
    evidence = [_evidence(one, effect.name) for one, effect in zip(weighed, step.selected, strict=True)]
    weakest = int(np.argmin(evidence))
    name, without = step.selected[weakest].name, weighed[weakest]
    if evidence[weakest] > MIN_LOG_EVIDENCE:  # members of the others may have been left out because of it
        without = _without_and_anew(space, without, name)
    superfluous = _evidence(without, name) <= MIN_LOG_EVIDENCE
    if superfluous and (evidence[weakest] <= MIN_LOG_EVIDENCE or not _takes_more(step, without)):
        tell("dropping what a later effect made superfluous")
        return DropEffect(name, without.selected, without.calibration)
    for without, own, effect in zip(weighed, evidence, step.selected, strict=True):
        assert without.screening is not None
        rivals = [c for c in _without(without.screening, [*dropped, effect.name]).candidates if is_convincing(c)]
        if rivals and rivals[0].log_evidence > own + MIN_OVER_SELECTED:
            instead = _addition(space, without, dropped, tell)
            if isinstance(instead, AddEffect) and instead.name != effect.name:
                return replace(instead, instead_of=effect.name)
    return None


def _without_and_anew(space: SearchSpace, without: FitStep, name: str) -> FitStep:
    """Step without an effect, the others' members selected anew, and the effect's own family screened again."""
    selected = reselect_members(space, without.selected, without.calibration, len(without.selected))
    fitted = space.fit(selected, without.calibration)
    own = [family for family in space.families if family.name == name]
    return replace(without, selected=selected, calibration=fitted, screening=screening_of(fitted, own))


def _parts_given_up(
    space: SearchSpace, step: FitStep, dropped: Collection[str], tell: Tell
) -> AddEffect | tuple[PartlyConfounded, ...]:
    """Move that gives an effect's part on one joint to another effect that explains it better; else the ties.

    Waves of every joint's gear, say, also follow what gravity does to one of them. Such an effect leads as a whole, and
    leaves nothing to add. An effect of one joint was compared with all others when it was added, but those of one law
    with a grid of constants, a spring's geometry say, come near the best fit only. It is tied where every part is: one
    that surely acts on another joint is the simplest cause of all its parts.
    """
    ties: list[PartlyConfounded] = []
    one_law = [family for family in space.families if family.finer is not None]
    # Of one joint, what acts at one place or from one pose on is no rival: waves were chosen before that.
    lasting = [family for family in space.families if not family.sparse]
    for k, effect in enumerate(step.selected):
        family = space.family(effect.name)
        parts = [] if family is None or family.sparse else _parts(effect, step.calibration)
        rivals_of_part = [*lasting, *one_law] if len(parts) > 1 else one_law
        families = [rival for rival in rivals_of_part if effect.name not in rival.contains]
        tied: list[tuple[str, ...]] = []
        for part in parts if families else []:
            kept = effect.without(part)
            selected = (*step.selected[:k], *([kept] if kept.members else []), *step.selected[k + 1 :])
            fitted = space.fit(selected, step.calibration)
            screening = screening_of(fitted, families)
            rivals = [c for c in _without(screening, dropped).candidates if is_convincing(c)]
            if not rivals:
                continue
            without = FitStep("", selected, fitted, left_out=step.left_out, screening=screening)
            own = screening_of(without.calibration, [Family(f"{effect.name} of one joint", part)]).candidates
            if not own or (kept.members and rivals[0].log_evidence > own[0].log_evidence + MIN_OVER_SELECTED):
                instead = _addition(space, without, dropped, tell)
                if isinstance(instead, AddEffect) and len(selected) < space.max_effects:
                    both = (*selected, SelectedEffect.of(instead.candidate))  # the part is not to come back beside it
                    exchanged = space.fit(both, instead.calibration)
                    if not _leaves_more(step.calibration, exchanged):
                        return replace(instead, selected=both, calibration=exchanged)
            as_good = tuple(rival.name for rival in rivals if own and is_tied(own[0], rival))
            tied += [as_good] if as_good else []
        if tied and len(tied) == len(parts):
            ties.append(PartlyConfounded(effect.name, tuple(dict.fromkeys(name for names in tied for name in names))))
    return tuple(ties)


def _takes_more(before: FitStep, after: FitStep) -> bool:
    """Whether a model determines more parameters than another one, or leaves more."""
    more = project_residual(after.calibration).dof < project_residual(before.calibration).dof
    return more or _leaves_more(before.calibration, after.calibration)


def _leaves_more(before: Calibration, after: Calibration) -> bool:
    """Whether a fit leaves more than another, beyond chance if it is the simpler one: what was exchanged is needed."""
    then, now = project_residual(before), project_residual(after)
    allowed = MIN_LOG_BAYES_FACTOR if now.dof > then.dof else 0.0
    return bool(now.dof * np.log(now.sigma / max(then.sigma, 1e-300)) > allowed)


def _parts(effect: SelectedEffect, calibration: Calibration) -> list[tuple[Effect, ...]]:
    """Members of an effect on each joint where it surely acts, those that are surest first."""
    by_joint: dict[int, list[Effect]] = {}
    for member in effect.members:
        joint = getattr(member, "joint", None)
        if joint is not None:
            by_joint.setdefault(joint, []).append(member)
    distance = {joint: _sigmas_from_zero(members, calibration) for joint, members in by_joint.items()}
    sure = sorted((joint for joint in by_joint if distance[joint] > _SURE), key=lambda joint: -distance[joint])
    return [tuple(by_joint[joint]) for joint in sure[:MAX_PARTS]]


def _sigmas_from_zero(members: Sequence[Effect], calibration: Calibration) -> float:
    """Mahalanobis distance of some members' fitted parameters from zero, over the root of their number."""
    fit = calibration.fit
    names = {full_name(member, parameter) for member in members for parameter in member.parameters}
    rows = [k for k, parameter in enumerate(fit.parameters) if parameter.name in names and not fit.undetermined[k]]
    if not rows:
        return 0.0
    precision = np.linalg.pinv(fit.covariance[np.ix_(rows, rows)], hermitian=True)
    return float(np.sqrt(fit.x[rows] @ precision @ fit.x[rows] / len(rows)))


def _evidence(without: FitStep, name: str) -> float:
    """Log evidence of an effect in the screening of a model without it; -inf where it is no candidate there."""
    candidate = without.candidate_named(name)
    return -np.inf if candidate is None else candidate.log_evidence


# ---- the stepwise search --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Search:
    """Result of a stepwise search: the fit steps with their screenings, and the reason for the stop."""

    steps: tuple[FitStep, ...]
    stop: SearchEnd


def search_stepwise(space: SearchSpace, tell: Tell, refused: str = "") -> Search:
    """Stepwise search from the link errors on: convincing effects are added, superfluous ones dropped.

    refused: an effect that is not to be added; "" for none.
    """
    tell("fitting the geometry")
    steps = [space.ranked(first_fit(space))]
    dropped = [refused]
    while not isinstance(move := next_effect(space, steps[-1], dropped, tell), SearchEnd):
        dropped += dropped_effects(move)
        steps.append(space.ranked(fit_step_after(steps[-1], move)))
    return Search(straight_steps(space, steps), move)


def straight_steps(space: SearchSpace, steps: Sequence[FitStep]) -> tuple[FitStep, ...]:
    """Fit steps that add the last model's effects one by one, refitted where the search had dropped an effect."""
    last = steps[-1]
    if _is_straight(steps) and all(step.left_out == last.left_out for step in steps):
        return tuple(map(space.ranked, steps))
    before = {step.effect: step for step in steps}
    out = [space.ranked(replace(first_fit(space), left_out=last.left_out))]
    for count in range(1, len(last.selected) + 1):
        selected = last.selected[:count]
        added = before.get(selected[-1].name)
        is_last = count == len(last.selected)
        fit = last.calibration if is_last else space.fit(selected, out[-1].calibration)
        step = step_after(out[-1], selected[-1].name, selected, fit)
        if added is not None:
            step = replace(
                step,
                candidate=added.candidate,
                log_bayes_factor=added.log_bayes_factor,
                runner_up=added.runner_up,
                on_behalf_of=added.on_behalf_of,
            )
        out.append(space.ranked(replace(step, screening=last.screening if is_last else None)))
    return tuple(out)


def _is_straight(steps: Sequence[FitStep]) -> bool:
    """Whether the first step has no effect, and each later step adds exactly one effect to the step before."""

    def names(selected: Sequence[SelectedEffect]) -> list[str]:
        return [effect.name for effect in selected]

    return not steps[0].selected and all(
        names(after.selected) == [*names(before.selected), after.effect] for before, after in pairwise(steps)
    )
