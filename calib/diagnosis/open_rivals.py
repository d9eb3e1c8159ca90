"""The rivals of a diagnosis that ended open: of each set, which causes could be true, and what cannot be tested."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from calib.calibration.result import Calibration
from calib.diagnosis.findings import Findings, OpenSet
from calib.screening.candidates import Candidate, Screening
from calib.screening.rivals.predictions import Rival


@dataclass(frozen=True)
class Doubt:
    """A set of causes of which one is true, beside a fit."""

    calibration: Calibration  # a rival in its model stands there for the whole set
    rivals: tuple[Rival, ...]
    untested: tuple[str, ...] = ()  # effects that the data lack the means to test
    would_help: str = ""  # what to write down or measure so that they can be tested

    @property
    def names(self) -> tuple[str, ...]:
        """Of all, those that cannot be tested last."""
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
            rival = Rival(
                rival.name, inside.members, inside.prior_sigmas, rival.log_evidence, rival.explained_share
            )
        rivals.append(rival)
    return Doubt(found.calibration, tuple(rivals), opened.untested, opened.would_help)


def _candidates(screening: Screening | None, names: tuple[str, ...]) -> list[Candidate]:
    ranked = () if screening is None else screening.candidates
    return [candidate for candidate in ranked if candidate.name in names]
