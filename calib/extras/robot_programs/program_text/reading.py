"""Targets of a program by the motions to them: their tools and work frames, and what the arm does before.

What is the same in all languages is found here: assignments, branches, loops, routines and calls, and which literals
the motions go to. A language's reader tells what a literal's numbers are, which statements move the arm, and where
frames are set.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import ClassVar, Literal

from calib.extras.robot_programs.program_text.flow import FlowEvent, FlowKind, Values, reaching
from calib.extras.robot_programs.program_text.source import Item, Part, Source, Statement, Syntax
from calib.extras.robot_programs.program_text.targets import (
    UNKNOWN_PLACE,
    Arrival,
    NamedFrame,
    ProgramTarget,
    SkippedLiteral,
)
from calib.rendering import numbers

COMPUTED = "?"  # a variable, or the index of an array, that the program computes
_STANDS = re.compile(r"\s*[+-]?0*\.?0*\s*|\s*9e\+?0?9\s*", re.IGNORECASE)  # an external axis at 0, or none
_DECLARES = ("ext", "extfct", "extfctp")  # routines of other files


@dataclass(frozen=True)
class Assignment:
    """A value that is given to a variable, or to a part of it."""

    place: int
    name: str
    index: str
    component: str
    before: tuple[str, ...]  # words in front of the variable: of a declaration, or of a motion
    value: Item


@dataclass(frozen=True)
class Aim:
    """What an expression stands for: a variable, or the brackets of a literal."""

    place: int
    variable: str = COMPUTED  # "" for a literal
    element: str = ""
    literal: Part | None = None
    frame: Item | None = None  # behind which a pose stands
    near: tuple[float, ...] = ()  # joints to which those at the place are to be the nearest
    is_joint: bool = False  # whether joints at the place are asked for


@dataclass(frozen=True)
class Visit:
    """A motion to a target."""

    aim: Aim
    motion: str = ""  # its name
    is_joint: bool = False  # the posture at its end is not that of its start
    keeps: bool = False  # the target's configuration does not count
    tool: NamedFrame | None = None  # where the motion itself tells it
    work: NamedFrame | None = None
    reason: str = ""  # why its target is left


@dataclass(frozen=True)
class Held:
    """Who has a literal: a variable, the element of an array, or a motion, which has no variable."""

    aim: Aim
    literal: Part
    name: str = ""
    variable: str = ""
    element: str = ""
    by: Assignment | None = None


@dataclass(frozen=True)
class Told:
    """What a literal and its language tell of a target."""

    target: ProgramTarget  # without its numbers
    items: Sequence[Item]  # of the numbers
    external: Sequence[Item] = ()  # of the values of external axes
    is_kept: bool = False  # whether it is a target where no motion is seen
    reason: str = ""  # why it is left, though the arm goes there


FrameKind = Literal["tool", "work"]
KINDS: tuple[FrameKind, FrameKind] = ("tool", "work")


class ProgramReader(ABC):
    """A program's targets, and what looks like one and is left. Class attributes tell what a language is made of."""

    language: ClassVar[str]
    syntax: ClassVar[Syntax]
    assigns: ClassVar[str] = "="  # sign of an assignment
    index: ClassVar[str] = "[]"  # brackets of an array's index
    first_index: ClassVar[int] = 1
    blocks: ClassVar[Mapping[str, FlowKind]]  # words that begin and end blocks
    then: ClassVar[str] = ""
    """Word without which an IF ends with its statement. Where there is one, blocks begin anywhere in a statement, and
    routines are called by their names alone."""
    top_first: ClassVar[bool] = False  # as of `reaching`
    units: ClassVar[Mapping[str, float]] = MappingProxyType({})  # as of `Source.numbers`

    def __init__(self, source: Source) -> None:
        self.source = source
        self.notes: list[str] = []
        self.assignments: dict[str, list[Assignment]] = {}  # by the variable
        self.changed: dict[str, str] = {}  # reasons why variables are left: what is set is not made of the old value
        self.routines: set[str] = set()
        self.parameters: set[str] = set()
        self._left: list[SkippedLiteral] = []
        for statement in source.statements:
            for item in statement:
                self._read_assignment(item, statement[0].parts if item is not statement[0] else ())
        self._structure = list(self._blocks())
        self.visits = [visit for statement in source.statements for visit in self.moves(statement)]

    @abstractmethod
    def moves(self, statement: Statement) -> Iterable[Visit]:
        """The motions of a statement."""

    @abstractmethod
    def told(self, held: Held) -> Told | str | None:
        """A literal's target, why it is left, or None where it does not look like one."""

    def sets(self, kind: FrameKind) -> Iterable[tuple[int, NamedFrame]]:
        """Places where tools or work frames are set, for visits that do not tell theirs, and the frames."""
        return ()

    def before(self, kind: FrameKind) -> NamedFrame:
        """Tool or work frame at the program's start."""
        return NamedFrame(f"the {'tool' if kind == 'tool' else 'work object'} (the program has no move)", None)

    @property
    def acts(self) -> bool:
        """Whether the program does anything; otherwise it is a list of points."""
        return bool(self.visits)

    def is_changed(self, assignment: Assignment) -> bool:
        """Whether an assignment leaves a target with other numbers than a literal has."""
        return bool(assignment.component)

    def is_literal(self, part: Part) -> bool:
        """Whether brackets hold numbers, or lists of them."""
        return part.bracket not in ("", "(") and not part.text

    def text(self, item: Item | Part) -> str:
        """Text in one line, as the program has it."""
        return self.source.shown(item.start, item.end)

    def name(self, each: Assignment) -> str:
        """Name of a variable, as the program has it where it is set."""
        return self.source.text[each.place : each.place + len(each.name)]

    def _read_assignment(self, item: Item, first: Sequence[Part]) -> None:
        texts = [part.text for part in item.parts]
        k = texts.index(self.assigns) if self.assigns in texts else 0
        if not k or "\\" in texts[:k]:  # an argument by its name
            return
        at = k - 2 if texts[k - 1].startswith(".") and k > 1 else k - 1
        part = item.parts[at]
        name, _, component = part.text.partition(".")
        index = "".join(self.text(each) for each in part.items)
        value, before = item.behind(k + 1), (*(each.text for each in first), *texts[:at])
        each = Assignment(part.start, name, index, component or "".join(texts[at + 1 : k]), before, value)
        self.assignments.setdefault(name, []).append(each)
        if self.is_changed(each) and name not in {word.text.partition(".")[0] for word in value.deep()}:
            what = self.source.shown(part.start, item.parts[k - 1].end)
            self.changed.setdefault(name, f"{self.source.at_line(part.start)} sets {what} anew")

    def _blocks(self) -> Iterable[FlowEvent]:
        """The program's routines, branches, loops and calls."""
        heads: set[int] = set()
        for statement in self.source.statements:
            parts = [part for part in statement[0].parts if part.text != "global"]
            for k, part in enumerate(parts if self.then else parts[:1]):
                kind = self.blocks.get(part.text)
                name = ""
                if kind == "routine" and k + 1 < len(parts):
                    head = next((each for each in parts[k + 1 :] if each.bracket == "("), parts[k + 1])
                    heads.add(head.start)
                    name = head.text
                    self.routines.add(name)
                    self.parameters |= {each.text for item in head.items for each in item.deep()}
                if kind is not None:
                    yield FlowEvent(part.start, kind, name)
                if kind == "if" and self.then not in ("", *(each.text for each in parts[k:])):
                    yield FlowEvent(statement[-1].end, "end")
        for part, statement in self.source.parts:
            is_call = part.text in self.routines and (part.bracket == "(" or bool(self.then))
            if is_call and part.start not in heads and statement[0].parts[0].text not in _DECLARES:
                yield FlowEvent(part.start, "call", part.text)

    def aim(self, item: Item) -> Aim:
        """What an expression stands for."""
        place = item.parts[0].start if item.parts else item.start
        if len(item.parts) != 1:
            return Aim(place)
        (part,) = item.parts
        if part.is_word:
            return Aim(place, part.text)
        if part.text and part.bracket == self.index[0] and len(part.items) == 1:
            index = self.text(part.items[0])
            return Aim(place, part.text, index if index.isdigit() else COMPUTED)
        return Aim(place, "", literal=part) if self.is_literal(part) else Aim(place)

    def _held(self) -> Iterable[Held]:
        """The literals that motions go to, and those that variables hold, elements of arrays too."""
        yield from (Held(v.aim, v.aim.literal, v.motion) for v in self.visits if v.aim.literal is not None)
        for each in (one for every in self.assignments.values() for one in every):
            whole = self.aim(each.value)
            elements = () if whole.literal is None else enumerate(whole.literal.items, self.first_index)
            for index, aim in ((each.index, whole), *((str(k), self.aim(item)) for k, item in elements)):
                if aim.literal is not None:
                    yield Held(
                        aim, aim.literal, self.name(each) + index.join(self.index) * bool(index), each.name, index, each
                    )

    def targets(self) -> tuple[tuple[ProgramTarget, ...], tuple[SkippedLiteral, ...], tuple[str, ...]]:
        """Targets with their frames and arrivals, what is left, and remarks on the whole."""
        held = {each.literal.start: each for each in reversed(list(self._held()))}
        found: list[tuple[ProgramTarget, Held, Told]] = []
        external: list[int] = []
        for part, _ in self.source.parts:
            if part.start >= self.source.own_end or not self.is_literal(part):
                continue
            by = held.get(part.start, Held(Aim(part.start), part))
            told = self.told(by)
            if isinstance(told, Told) and not by.name:
                told = "an argument or part of an expression"
            values = self.source.numbers(told.items, self.units) if isinstance(told, Told) else told
            if isinstance(values, str):
                self._leave(part.start, by.name or self.text(part), values)
            elif isinstance(told, Told) and values is not None:
                line = self.source.line(part.start)
                target = replace(told.target, name=by.name, line=line, numbers=values, place=part.start)
                found.append((target, by, told))
                if not all(_STANDS.fullmatch(self.text(item)) for item in told.external):
                    external.append(line)
        targets = tuple(self._settled(found))
        if external:
            where = f"line {numbers.in_short(external, 1)}"
            note = f"external axes move ({where}): the arm's base is taken to stand, which is wrong where they carry it"
            self.notes.append(note)
        return targets, tuple(sorted(self._left, key=lambda each: each.line)), tuple(self.notes)

    def _leave(self, place: int, what: str, reason: str) -> None:
        self._left.append(SkippedLiteral(self.source.line(place), what, reason))

    def _settled(self, found: Sequence[tuple[ProgramTarget, Held, Told]]) -> Iterable[ProgramTarget]:
        """The targets with their frames and arrivals; those that are left are kept with the reason."""
        by_aim: dict[str | int, list[Visit]] = {}
        for visit in self.visits:
            by_aim.setdefault(visit.aim.variable or visit.aim.place, []).append(visit)
        to: dict[int, list[Visit]] = {}  # motions to each target, by its place
        goals: dict[int, list[int]] = {}  # places of the targets of each motion, by its place
        for target, held, _ in found:
            to[target.place] = [
                visit
                for visit in by_aim.get(held.variable or target.place, [])
                if visit.aim.element in ("", COMPUTED, held.element) or not held.element
            ]
            for visit in to[target.place]:
                goals.setdefault(visit.aim.place, []).append(target.place)
        ends: list[tuple[int, int]] = []  # on the way to a place that is not known a kept posture stays
        for visit in self.visits:
            ends_at = goals.get(visit.aim.place, [])
            if len(ends_at) == 1 or visit.is_joint:
                ends.append((visit.aim.place, ends_at[0] if len(ends_at) == 1 else UNKNOWN_PLACE))
        after = self._reaching(UNKNOWN_PLACE, ends)
        for visit in self.visits:
            if visit.aim.element == COMPUTED:  # any element may be the one before
                after[visit.aim.place] = frozenset([UNKNOWN_PLACE])
        tools, works = (self._reaching(self.before(kind), self.sets(kind)) for kind in KINDS)
        for target, held, told in found:
            own = to[target.place]
            reasons = self.changed.get(held.variable, ""), told.reason, *(visit.reason for visit in own)
            reason = next(filter(None, reasons), "")
            if held.variable in self.parameters:
                reason = "a routine of the program has a parameter of its name"
            elif not reason and self.acts and not own and not told.is_kept:
                reason = "no motion of the program uses it"
            if not reason and target.kind == "pose":
                of_tools = [target.tool] if target.tool else [v.tool or f for v in own for f in tools[v.aim.place]]
                of_works = [target.work] if target.work else [v.work or f for v in own for f in works[v.aim.place]]
                tool, reason = _only("tools", of_tools or [self.before("tool")])
                work, several = _only("work frames", of_works or [self.before("work")])
                reason = reason or several
                target = replace(
                    target,
                    tool=tool,
                    work=work,
                    near=target.near or next((visit.aim.near for visit in own if visit.aim.near), ()),
                    keeps_posture=bool(own) and all(visit.keeps for visit in own),
                    arrivals=tuple(Arrival(visit.is_joint, after[visit.aim.place]) for visit in own),
                )
            if reason:
                self._leave(target.place, target.name, reason)
            else:
                yield target

    def _reaching(self, before: Hashable, sets: Iterable[tuple[int, Hashable]]) -> dict[int, Values]:
        """Which of several values, set at places, may hold before each motion, by its place."""
        uses: list[FlowEvent] = [FlowEvent(visit.aim.place, "use") for visit in self.visits]
        events = [FlowEvent(place, "set", value=value) for place, value in sets]
        return reaching([*self._structure, *uses, *events], before, top_first=self.top_first)


def _only(what: str, found: Iterable[NamedFrame]) -> tuple[NamedFrame, str]:
    """The one frame that all motions to a target have, or why there are several."""
    frames = sorted({*found}, key=lambda each: each.name)
    if len(frames) == 1:
        return frames[0], ""
    return frames[0], f"it is used with several {what}, {frames[0].name} and {frames[1].name}; write a target for each"
