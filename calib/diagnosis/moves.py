"""The next move from a fit and its ranking: an effect to add, one to take out, or why there is none.

The automatic search makes these moves one after the other; the page advises them, one a button. An effect is added
only if its family beats noise (F test with Holm's correction, and the evidence floor), leads the second by more than
`MIN_LEAD` in log evidence, has a size that nature has, and helps at poses that no fit saw. One of one place or one
pose gives way to curves of the joints, a step to a slow course of the same displacement, that say more. What a later
effect explains too is taken out once nothing is left to add.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.calibration.plausibility import beyond_nature, implausibility_reason
from calib.calibration.result import Calibration
from calib.diagnosis.decision_rules import (
    MAX_WORSENING,
    MIN_LOG_EVIDENCE,
    beside_curves,
    can_stand_for,
    is_convincing,
    may_be_curves,
    predicts_worse,
    rank_candidates,
    refusal,
)
from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.diagnosis.findings import Refusal
from calib.diagnosis.search_space import SearchSpace, step_after, with_candidate
from calib.screening.candidates import MIN_LEAD, Candidate, Screening, screen
from calib.screening.curves.slow_courses import slow_course
from calib.screening.curves.smooth_joint_error import LEARNED

MAX_TRIED_AHEAD = 4  # members of a tied set that are tried with a successor
MAX_REFUSED = 3  # effects that are tried in a step

Tell = Callable[[str], None]  # called with a line of words before each stage


@dataclass(frozen=True)
class AddEffect:
    """An effect leads: with it in the model, and the members of those before chosen anew, this is the fit."""

    candidate: Candidate
    lead: float | None  # in log evidence over the next
    runner_up: str  # the next; "" where there is none
    selected: tuple[SelectedEffect, ...]
    calibration: Calibration

    @property
    def name(self) -> str:
        """Name of the effect that is added."""
        return self.candidate.name


@dataclass(frozen=True)
class DropEffect:
    """An effect that the others explain too: without it, this is the fit."""

    name: str
    selected: tuple[SelectedEffect, ...]
    calibration: Calibration


@dataclass(frozen=True)
class Stop:
    """No effect to add, and none to take out."""

    implausible: bool = False  # points and poses do not belong together: no effect is their cause
    ambiguous: tuple[Candidate, ...] = ()  # effects that these data cannot tell apart
    refused: Refusal | None = None  # an effect that the training poses speak for, and something against
    left_to_curves: bool = False  # learned curves say more than the best effect, which is of one place or pose


Move = AddEffect | DropEffect | Stop


def next_move(
    space: SearchSpace, step: FitStep, dropped: Collection[str] = (), tell: Tell = lambda words: None
) -> Move:
    """What to do with a model.

    Args:
        space: of the fits.
        step: the model, with its screening.
        dropped: effects that were taken out as superfluous; they are not added again.
        tell: called before each stage.
    """
    assert step.screening is not None
    names = [effect.name for effect in step.selected]
    if LEARNED in names:  # whatever is found beside curves of all joints was not worth a name without them
        return Stop()
    if implausibility_reason(step.calibration):
        return Stop(implausible=True)
    added = Stop() if len(names) >= space.max_effects else _addition(space, step, dropped, tell)
    if isinstance(added, AddEffect):
        return added
    return _superfluous(space, step, tell) or added


def applied(step: FitStep, move: AddEffect | DropEffect) -> FitStep:
    """The step that a move leads to."""
    if isinstance(move, AddEffect):
        after = step_after(step, move.name, move.selected, move.calibration, move.candidate, move.lead)
        return replace(after, runner_up=move.runner_up)
    return FitStep(f"− {move.name}", move.selected, move.calibration, left_out=step.left_out)


def _addition(
    space: SearchSpace, step: FitStep, dropped: Collection[str], tell: Tell, *, may_refuse: int = MAX_REFUSED
) -> AddEffect | Stop:
    """The effect that is to be added, with its fit, or why there is none.

    Where the best is refused, one that explains less may be the cause that it stood in for: `may_refuse` are tried.
    """
    assert step.screening is not None
    screening = _without(step.screening, dropped)
    if not any(is_convincing(candidate) for candidate in screening.candidates):
        return Stop()
    if may_be_curves(screening.candidates[0], step.calibration, screening):
        screening = beside_curves(screening, step.curves)
        if not any(is_convincing(candidate) for candidate in screening.candidates):
            return Stop(left_to_curves=True)
        first = screening.candidates[0]
        if slow_course(screening.projected, first) > first.log_evidence + MIN_LEAD:
            return Stop(left_to_curves=True)
    best, second, tied = rank_candidates(screening)
    lead = best.log_evidence - second.log_evidence if second is not None else None
    if tied:
        tell(f"looking one step ahead of {', '.join(c.name for c in tied)}")
        ahead = _look_ahead(space, step, tied)
        if ahead is None and not can_stand_for(best, tied[1:], screening.projected.freedom):
            return Stop(ambiguous=tied)
        best, second, lead = ahead or (best, None, None)
    tell(f"adding {best.name}")
    trial = space.fit((*step.selected, SelectedEffect.of(best)), step.calibration)
    refused = refusal(best, screening, step.calibration, trial, further=bool(step.selected))
    if refused is not None:
        rest = {*dropped, best.name}
        other = _addition(space, step, rest, tell, may_refuse=may_refuse - 1) if may_refuse > 1 else Stop()
        return other if isinstance(other, AddEffect) else Stop(refused=refused)
    runner_up = second.name if second is not None else ""
    selected, fitted = with_candidate(space, step, best, trial)
    if predicts_worse(trial, fitted, scatter=MAX_WORSENING) or beyond_nature(fitted):
        selected, fitted = (*step.selected, SelectedEffect.of(best)), trial
    return AddEffect(best, lead, runner_up, selected, fitted)


def _without(screening: Screening, names: Collection[str]) -> Screening:
    kept = tuple(c for c in screening.candidates if c.name not in names)
    return screening if len(kept) == len(screening.candidates) else replace(screening, candidates=kept)


def _look_ahead(
    space: SearchSpace, step: FitStep, tied: Sequence[Candidate]
) -> tuple[Candidate, Candidate, float] | None:
    """Whether one of a tied set leads clearly once the next effect is in too, as when two causes are hidden.

    The evidence of each with its best successor is compared; None where none leads by the margin, or where nothing
    convincing comes after any.
    """
    totals = []
    followed = False
    for candidate in tied[:MAX_TRIED_AHEAD]:
        trial = space.fit((*step.selected, SelectedEffect.of(candidate)), step.calibration)
        following = [c for c in space.screen(trial).candidates if is_convincing(c)]
        followed |= bool(following)
        totals.append(candidate.log_evidence + (following[0].log_evidence if following else 0.0))
    order = np.argsort(totals)[::-1]
    lead = totals[order[0]] - totals[order[1]]
    best, second = tied[int(order[0])], tied[int(order[1])]
    return (best, second, float(lead)) if followed and lead > MIN_LEAD else None


def _superfluous(space: SearchSpace, step: FitStep, tell: Tell) -> DropEffect | None:
    """The weakest effect beside all others, where they explain what it does."""
    if len(step.selected) < 2:
        return None
    evidence, fits = [], []
    for effect in step.selected:
        others = tuple(other for other in step.selected if other is not effect)
        family = space.family(effect.name)
        fits.append(space.fit(others, step.calibration))
        found = () if family is None else screen(fits[-1], [family]).candidates
        evidence.append(found[0].log_evidence if found else -np.inf)
    weakest = int(np.argmin(evidence))
    if evidence[weakest] > MIN_LOG_EVIDENCE:
        return None
    tell("dropping what a later effect made superfluous")
    kept = tuple(effect for k, effect in enumerate(step.selected) if k != weakest)
    return DropEffect(step.selected[weakest].name, kept, fits[weakest])
