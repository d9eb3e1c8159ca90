"""Targets of a program by the motions to them: their tools and work frames, and what the arm does before.

A reader of a language finds literals (numbers that may be a target) and visits (motions to them); what follows from
both is found here, the same in all languages.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Never

from calib.extras.robot_programs.program_text.flow import FlowEvent, reaching
from calib.extras.robot_programs.program_text.source import (
    NO_CONFIGURATION,
    UNKNOWN_PLACE,
    Arrival,
    Configuration,
    Kind,
    NamedFrame,
    ProgramTarget,
    ProgramTargets,
    SkippedLiteral,
    Source,
    external_axes,
)

COMPUTED = "?"  # index of an array that the program computes


@dataclass(frozen=True)
class Literal:
    """Numbers that may be a target, with what they tell themselves."""

    name: str  # of the variable that holds it, or the instruction in which it stands
    start: int
    end: int
    kind: Kind
    spans: Sequence[tuple[int, int]]  # of its numbers
    variable: str = ""  # that holds it, as visits name it; counts where no motion has the literal itself
    element: str = ""  # of an array
    configuration: Configuration = NO_CONFIGURATION
    near: tuple[float, ...] = ()
    tool: NamedFrame | None = None
    work: NamedFrame | None = None
    reason: str = ""  # why it is left
    is_kept: bool = False  # whether it is a target where no motion is seen
    moves_external: bool = False  # whether its external axes stand elsewhere than at 0


@dataclass(frozen=True)
class Visit:
    """A motion to a target."""

    place: int  # of the target in the motion
    variable: str = ""  # that is gone to; "" for the literal at the place
    element: str = ""
    is_joint: bool = False  # the posture at its end is not that of its start
    keeps: bool = False  # the target's configuration does not count
    near: tuple[float, ...] = ()
    tool: NamedFrame | None = None  # where the motion itself tells it
    work: NamedFrame | None = None
    reason: str = ""  # why its target is left


@dataclass(frozen=True)
class Frames:
    """Where a program sets its tools or work frames."""

    before: NamedFrame  # at its start
    sets: Sequence[FlowEvent[NamedFrame]] = ()


class Reading:
    """The targets of a program as its reader comes to them, and what is left with the reason."""

    def __init__(
        self, source: Source, visits: Sequence[Visit], units: Mapping[str, float] = MappingProxyType({})
    ) -> None:
        """Begin with the program's motions; units as of `Source.numbers`."""
        self._source, self._visits, self._units = source, visits, units
        self._inline = {visit.place for visit in visits if not visit.variable}
        self._found: list[tuple[ProgramTarget, Literal]] = []
        self._left: list[SkippedLiteral] = []
        self._external: list[int] = []  # lines of targets whose external axes stand elsewhere than at 0

    def leave(self, start: int, end: int, reason: str, name: str = "") -> None:
        """Leave what stands between two places, told by its text where it has no name."""
        what = name or self._source.literal(start, end)
        self._left.append(SkippedLiteral(self._source.line(start), what, reason))

    def take(self, literal: Literal) -> None:
        """Take a literal as a target, if its numbers are plain ones."""
        numbers = self._source.numbers(literal.spans, self._units)
        if isinstance(numbers, str):
            self.leave(literal.start, literal.end, numbers)
            return
        inline = literal.start in self._inline
        target = ProgramTarget(
            literal.name, self._source.line(literal.start), literal.kind, numbers, literal.start,
            configuration=literal.configuration, near=literal.near,
        )  # fmt: skip
        self._found.append((target, replace(literal, variable="" if inline else literal.variable)))
        self._external += [target.line] if literal.moves_external else []

    def result(
        self,
        structure: Sequence[FlowEvent[Never]],
        tools: Frames,
        works: Frames,
        *,
        acts: bool,
        top_first: bool,
        notes: Sequence[str] = (),
    ) -> ProgramTargets:
        """Targets with their frames and arrivals, and what is left.

        Args:
            structure: branches, loops, routines and calls of the program.
            tools: where tools are set, for visits that do not tell theirs.
            works: where work frames are set.
            acts: whether the program does anything; otherwise it is a list of points.
            top_first: as of `reaching`.
            notes: remarks on the whole.
        """
        targets = self._settled(structure, tools, works, acts=acts, top_first=top_first)
        notes = (*notes, *external_axes(self._external))
        return ProgramTargets(targets, tuple(sorted(self._left, key=lambda each: each.line)), notes)

    def _settled(
        self, structure: Sequence[FlowEvent[Never]], tools: Frames, works: Frames, *, acts: bool, top_first: bool
    ) -> tuple[ProgramTarget, ...]:
        visits = self._visits
        to = _visits_of([literal for _, literal in self._found], visits)
        goals: dict[int, list[int]] = {}  # by the places of motions
        for place, own in to.items():
            for visit in own:
                goals.setdefault(visit.place, []).append(place)
        uses: list[FlowEvent[Never]] = [FlowEvent(visit.place, "use") for visit in visits]
        posture = [event for visit in visits for event in _arriving(visit, goals.get(visit.place, []))]
        before = reaching([*structure, *posture], UNKNOWN_PLACE, top_first=top_first)
        tool_at, work_at = (
            reaching([*structure, *each.sets, *uses], each.before, top_first=top_first) for each in (tools, works)
        )
        targets: list[ProgramTarget] = []
        for target, literal in sorted(self._found, key=lambda each: each[0].place):
            own = to[target.place]
            reason = literal.reason or next((visit.reason for visit in own if visit.reason), "")
            if not reason and acts and not own and not literal.is_kept:
                reason = "no motion of the program uses it"
            if not reason and target.kind == "pose":
                of_tools = [literal.tool] if literal.tool else _frames(own, tool_at, tools, [v.tool for v in own])
                of_works = [literal.work] if literal.work else _frames(own, work_at, works, [v.work for v in own])
                reason = _several("tools", of_tools) or _several("work frames", of_works)
                target = replace(
                    target,
                    tool=of_tools[0],
                    work=of_works[0],
                    near=target.near or next((visit.near for visit in own if visit.near), ()),
                    keeps_posture=bool(own) and all(visit.keeps for visit in own),
                    arrivals=tuple(Arrival(visit.is_joint, _after(visit, before)) for visit in own),
                )
            if reason:
                self._left.append(SkippedLiteral(target.line, target.name, reason))
            else:
                targets.append(target)
        return tuple(targets)


def _visits_of(literals: Sequence[Literal], visits: Sequence[Visit]) -> dict[int, list[Visit]]:
    """The visits of each literal, by its place."""
    by_aim: dict[str | int, list[Visit]] = {}
    for visit in visits:
        by_aim.setdefault(visit.variable or visit.place, []).append(visit)
    return {
        literal.start: [
            visit
            for visit in by_aim.get(literal.variable or literal.start, [])
            if visit.element == literal.element or "" in (visit.element, literal.element) or visit.element == COMPUTED
        ]
        for literal in literals
    }


def _arriving(visit: Visit, goals: Sequence[int]) -> Iterable[FlowEvent[int]]:
    """The visit itself, and the target at which it leaves the arm; a posture that is kept on the way stays the same."""
    yield FlowEvent(visit.place, "use")
    if len(goals) == 1:
        yield FlowEvent(visit.place, "set", value=goals[0])
    elif visit.is_joint:
        yield FlowEvent(visit.place, "set", value=UNKNOWN_PLACE)


def _after(visit: Visit, before: dict[int, frozenset[int]]) -> frozenset[int]:
    """Places from which a visit may come: of elements that a computed index chooses any may be the one before."""
    unknown = frozenset([UNKNOWN_PLACE])
    return unknown if visit.element == COMPUTED else before.get(visit.place, unknown)


def _frames(
    own: Sequence[Visit], at: dict[int, frozenset[NamedFrame]], frames: Frames, told: Sequence[NamedFrame | None]
) -> list[NamedFrame]:
    found = [
        frame
        for visit, of_visit in zip(own, told, strict=True)
        for frame in ([of_visit] if of_visit is not None else sorted(at[visit.place], key=lambda each: each.name))
    ]
    return list(dict.fromkeys(found)) or [frames.before]


def _several(what: str, frames: Sequence[NamedFrame]) -> str:
    if len(frames) == 1:
        return ""
    return f"it is used with several {what}, {frames[0].name} and {frames[1].name}; write a target for each"
