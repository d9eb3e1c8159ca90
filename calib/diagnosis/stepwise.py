"""Stepwise selection of missing effects: fit, screen, add the best, fit again, until no candidate is convincing.

A candidate is added only if its family beats noise (F test with Holm's correction, and the evidence floor), leads the
second by more than `MIN_LEAD` in log evidence, has no less evidence than a dent or a slip of one joint, and does not
make the test poses worse.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.calibration.plausibility import implausibility_reason
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.diagnosis.decision_rules import (
    MIN_LEAD,
    MIN_LOG_EVIDENCE,
    is_convincing,
    is_refused,
    leading_fault,
    rank_candidates,
)
from calib.diagnosis.effect_selection import FitStep, SelectedEffect, calibrate_with, first_step
from calib.effects.effect import Effect, Family
from calib.options import FitOptions
from calib.screening.candidates import Candidate, Screening, screen
from calib.screening.fault_models import JointFault

MAX_TRIED_AHEAD = 4  # members of a tied set that are tried with a successor

Tell = Callable[[str], None]  # called with a line of words before each stage


@dataclass(frozen=True)
class SearchSpace:
    """What every fit and every screening of a search has in common."""

    dataset: Dataset
    options: FitOptions  # asked of every fit
    given: tuple[Effect, ...]  # taken as present from the start
    families: tuple[Family, ...]  # that may be missing

    def fit(self, chosen: Sequence[Candidate], start: Calibration | None) -> Calibration:
        """The given and the chosen effects fitted together, going on from an earlier fit."""
        selected = [SelectedEffect.of(candidate) for candidate in chosen]
        return calibrate_with(self.dataset, selected, self.options, effects=self.given, start=start)

    def screen(self, calibration: Calibration) -> Screening:
        """Every family that is not in a fit's model, tested against what that fit leaves over."""
        return screen(calibration, self.families)


@dataclass(frozen=True)
class Search:
    """How far a search has come, and, once it has ended, why it went no further."""

    steps: tuple[FitStep, ...]
    screenings: tuple[Screening, ...]  # one a step
    chosen: tuple[Candidate, ...] = ()  # in the last step's model
    ended: bool = False
    implausible: bool = False  # points and poses do not belong together: no effect is their cause
    ambiguous: tuple[str, ...] = ()  # effects that these data cannot tell apart
    refused: str = ""  # an effect that makes the test poses worse
    leading_fault: JointFault | None = (
        None  # a fault outside the catalogue with more evidence than any effect
    )

    @property
    def calibration(self) -> Calibration:
        """The last fit."""
        return self.steps[-1].calibration

    def extended(
        self, added: Candidate, margin: float | None, chosen: tuple[Candidate, ...],
        calibration: Calibration, screening: Screening,
    ) -> Search:  # fmt: skip
        """One step more, that added a candidate; the members of those before may have changed with it."""
        selected = tuple(SelectedEffect.of(candidate) for candidate in chosen)
        step = FitStep(f"+ {added.name}", selected, calibration, added.name, added, margin)
        steps, screenings = (*self.steps, step), (*self.screenings, screening)
        return replace(self, steps=steps, screenings=screenings, chosen=chosen)


def search_stepwise(space: SearchSpace, *, max_steps: int, tell: Tell) -> Search:
    """Add one effect after the other while one is convincing; drop in the end what a later one made superfluous."""
    tell("fitting the geometry")
    geometry = space.fit((), None)
    search = Search((first_step(geometry),), (space.screen(geometry),))
    if implausibility_reason(geometry):
        return replace(search, ended=True, implausible=True)
    while len(search.chosen) < max_steps and not search.ended:
        search = _next_step(space, search, tell)
    return _without_superfluous(space, search, tell)


def _next_step(space: SearchSpace, search: Search, tell: Tell) -> Search:
    """The search with one effect more, or ended with the reason."""
    screening, before = search.screenings[-1], search.calibration
    if not any(is_convincing(candidate) for candidate in screening.candidates):
        return replace(search, ended=True)
    best, margin, tied = rank_candidates(screening)
    fault = leading_fault(screening)
    if fault is not None:
        return replace(search, ended=True, leading_fault=fault)
    if tied:
        tell(f"looking one step ahead of {', '.join(c.name for c in tied)}")
        ahead = _look_ahead(space, search, tied)
        if ahead is None:
            return replace(search, ended=True, ambiguous=tuple(c.name for c in tied))
        best, margin = ahead
    tell(f"adding {best.name}")
    trial = space.fit((*search.chosen, best), before)
    if is_refused(best, screening, before, trial, further=bool(search.chosen)):
        return replace(search, ended=True, refused=best.name)
    chosen, calibration = _revised(space, (*search.chosen, best), trial, before)
    return search.extended(best, margin, chosen, calibration, space.screen(calibration))


def _look_ahead(
    space: SearchSpace, search: Search, tied: Sequence[Candidate]
) -> tuple[Candidate, float] | None:
    """Whether one of a tied set leads clearly once the next effect is in too, as when two causes are hidden.

    The evidence of each with its best successor is compared; None where none leads by the margin, or where nothing
    convincing comes after any.
    """
    totals = []
    followed = False
    for candidate in tied[:MAX_TRIED_AHEAD]:
        after = space.screen(space.fit((*search.chosen, candidate), search.calibration)).candidates
        following = [c for c in after if is_convincing(c)]
        followed |= bool(following)
        totals.append(candidate.log_evidence + (following[0].log_evidence if following else 0.0))
    order = np.argsort(totals)[::-1]
    lead = totals[order[0]] - totals[order[1]]
    return (tied[int(order[0])], float(lead)) if followed and lead > MIN_LEAD else None


def _revised(
    space: SearchSpace, chosen: tuple[Candidate, ...], fitted: Calibration, start: Calibration
) -> tuple[tuple[Candidate, ...], Calibration]:
    """Earlier effects with the members that show now, and the fit: some had not shown beside a cause not yet in.

    Args:
        fitted: the fit of `chosen`.
        start: that the fits go on from.
    """
    out = list(chosen)
    for k in range(len(out) - 1):
        found = screen(space.fit((*out[:k], *out[k + 1 :]), start), [out[k].family]).candidates
        if found and found[0].members and found[0].members != out[k].members:
            out[k] = found[0]
    if all(now is before for now, before in zip(out, chosen, strict=True)):
        return chosen, fitted
    return tuple(out), space.fit(out, start)


def _without_superfluous(space: SearchSpace, search: Search, tell: Tell) -> Search:
    """The search without the effects that a later one made superfluous, the fits of the others done again."""
    kept = _still_needed(space, search)
    if len(kept) == len(search.chosen):
        return search
    tell("dropping what a later effect made superfluous")
    margins = {step.effect: step.log_evidence_margin for step in search.steps}
    calibration = search.calibration
    search = replace(search, steps=search.steps[:1], screenings=search.screenings[:1], chosen=())
    for k, candidate in enumerate(kept):
        calibration = space.fit(kept[: k + 1], calibration)
        screening = space.screen(calibration)
        search = search.extended(candidate, margins[candidate.name], kept[: k + 1], calibration, screening)
    return search


def _still_needed(space: SearchSpace, search: Search) -> tuple[Candidate, ...]:
    """Each effect judged beside all others: what a later one explains too is dropped, the weakest first."""
    kept = list(search.chosen)
    while len(kept) > 1:
        evidence = []
        for one in kept:
            others = [other for other in kept if other is not one]
            found = screen(space.fit(others, search.calibration), [one.family]).candidates
            evidence.append(found[0].log_evidence if found else -np.inf)
        weakest = int(np.argmin(evidence))
        if evidence[weakest] > MIN_LOG_EVIDENCE:
            break
        del kept[weakest]
    return tuple(kept)
