"""Targets in RAPID: jointtarget and robtarget literals, with the tool and work object of the moves that use them.

Tools and work objects count as the file defines them (`PERS tooldata tool1:=[...]`); a controller may have other values
of persistent variables by now. What the program assigns anew at run time counts as not defined. Configurations: ABB,
*Technical reference manual, RAPID Instructions, Functions and Data types* (`confdata`).
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import inf
from typing import Never

import numpy as np

from calib.extras.robot_programs.program_text.flow import FlowEvent
from calib.extras.robot_programs.program_text.motions import COMPUTED, Frames, Literal, Reading, Visit
from calib.extras.robot_programs.program_text.pose_numbers import pose_transform
from calib.extras.robot_programs.program_text.source import (
    NO_CONFIGURATION,
    NUMBER,
    Configuration,
    Group,
    Kind,
    NamedFrame,
    ProgramTargets,
    Source,
)

MASKED = re.compile(r"\"[^\"\r\n]*\"?|![^\r\n]*")
_DECLARATION = re.compile(r"\b(?:CONST|PERS|VAR)\s+(\w+)\s+(\w+)\s*(\{[^{};]{0,200}\})?\s*:=\s*", re.IGNORECASE)
_ASSIGNED = re.compile(r"(?<![\w.])([A-Za-z]\w*)\s*(?:\{[^{};]{0,200}\}\s*)?:=$")
_COMPONENT_ASSIGNED = re.compile(r"(?<![\w.\\])([A-Za-z]\w*)(?:\s*\{[^{};]{0,200}\})?\s*(?:\.\s*\w+\s*)*:=")
_MOVE = re.compile(
    r"(?<![\w.:=,(\\])((?:Move(?:AbsJ|[JLC](?:DO|AO|GO|Sync)?)|Trigg[JLC](?:IOs)?|Search[LC]|Arc[LC]\d?(?:Start|End)?"
    r"|Spot(?:M?[JL])|(?:Paint|Disp|Cap|Laser)[LC]|Nut[JL]|FCPress(?:1L|[LC])|ContactL)\b)([^;]{0,3000});",
    re.IGNORECASE,
)
_SIGNAL = re.compile(r"Move(.)(?:DO|AO|GO)", re.IGNORECASE)  # whose last arguments are a signal and its value
_WORK_OBJECT = re.compile(r"\\\s*WObj\s*:=\s*([A-Za-z]\w*)", re.IGNORECASE)
_OFFSET = re.compile(r"\b(Offs|RelTool)\s*\(", re.IGNORECASE)
_NAME = re.compile(r"[A-Za-z]\w*")
_AIM = re.compile(r"(?:(Offs|RelTool)\s*\(\s*)?([A-Za-z]\w*)\s*(?:\{\s*([^{}]*?)\s*\})?", re.IGNORECASE)
_DISPLACED = re.compile(r"\b(PDispOn|PDispSet|EOffsOn|EOffsSet)\b", re.IGNORECASE)
_CONFIGURATION = re.compile(r"\bConf([JL])\s*\\\s*Off\b", re.IGNORECASE)
_ROUTINE = re.compile(r"\b(?:PROC|FUNC\s+\w+)\s+(\w+)\s*\(([^()]*)\)", re.IGNORECASE)
_ROUTINE_END = re.compile(r"\bEND(?:PROC|FUNC)\b", re.IGNORECASE)
_NESTED, _HEAD = 3, 40
_BY_JOINTS = re.compile(r"(?:Move(?:Abs)?|Trigg|Search)J", re.IGNORECASE)
_HELD = ("robtarget", "jointtarget")
_UNUSED_AXIS = 9e8  # as 9E9
_SHAPES: dict[tuple[int, ...], Kind] = {(6, 6): "joints", (3, 4, 4, 6): "pose"}
_BLOCK = re.compile(
    r"\b(?:(PROC|FUNC\s+\w+|TRAP)\s+(\w+)|(IF)\b[^;]*?\bTHEN|(TEST)|(FOR|WHILE)|(ELSEIF|CASE)|(ELSE|DEFAULT)"
    r"|(END(?:PROC|FUNC|TRAP|IF|TEST|FOR|WHILE)))\b",
    re.IGNORECASE,
)
_CALL = re.compile(r"(?:(?<=;)|(?<=\bTHEN)|(?<=\bELSE)|(?<=\bDO)|(?<=\)))\s*([A-Za-z]\w*)\b(?!\s*:)", re.IGNORECASE)


def rapid_targets(source: Source) -> ProgramTargets:
    """Targets of a RAPID module or program. Raises CalibError where brackets do not match."""
    frames = _Frames(source)
    visits = list(_visits(source, frames))
    inline = {visit.place: source.first_word(visit.place) for visit in visits if not visit.variable}
    reading = Reading(source, visits)
    for name, group in frames.definitions:
        reading.leave(group.start, group.end, "the definition of a tool or work object", name)
    counts: dict[str, int] = {}
    for group in source.own_groups:
        shape = _shape(group)
        declaration = frames.declaration_of(group)
        kind_of_data = "" if declaration is None else declaration[1].lower()
        if shape is None or kind_of_data in ("tooldata", "wobjdata"):
            continue
        name, element, wrong = declaration[2] if declaration else inline.get(group.start, ""), "", ""
        if shape not in _SHAPES:
            if group.parent is None and kind_of_data in _HELD and declaration and not declaration[3]:
                reading.leave(group.start, group.end, "its parts are not all plain numbers")
            continue
        if declaration is None and group.start not in inline:
            assigned = _ASSIGNED.search(source.before(group.start))
            name = assigned[1] if assigned and group.parent is None else ""
            wrong = "" if name else "an argument or part of an expression"
        elif declaration is not None and kind_of_data not in _HELD:
            wrong = f"part of a {declaration[1]}"
        elif declaration is not None and declaration[3]:
            counts[name] = counts.get(name, 0) + 1
            element = str(counts[name])
        if wrong:
            reading.leave(group.start, group.end, wrong)
            continue
        is_pose = _SHAPES[shape] == "pose"
        external = ["".join(source.code[a:b].split()) for a, b in group.children[-1].items]
        still = all(NUMBER.fullmatch(each) and not 0.0 < abs(float(each)) < _UNUSED_AXIS for each in external)
        reading.take(
            Literal(
                f"{name}{{{element}}}" if element else name, group.start, group.end, _SHAPES[shape],
                group.children[0].items + (group.children[1].items if is_pose else []), name.lower(), element,
                _configuration(source, group.children[2]) if is_pose else NO_CONFIGURATION,
                reason=frames.replaced.get(name.lower(), ""), is_kept=not is_pose, moves_external=not still,
            )
        )  # fmt: skip
    unknown = (Frames(NamedFrame(f"the {what} (the program has no move)", None)) for what in ("tool", "work object"))
    displaced, notes = _DISPLACED.search(source.code), []
    if displaced is not None:
        where = source.at_line(displaced.start())
        notes = [f"{displaced[1]} in {where} displaces targets: they are corrected where they stand without it"]
    return reading.result(list(_structure(source)), *unknown, acts=bool(visits), top_first=False, notes=notes)


def _shape(group: Group) -> tuple[int, ...] | None:
    """Counts of numbers in the lists that a list consists of; None for other lists."""
    lists = group.children
    if group.bracket != "[" or any(child.bracket != "[" for child in lists):
        return None
    if len(lists) < 2 or (len(lists) != len(group.commas) + 1 and group.parent is not None):
        return None
    return tuple(len(child.items) for child in lists)


class _Frames:
    """Tools and work objects that a program defines, and the variables that it sets anew."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._declared = list(_DECLARATION.finditer(source.code))
        self._starts = [match.start() for match in self._declared]
        self.replaced: dict[str, str] = {}  # reasons why variables are left whose value is not made of the old one
        changed = self._read_assignments()
        self._known: dict[str, NamedFrame | str] = {name: NamedFrame(name, np.eye(4)) for name in ("tool0", "wobj0")}
        self.definitions: list[tuple[str, Group]] = []
        for group in source.groups:
            declaration = self.declaration_of(group) if group.parent is None and group.bracket == "[" else None
            kind = "" if declaration is None else declaration[1].lower()
            if declaration is None or kind not in ("tooldata", "wobjdata"):
                continue
            name = declaration[2]
            value = _frame(source, group, kind)
            frame = value if isinstance(value, str) else NamedFrame(name, None if name.lower() in changed else value)
            known = self._known.setdefault(name.lower(), frame)
            self._known[name.lower()] = frame if known == frame else NamedFrame(name, None)
            self.definitions += [(name, group)] if group.start < source.own_end else []

    def named(self, name: str) -> NamedFrame | str:
        """Tool or work object of a name, or why its targets are left."""
        return self._known.get(name.lower(), NamedFrame(name, None))

    def declaration_of(self, group: Group) -> re.Match[str] | None:
        """Declaration whose value a literal is, or is a part of."""
        while group.parent is not None:
            group = group.parent
        k = bisect_right(self._starts, group.start) - 1
        return self._declared[k] if k >= 0 and self._declared[k].end() == group.start else None

    def _read_assignments(self) -> set[str]:
        """Lower-case names of the variables that are assigned outside of their declaration."""
        source, changed = self._source, set()
        declared = {match.start(2) for match in self._declared}
        for match in _COMPONENT_ASSIGNED.finditer(source.code):
            if match.start(1) in declared:
                continue
            name = match[1].lower()
            changed.add(name)
            value = source.code[match.end() : source.code.find(";", match.end()) + 1]
            if not re.search(rf"(?<![\w.]){name}\b", value, re.IGNORECASE):
                self.replaced.setdefault(name, f"{source.at_line(match.start())} sets {match[0][:-2].strip()} anew")
        return changed


def _frame(source: Source, group: Group, kind: str) -> np.ndarray | str | None:
    """Transform (4, 4) of a tooldata or wobjdata literal, why it moves, or None where it is no plain literal."""
    items = [source.code[a:b].strip().upper() for a, b in group.items]
    is_tool = kind == "tooldata"
    poses = group.children[:1] if is_tool else group.children
    if len(items) != (3 if is_tool else 5) or len(poses) != (1 if is_tool else 2):
        return None
    if items[0] == ("FALSE" if is_tool else "TRUE"):
        return "the robot holds the workpiece (robhold)"
    if not is_tool and items[1] == "FALSE":
        return "a mechanical unit moves its work object (ufprog)"
    transform = np.eye(4)
    for pose in poses:
        numbers = source.numbers([span for child in pose.children for span in child.items])
        if _shape(pose) != (3, 4) or isinstance(numbers, str):
            return None
        try:
            transform = transform @ pose_transform("RAPID", np.array([number.value for number in numbers]))
        except ValueError:
            return None
    return transform


def _configuration(source: Source, group: Group) -> Configuration:
    """Posture by the quadrants cf1, cf4 and cf6 and by cfx; none where they are no whole numbers.

    Bits of cfx: axis 5 is negative; the wrist is behind the lower arm; it is behind axis 1.
    """
    numbers = source.numbers(group.items)
    if isinstance(numbers, str) or any(number.value != round(number.value) for number in numbers):
        return NO_CONFIGURATION
    quadrants = dict(zip((0, 3, 5), (90.0 * number.value for number in numbers), strict=False))
    ranges = tuple((quadrants[k], quadrants[k] + 90.0) if k in quadrants else (-inf, inf) for k in range(6))
    cfx = int(numbers[3].value)
    return Configuration(ranges, behind=bool(cfx & 4), elbow_as_at_zero=not cfx & 2, axis_5_negative=bool(cfx & 1))


def _visits(source: Source, frames: _Frames) -> Iterable[Visit]:
    """Moves of the program; a variable that is handed to a routine is gone to by those of its parameter."""
    routines = _routines(source)
    off = {match[1].upper() for match in _CONFIGURATION.finditer(source.code)}  # anywhere counts as everywhere

    def variable(name: str, place: int) -> str:
        inside = next((r for r in routines if r.start <= place < r.end and name.lower() in r.parameters), None)
        return f"{inside.name}\\{name.lower()}" if inside else name.lower()

    found: list[Visit] = []
    for match in _MOVE.finditer(source.code):
        text = re.sub(r",(\s*\\)", r" \1", match[2])
        arguments = list(_arguments(text, match.start(2)))
        work = _WORK_OBJECT.search(text)
        words = [argument.partition("\\")[0].strip() for _, argument in arguments]
        tool = next((word for word, (_, each) in zip(words, arguments, strict=True) if _WORK_OBJECT.search(each)), "")
        last = -3 if _SIGNAL.fullmatch(match[1]) else -1
        tool = tool or (words[last] if len(words) > 2 else "")
        named = (
            frames.named(tool if _NAME.fullmatch(tool) else "the tool"),
            frames.named(work[1] if work else "wobj0"),
        )
        reason = next((each for each in named if isinstance(each, str)), "")
        is_joint = bool(_BY_JOINTS.match(match[1]))
        visit = Visit(
            match.start(), COMPUTED, "", is_joint, keeps=("J" if is_joint else "L") in off, reason=reason,
            tool=named[0] if isinstance(named[0], NamedFrame) else None,
            work=named[1] if isinstance(named[1], NamedFrame) else None,
        )  # fmt: skip
        for place, text in arguments[: 2 if match[1][4:5].upper() == "C" else 1]:
            place += len(text) - len(text.lstrip())
            aim = _AIM.match(text.strip())
            if place in source.by_start:
                found.append(replace(visit, place=place, variable=""))
            elif aim is not None:
                name, index = variable(aim[2], match.start()), aim[3] or ""
                found.append(
                    replace(
                        visit, place=place, variable=name, element=index if index.isdigit() or not index else COMPUTED
                    )
                )
            else:
                found.append(replace(visit, place=place))
    handed = [(f"{one.name}\\{name}", to) for one in routines for name, to in one.calls(source, variable)]
    for _ in range(_NESTED):  # of routines that hand their parameters on
        for parameter, name in handed:
            found += [replace(each, variable=name) for each in found if each.variable == parameter]
        found = list(dict.fromkeys(found))
    return found


def _arguments(text: str, start: int = 0) -> Iterable[tuple[int, str]]:
    """Arguments of an instruction with their places, split at commas outside of brackets."""
    depth, first = 0, 0
    for place, character in enumerate(text):
        depth += (character in "([{") - (character in ")]}")
        if character == "," and depth == 0:
            yield start + first, text[first:place]
            first = place + 1
    yield start + first, text[first:]


@dataclass(frozen=True)
class _Routine:
    """A procedure or function with its parameters, lower case."""

    name: str
    start: int
    end: int
    parameters: tuple[str, ...]

    def calls(self, source: Source, variable: Callable[[str, int], str]) -> Iterable[tuple[str, str]]:
        """Parameters, each with a variable that is handed to it."""
        for match in re.finditer(rf"(?<![\w%\"]){self.name}\b([^;:]{{1,2000}});", source.code, re.IGNORECASE):
            if self.start <= match.start() < self.start + len(self.name) + _HEAD:
                continue
            for parameter, (_, argument) in zip(self.parameters, _arguments(match[1]), strict=False):
                handed = re.fullmatch(r"[\s(]*([A-Za-z]\w*)\s*(?:\{[^{}]*\}\s*)?", argument.partition("\\")[0])
                if handed:
                    yield parameter, variable(handed[1].lower(), match.start())
                for inner in _OFFSET.finditer(argument):
                    start = _NAME.search(argument, inner.end())
                    if start:
                        yield parameter, variable(start[0].lower(), match.start())


def _routines(source: Source) -> list[_Routine]:
    found: list[_Routine] = []
    for match in _ROUTINE.finditer(source.code):
        end = _ROUTINE_END.search(source.code, match.end())
        names = (_NAME.findall(re.split(r"[{\\]", part.lstrip(" \t\\"))[0]) for part in match[2].split(","))
        parameters = tuple(each[-1].lower() for each in names if each)
        found.append(_Routine(match[1].lower(), match.start(), end.start() if end else len(source.code), parameters))
    return found


def _structure(source: Source) -> Iterable[FlowEvent[Never]]:
    """The program's routines, branches, loops and calls."""
    names = set()
    for match in _BLOCK.finditer(source.code):
        place = match.start()
        if match[1]:
            names.add(match[2].lower())
            yield FlowEvent(place, "routine", match[2].lower())
        elif match[3] or match[4]:
            yield FlowEvent(place, "if", "SWITCH" if match[4] else "")
        elif match[5]:
            yield FlowEvent(place, "loop")
        elif match[6] or match[7]:
            yield FlowEvent(place, "else", "" if match[7] else "elseif")
        else:
            yield FlowEvent(place, "end")
    for match in _CALL.finditer(source.code):
        if match[1].lower() in names:
            yield FlowEvent(match.start(1), "call", match[1].lower())
