"""Targets in RAPID: jointtarget and robtarget literals, with the tool and work object of the moves that use them.

Tools and work objects count as the file defines them (`PERS tooldata tool1:=[...]`); a controller may have other values
of persistent variables by now. What the program assigns anew at run time counts as not defined.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from calib.extras.robot_programs.program_text.pose_numbers import pose_transform
from calib.extras.robot_programs.program_text.source import (
    NUMBER,
    FramesOfUses,
    Group,
    NamedFrame,
    ParsedTarget,
    ProgramTarget,
    ProgramTargets,
    SkippedLiteral,
    Source,
    external_axes,
    framed,
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
_DISPLACED = re.compile(r"\b(PDispOn|PDispSet|EOffsOn|EOffsSet)\b", re.IGNORECASE)
_CONFIGURATION = re.compile(r"\bConf([JL])\s*\\\s*Off\b", re.IGNORECASE)
_ROUTINE = re.compile(r"\b(?:PROC|FUNC\s+\w+)\s+(\w+)\s*\(([^()]*)\)", re.IGNORECASE)
_ROUTINE_END = re.compile(r"\bEND(?:PROC|FUNC)\b", re.IGNORECASE)
_NESTED, _HEAD = 3, 40
_BY_JOINTS = re.compile(r"(?:Move|Trigg|Search)J", re.IGNORECASE)
_AXES = {0: 0, 1: 3, 2: 5}  # the axis of each of cf1, cf4 and cf6, from 0
_HELD = ("robtarget", "jointtarget")
_UNUSED_AXIS = 9e8  # as 9E9
_SHAPES = {(6, 6): "joints", (3, 4, 4, 6): "pose"}
_UNUSED_TOOL = "the tool (the program has no move)"
_UNUSED_WORK = "the work object (the program has no move)"


@dataclass(frozen=True)
class _Move:
    """A move of the program with its tool and work object."""

    start: int
    end: int
    tool: str
    work: str


def rapid_targets(source: Source) -> ProgramTargets:
    """Targets of a RAPID module or program. Raises CalibError where brackets do not match."""
    left: list[SkippedLiteral] = []
    found: list[ParsedTarget] = []
    outside: list[int] = []  # lines of targets whose external axes stand elsewhere than at 0
    counts: dict[str, int] = {}
    changed, replaced = _assigned_later(source)
    free = _without_configuration(source)
    frames: dict[str, dict[str, np.ndarray | str | None]] = {
        "tool": {"tool0": np.eye(4)},
        "work": {"wobj0": np.eye(4)},
    }
    declared = [(m.start(), m.end(), m) for m in _DECLARATION.finditer(source.code)]
    starts = [start for start, _, _ in declared]
    for group in source.groups:
        shape = _shape(group)
        if shape is None:
            continue
        declaration = _declaration_of(declared, starts, source, group)
        line, what = source.line(group.start), source.literal(group.start, group.end)
        if declaration is not None and declaration[1].lower() in ("tooldata", "wobjdata"):
            if group.parent is None:
                kind = "tool" if declaration[1].lower() == "tooldata" else "work"
                name = declaration[2].lower()
                value = _frame(source, group, kind)
                if isinstance(value, np.ndarray) and name in changed:
                    value = None
                known = frames[kind].setdefault(name, value)
                if isinstance(known, np.ndarray) and not np.array_equal(known, value):  # type: ignore[arg-type]
                    frames[kind][name] = None
                role = "the definition of a tool" if kind == "tool" else "the definition of a work object"
                if group.start < source.own_end:
                    left.append(SkippedLiteral(line, declaration[2], role))
            continue
        if group.start >= source.own_end:
            continue
        is_held = declaration is not None and declaration[1].lower() in _HELD
        if shape not in _SHAPES:
            if group.parent is None and declaration is not None and is_held and declaration[3] is None:
                left.append(SkippedLiteral(line, declaration[2], "its parts are not all plain numbers"))
            elif group.parent is None and shape == (3, 4):
                left.append(SkippedLiteral(line, what, "a pose, no robtarget"))
            continue
        name, array, reason = _place_of(source, group, declaration)
        reason = reason or replaced.get(name.lower(), "")
        spans = group.children[0].items + (group.children[1].items if len(shape) == 4 else [])
        numbers = source.numbers(spans)
        if reason or isinstance(numbers, str):
            left.append(SkippedLiteral(line, name or what, reason or str(numbers)))
            continue
        kind = _SHAPES[shape]
        ranges = _ranges(source, group.children[2]) if kind == "pose" else ()
        shown = name
        if array:
            counts[name] = counts.get(name, 0) + 1
            shown = f"{name}{{{counts[name]}}}"
        external = ["".join(source.code[a:b].split()) for a, b in group.children[-1].items]
        if not all(NUMBER.fullmatch(each) and not 0.0 < abs(float(each)) < _UNUSED_AXIS for each in external):
            outside.append(line)
        found.append(ParsedTarget(ProgramTarget(shown, line, kind, numbers, group.start, ranges_deg=ranges), name))  # type: ignore[arg-type]
    moves = _moves(source)
    by_name = _moves_by_name(source, moves, {held.variable.lower() for held in found if held.variable})
    move_starts = [move.start for move in moves]
    fits: list[ParsedTarget] = []
    own: dict[int, list[_Move]] = {}
    for held in found:
        target, uses = held.target, by_name.get(held.variable.lower(), [])
        if not held.variable:
            k = bisect_right(move_starts, target.place) - 1
            if k < 0 or target.place >= moves[k].end:
                left.append(
                    SkippedLiteral(target.line, target.name or "a target", "an argument or part of an expression")
                )
                continue
            uses = [moves[k]]
            target = replace(target, name=source.code[moves[k].start : moves[k].end].split(None, 1)[0])
        target = replace(target, ranges_bind=not any(move.start in free for move in uses))
        own[target.place] = uses
        fits.append(replace(held, target=target))

    def frames_of(held: ParsedTarget) -> FramesOfUses | str:
        uses = own[held.target.place]
        if moves and not uses:
            return "no move of the program uses it, so its tool and work object are not known"
        moved = [
            str(frame)
            for move in uses
            for frame in (frames["tool"].get(move.tool.lower()), frames["work"].get(move.work.lower()))
            if isinstance(frame, str)
        ]
        if moved:
            return moved[0]
        tools = [_named(frames["tool"], move.tool) for move in uses] or [NamedFrame(_UNUSED_TOOL, None)]
        works = [_named(frames["work"], move.work) for move in uses] or [NamedFrame(_UNUSED_WORK, None)]
        return tools, works

    targets, without = framed(fits, frames_of)
    left += without
    left += [
        SkippedLiteral(source.line(m.start()), m[1], "an offset from a target, which moves along with it")
        for m in _OFFSET.finditer(source.code, 0, source.own_end)
    ]
    displaced = _DISPLACED.search(source.code)
    notes: tuple[str, ...] = ()
    if displaced is not None:
        where = source.at_line(displaced.start())
        notes = (f"{displaced[1]} in {where} displaces targets: they are corrected where they stand without it",)
    notes = (*notes, *external_axes(outside))
    return ProgramTargets(tuple(targets), tuple(sorted(left, key=lambda each: each.line)), notes)


def _shape(group: Group) -> tuple[int, ...] | None:
    """Counts of numbers in the lists that a list consists of; None for other lists."""
    lists = group.children
    if group.bracket != "[" or any(child.bracket != "[" for child in lists):
        return None
    if len(lists) < 2 or (len(lists) != len(group.commas) + 1 and group.parent is not None):
        return None
    return tuple(len(child.items) for child in lists)


def _declaration_of(
    declared: list[tuple[int, int, re.Match[str]]], starts: list[int], source: Source, group: Group
) -> re.Match[str] | None:
    """Declaration whose value a literal is, or is a part of."""
    outermost = group
    while outermost.parent is not None:
        outermost = outermost.parent
    k = bisect_right(starts, outermost.start) - 1
    return declared[k][2] if k >= 0 and declared[k][1] == outermost.start else None


def _place_of(source: Source, group: Group, declaration: re.Match[str] | None) -> tuple[str, bool, str]:
    """Variable that holds a literal ("" in a move), whether it is an element of an array, and why it is no target."""
    if declaration is not None:
        kind = declaration[1].lower()
        if kind not in _HELD:
            return declaration[2], False, f"part of a {declaration[1]}"
        return declaration[2], declaration[3] is not None, ""
    if group.parent is not None:
        function = source.function_of(group.parent) if group.parent.bracket == "(" else ""
        return "", False, f"an argument of {function}" if function else "part of an expression"
    before = source.before(group.start)
    assigned = _ASSIGNED.search(before)
    if assigned is not None:
        return assigned[1], False, ""
    return "", False, "" if before[-1:] in (",", "") or before[-1:].isalnum() else "part of an expression"


def _assigned_later(source: Source) -> tuple[set[str], dict[str, str]]:
    """Lower-case names of the variables that are assigned outside of their declaration.

    The second are those whose new value is not computed from the old one and so does not move along with it, with the
    place in words.
    """
    declared = {match.start(2) for match in _DECLARATION.finditer(source.code)}
    changed: set[str] = set()
    replaced: dict[str, str] = {}
    for match in _COMPONENT_ASSIGNED.finditer(source.code):
        if match.start(1) in declared:
            continue
        name = match[1].lower()
        changed.add(name)
        value = source.code[match.end() : source.code.find(";", match.end()) + 1]
        if not re.search(rf"(?<![\w.]){name}\b", value, re.IGNORECASE):
            replaced.setdefault(name, f"{source.at_line(match.start())} sets {match[0][:-2].strip()} anew")
    return changed, replaced


def _frame(source: Source, group: Group, kind: str) -> np.ndarray | str | None:
    """Transform (4, 4) of a tooldata or wobjdata literal, why it moves, or None where it is no plain literal."""
    items = [source.code[a:b].strip().upper() for a, b in group.items]
    poses = group.children[:1] if kind == "tool" else group.children
    if len(items) != (3 if kind == "tool" else 5) or len(poses) != (1 if kind == "tool" else 2):
        return None
    if items[0] == ("FALSE" if kind == "tool" else "TRUE"):
        return "the robot holds the workpiece (robhold)"
    if kind == "work" and items[1] == "FALSE":
        return "a mechanical unit moves its work object (ufprog)"
    if items[0] not in ("TRUE", "FALSE") or (kind == "work" and items[1] != "TRUE"):
        return None
    transform = np.eye(4)
    for pose in poses:
        if _shape(pose) != (3, 4):
            return None
        numbers = source.numbers([span for child in pose.children for span in child.items])
        if isinstance(numbers, str):
            return None
        try:
            transform = transform @ pose_transform("RAPID", np.array([number.value for number in numbers]))
        except ValueError:
            return None
    return transform


def _ranges(source: Source, configuration: Group) -> tuple[tuple[float, float], ...]:
    """Ranges of the axes by the quadrants cf1, cf4 and cf6; () where they are no whole numbers."""
    numbers = source.numbers(configuration.items)
    if isinstance(numbers, str) or any(number.value != round(number.value) for number in numbers):
        return ()
    ranges = [(-inf, inf)] * 6
    for k, axis in _AXES.items():
        quadrant = numbers[k].value
        ranges[axis] = (90.0 * quadrant, 90.0 * quadrant + 90.0)
    return tuple(ranges)


def _without_configuration(source: Source) -> set[int]:
    """Starts of the moves for which the program has switched the check of the configuration off.

    What a program switches off anywhere counts as off everywhere.
    """
    off = {match[1].upper() for match in _CONFIGURATION.finditer(source.code)}
    return {
        match.start() for match in _MOVE.finditer(source.code) if ("J" if _BY_JOINTS.match(match[1]) else "L") in off
    }


def _moves(source: Source) -> list[_Move]:
    found: list[_Move] = []
    for match in _MOVE.finditer(source.code):
        arguments = _arguments(re.sub(r",(\s*\\)", r"\1", match[2]))
        work = _WORK_OBJECT.search(match[2])
        tool = ""
        for argument in arguments:
            if _WORK_OBJECT.search(argument):
                tool = argument.partition("\\")[0].strip()
        last = -3 if _SIGNAL.fullmatch(match[1]) else -1
        tool = tool or (arguments[last].partition("\\")[0].strip() if len(arguments) > 2 else "")
        name = tool if _NAME.fullmatch(tool) else "the tool"
        found.append(_Move(match.start(), match.end(), name, work[1] if work else "wobj0"))
    return found


def _arguments(text: str) -> list[str]:
    """Arguments of an instruction, split at commas outside of brackets."""
    found, depth, start = [], 0, 0
    for place, character in enumerate(text):
        depth += (character in "([{") - (character in ")]}")
        if character == "," and depth == 0:
            found.append(text[start:place])
            start = place + 1
    return [*found, text[start:]]


def _moves_by_name(source: Source, moves: list[_Move], names: set[str]) -> dict[str, list[_Move]]:
    """Moves that name variables, one for each pair of a tool and a work object.

    A variable that is handed to a routine has the moves of its parameter.
    """
    found: dict[str, dict[tuple[str, str], _Move]] = {}

    def add(name: str, move: _Move) -> None:
        found.setdefault(name, {}).setdefault((move.tool.lower(), move.work.lower()), move)

    routines = _routines(source)
    starts = [routine.start for routine in routines]
    parameters = {f"{routine.name}\\{each}" for routine in routines for each in routine.parameters}

    def variable(name: str, place: int) -> str:
        k = bisect_right(starts, place) - 1
        inside = k >= 0 and place < routines[k].end and name in routines[k].parameters
        return f"{routines[k].name}\\{name}" if inside else name

    for move in moves:
        for match in _NAME.finditer(source.code, move.start, move.end):
            name = variable(match[0].lower(), move.start)
            if name in names or name in parameters:
                add(name, move)
    handed = [(f"{one.name}\\{name}", to) for one in routines for name, to in one.calls(source, variable)]
    for _ in range(_NESTED):  # of routines that hand their parameters on
        for parameter, name in handed:
            for move in list(found.get(parameter, {}).values()):
                add(name, move)
    return {name: list(different.values()) for name, different in found.items() if name in names}


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
            for parameter, argument in zip(self.parameters, _arguments(match[1]), strict=False):
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


def _named(frames: dict[str, np.ndarray | str | None], name: str) -> NamedFrame:
    transform = frames.get(name.lower())
    return NamedFrame(name, transform if isinstance(transform, np.ndarray) else None)
