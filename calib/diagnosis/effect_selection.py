"""Effects that are added to the model one by one, each as the screening proposes it: some members, with sizes.

`calibrate(effects=...)` takes whole families with their usual scales. What the diagnosis and the page add is less: the
members that carry an effect here, held by the sizes that the evidence chose for them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.calibration.calibrate import calibrate
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.diagnosis.screening import Candidate, Screening, screen
from calib.effects.catalogue import effects_for, family_of
from calib.effects.effect import Effect, Family, full_name
from calib.errors import CalibError
from calib.options import FitOptions


@dataclass(frozen=True)
class Added:
    """An effect in the model: the members that carry it, and their sizes."""

    name: str
    members: tuple[Effect, ...]
    sizes: Mapping[str, float]  # by full parameter name: the prior's sigma of each

    @classmethod
    def of(cls, candidate: Candidate) -> Added:
        """A candidate as the screening proposes it."""
        return cls(candidate.name, candidate.members, candidate.sizes)


def proposed(screening: Screening | None, name: str) -> Added:
    """The effect as the screening proposes it. Raises CalibError where it is no candidate, or nothing of it shows."""
    ranked = {} if screening is None else {c.name: c for c in screening.candidates}
    if name not in ranked:
        raise CalibError(
            f"effect {name} is not among the candidates: {', '.join(ranked) or 'none is ranked yet'}"
        )
    if not ranked[name].members:
        raise CalibError(
            f"effect {name}: no part of it shows in what is left over, so there is nothing to add"
        )
    return Added.of(ranked[name])


def calibrate_with(
    dataset: Dataset,
    added: Sequence[Added],
    options: FitOptions = FitOptions(),
    *,
    effects: Sequence[Effect] = (),
    start: Calibration | None = None,
) -> Calibration:
    """`calibrate` with these effects in the model, after any whole `effects`; `options` and `start` as there."""
    sizes: dict[str, float] = {}
    for one in added:
        sizes |= one.sizes
    members = [member for one in added for member in one.members]
    return calibrate(dataset, options, effects=[*effects, *members], sizes=sizes, start=start)


@dataclass(frozen=True)
class Addition:
    """A fit of a row of them: what was added last (None: nothing yet), all that is in it, and the fit."""

    name: str | None
    added: tuple[Added, ...]
    calibration: Calibration


def add_in_turn(
    dataset: Dataset,
    names: Sequence[str],
    options: FitOptions = FitOptions(),
    *,
    effects: Sequence[Effect] = (),
    own: Sequence[Family] = (),
) -> tuple[Addition, ...]:
    """The fit without them, then one more for each name: screened after the last fit, added, fitted together.

    Args:
        names: families to add, in this order.
        options: what is asked of every fit.
        effects: in the model from the start, whole.
        own: families beyond the catalogue.

    Raises:
        CalibError: an unknown name, one that these data cannot speak about, or one of which nothing shows.
    """
    families = (*effects_for(dataset), *own)
    for name in names:
        family = family_of(dataset, name, own)
        if family.why_not:
            raise CalibError(f"effect {name} cannot be fitted here: {family.why_not}; {family.would_help}")
    steps = [Addition(None, (), calibrate_with(dataset, (), options, effects=effects))]
    for name in dict.fromkeys(names):
        last = steps[-1]
        added = (*last.added, proposed(screen(last.calibration, families), name))
        fit = calibrate_with(dataset, added, options, effects=effects, start=last.calibration)
        steps.append(Addition(name, added, fit))
    return tuple(steps)


def recalled(dataset: Dataset, name: str, sizes: Mapping[str, float], own: Sequence[Family] = ()) -> Added:
    """An effect as it was added before, by its name and the sizes of its members' parameters.

    Raises CalibError where the dataset has no such effect, no such parameter, or a member is named in part.
    """
    family = family_of(dataset, name, own)
    if family.why_not:
        raise CalibError(f"effect {name} cannot be fitted here: {family.why_not}; {family.would_help}")
    named = [(member, {full_name(member, p) for p in member.parameters}) for member in family.members]
    unknown = sorted(set(sizes).difference(*(names for _, names in named)))
    if unknown:
        raise CalibError(f"effect {name} has no parameter {unknown[0]!r} for this arm")
    wrong = [key for key, size in sizes.items() if not (np.isfinite(size) and size > 0.0)]
    if wrong:
        raise CalibError(f"effect {name}: the size of {wrong[0]} is {sizes[wrong[0]]}; a size is above 0")
    inside = [(member, names) for member, names in named if names & set(sizes)]
    missing = sorted(set().union(*(names for _, names in inside)) - set(sizes))
    if missing or not inside:
        raise CalibError(f"effect {name}: no size for {missing[0] if missing else 'any of its parameters'}")
    members = tuple(member for member, _ in inside)
    return Added(name, members, dict(sizes))
