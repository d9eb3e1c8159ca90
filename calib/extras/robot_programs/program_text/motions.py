"""Targets of a program by the motions to them: their tools and work frames, and what the arm does before.

A reader of a language finds literals (numbers that may be a target) and visits (motions to them); what follows from
both is found here, the same in all languages.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Never

from calib.extras.robot_programs.program_text.flow import FlowEvent, reaching
from calib.extras.robot_programs.program_text.source import (
    UNKNOWN_PLACE,
    Arrival,
    NamedFrame,
    ProgramTarget,
    SkippedLiteral,
)

COMPUTED = "?"  # index of an array that the program computes


@dataclass(frozen=True)
class Literal:
    """A target as it was read, and the variable that holds it."""

    target: ProgramTarget
    variable: str = ""  # "" for one in a motion
    element: str = ""  # of an array
    tool: NamedFrame | None = None  # where the literal itself tells it
    work: NamedFrame | None = None
    reason: str = ""  # why it is left
    is_kept: bool = False  # whether it is a target where no motion is seen


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


def settled(
    literals: Sequence[Literal],
    visits: Sequence[Visit],
    structure: Sequence[FlowEvent[Never]],
    tools: Frames,
    works: Frames,
    *,
    acts: bool,
    top_first: bool,
) -> tuple[tuple[ProgramTarget, ...], list[SkippedLiteral]]:
    """Targets with their frames and arrivals, and literals that are left with the reason.

    Args:
        literals: as they were read.
        visits: motions of the program.
        structure: its branches, loops, routines and calls.
        tools: where tools are set, for visits that do not tell theirs.
        works: where work frames are set.
        acts: whether the program does anything; otherwise it is a list of points.
        top_first: as of `reaching`.
    """
    to = _visits_of(literals, visits)
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
    left: list[SkippedLiteral] = []
    for literal in literals:
        target, own = literal.target, to[literal.target.place]
        reason = literal.reason or next((visit.reason for visit in own if visit.reason), "")
        if not reason and acts and not own and not literal.is_kept:
            reason = "no motion of the program uses it"
        if not reason and target.kind == "pose":
            of_tools = [literal.tool] if literal.tool else _frames(own, tool_at, tools.before, [v.tool for v in own])
            of_works = [literal.work] if literal.work else _frames(own, work_at, works.before, [v.work for v in own])
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
            left.append(SkippedLiteral(target.line, target.name, reason))
        else:
            targets.append(target)
    return tuple(targets), left


def _visits_of(literals: Sequence[Literal], visits: Sequence[Visit]) -> dict[int, list[Visit]]:
    """The visits of each literal, by its place."""
    by_aim: dict[str | int, list[Visit]] = {}
    for visit in visits:
        by_aim.setdefault(visit.variable or visit.place, []).append(visit)
    return {
        literal.target.place: [
            visit
            for visit in by_aim.get(literal.variable or literal.target.place, [])
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
    own: Sequence[Visit], at: dict[int, frozenset[NamedFrame]], before: NamedFrame, told: Sequence[NamedFrame | None]
) -> list[NamedFrame]:
    found = [
        frame
        for visit, of_visit in zip(own, told, strict=True)
        for frame in ([of_visit] if of_visit is not None else sorted(at[visit.place], key=lambda each: each.name))
    ]
    return list(dict.fromkeys(found)) or [before]


def _several(what: str, frames: Sequence[NamedFrame]) -> str:
    if len(frames) == 1:
        return ""
    return f"it is used with several {what}, {frames[0].name} and {frames[1].name}; write a target for each"
