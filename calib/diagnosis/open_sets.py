"""Sets of effects that stay open although one of them is in the model: the data cannot tell them apart.

Exact twins make the same of these poses, so that only the prior would decide between them. Rivals that the data lack
the means to test (effects of load without masses) may be the cause as well. One of the set stands in the model, so that
the error falls and further effects are found beside it; none of the set is claimed. Of a tied set, which further poses
may tell apart, none is in the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from calib.calibration.result import Calibration
from calib.diagnosis.decision_rules import twins_of
from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.diagnosis.findings import Findings, OpenSet
from calib.diagnosis.search_space import SearchSpace
from calib.screening.candidates import Candidate, Screening, screen
from calib.screening.rivals.predictions import Rival


def open_sets(space: SearchSpace, steps: Sequence[FitStep]) -> tuple[OpenSet, ...]:
    """The sets that stay open in the last step's model.

    Args:
        space: of the fits.
        steps: from the link errors to the model, effect by effect, each with its screening.
    """
    last = steps[-1]
    out: list[OpenSet] = []
    for before, after in pairwise(steps):
        name = after.effect
        family = None if name is None else space.family(name)
        if name is None or family is None or any(name in found.names for found in out):
            continue
        twins = _twins_beside_all(space, last, name, twins_of(name, before.screening))
        confounded_with = [f for f in space.families if f.name in family.confounded_with and not f.never_testable]
        if twins or confounded_with:
            would_help = next((f.would_help for f in confounded_with if f.would_help), "")
            out.append(OpenSet(name, twins, tuple(f.name for f in confounded_with), would_help))
    return tuple(out)


def _twins_beside_all(space: SearchSpace, last: FitStep, name: str, twins: tuple[str, ...]) -> tuple[str, ...]:
    """The twins of an effect beside all others of the model; those of when it was added may have stood in for these."""
    others: list[SelectedEffect] = [effect for effect in last.selected if effect.name != name]
    if not twins or last.selected[-1].name == name or not others:
        return twins
    names = {name, *twins} - {effect.name for effect in others}
    families = [family for family in space.families if family.name in names]
    return twins_of(name, screen(space.fit(others, last.calibration), families))


@dataclass(frozen=True)
class Doubt:
    """A set of causes of which one is true, beside a fit."""

    calibration: Calibration  # a rival in its model stands there for the whole set
    rivals: tuple[Rival, ...]
    untested: tuple[str, ...] = ()  # effects that the data lack the means to test
    would_help: str = ""  # what to write down or measure so that they can be tested

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all causes of the set, those that cannot be tested last."""
        return (*(rival.name for rival in self.rivals), *self.untested)


def doubts_of(found: Findings) -> tuple[Doubt, ...]:
    """The sets that a diagnosis left open, that of which none is in the model first; () where it left none."""
    out = [_of_open_set(found, opened) for opened in found.open_sets]
    if found.tied and found.screenings:
        tied = _candidates(found.screenings[-1], found.tied)
        out.insert(0, Doubt(found.calibration, tuple(Rival.of(candidate) for candidate in tied)))
    return tuple(out)


def _of_open_set(found: Findings, opened: OpenSet) -> Doubt:
    """A set with one effect in the model: it as it stands there, its twins as they were ranked beside it."""
    before = next((a for a, b in pairwise(found.steps) if b.effect == opened.effect), found.steps[0])
    inside = next(effect for effect in found.steps[-1].selected if effect.name == opened.effect)
    rivals = []
    for candidate in _candidates(before.screening, (opened.effect, *opened.twins)):
        rival = Rival.of(candidate)
        if candidate.name == opened.effect:
            rival = Rival(rival.name, inside.members, inside.prior_sigmas, rival.log_evidence, rival.explained_share)
        rivals.append(rival)
    return Doubt(found.calibration, tuple(rivals), opened.untested, opened.would_help)


def _candidates(screening: Screening | None, names: tuple[str, ...]) -> list[Candidate]:
    ranked = () if screening is None else screening.candidates
    return [candidate for candidate in ranked if candidate.name in names]
