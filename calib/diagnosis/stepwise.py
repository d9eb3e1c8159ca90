"""Stepwise selection of missing effects: the moves of `calib.diagnosis.moves`, one after the other, to the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.diagnosis.moves import AddEffect, Stop, Tell, applied, next_move
from calib.diagnosis.search_space import SearchSpace, first_fit, step_after


@dataclass(frozen=True)
class Search:
    """How a model was built, each step with its screening, and why it went no further."""

    steps: tuple[FitStep, ...]
    stop: Stop


def search_stepwise(space: SearchSpace, tell: Tell, refused: str = "", first: FitStep | None = None) -> Search:
    """Add one effect after the other while one is convincing, but not the `refused` one; take out superfluous ones.

    first: the fit to begin with, where it was made already.
    """
    if first is None:
        tell("fitting the geometry")
        first = first_fit(space)
    steps = [space.ranked(first)]
    dropped = [refused]
    while not isinstance(move := next_move(space, steps[-1], dropped, tell), Stop):
        if not isinstance(move, AddEffect):
            dropped.append(move.name)
        steps.append(space.ranked(applied(steps[-1], move)))
    return Search(way_to(space, steps), move)


def way_to(space: SearchSpace, steps: Sequence[FitStep]) -> tuple[FitStep, ...]:
    """The last model effect by effect, each step with its screening; fits are done again where steps went astray."""
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
                log_evidence_margin=added.log_evidence_margin,
                runner_up=added.runner_up,
            )
        out.append(space.ranked(replace(step, screening=last.screening if is_last else None)))
    return tuple(out)


def _is_straight(steps: Sequence[FitStep]) -> bool:
    """Whether each step adds one effect to those of the step before, from none on."""

    def names(selected: Sequence[SelectedEffect]) -> list[str]:
        return [effect.name for effect in selected]

    return not steps[0].selected and all(
        names(after.selected) == [*names(before.selected), after.effect] for before, after in pairwise(steps)
    )
