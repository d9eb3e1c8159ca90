"""Sets of effects that stay open although one of them is in the model: the data cannot tell them apart.

Exact twins make the same of these poses, so that only the prior would decide between them. Rivals that the data lack
the means to test (effects of load without masses) may be the cause as well. One of the set stands in the model, so that
the error falls and further effects are found beside it; none of the set is claimed.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from calib.diagnosis.decision_rules import twins_of
from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.diagnosis.findings import OpenSet
from calib.diagnosis.search_space import SearchSpace
from calib.screening.candidates import screen


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
        open_with = [f for f in space.families if f.name in family.open_with and not f.never_testable]
        if twins or open_with:
            would_help = next((f.would_help for f in open_with if f.would_help), "")
            out.append(OpenSet(name, twins, tuple(f.name for f in open_with), would_help))
    return tuple(out)


def _twins_beside_all(
    space: SearchSpace, last: FitStep, name: str, twins: tuple[str, ...]
) -> tuple[str, ...]:
    """The twins of an effect beside all others of the model; those of when it was added may have stood in for these."""
    others: list[SelectedEffect] = [effect for effect in last.selected if effect.name != name]
    if not twins or last.selected[-1].name == name or not others:
        return twins
    names = {name, *twins} - {effect.name for effect in others}
    families = [family for family in space.families if family.name in names]
    return twins_of(name, screen(space.fit(others, last.calibration), families))
