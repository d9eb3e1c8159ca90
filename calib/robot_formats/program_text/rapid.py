"""Targets in RAPID: jointtarget and robtarget literals, with the tool and work object of the moves that use them.

Tools and work objects count as the file defines them (`PERS tooldata tool1:=[...]`); a controller may have other values
of persistent variables by now. What the program assigns anew at run time counts as not defined.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from calib.robot_formats.program_text.pose_numbers import pose_transform
from calib.robot_formats.program_text.source import (
    Group,
    LeftLiteral,
    NamedFrame,
    ProgramTarget,
    ProgramTargets,
    Source,
    with_frames,
)

MASKED = re.compile(r"\"[^\"\r\n]*\"?|![^\r\n]*")
_DECLARATION = re.compile(r"\b(?:CONST|PERS|VAR)\s+(\w+)\s+(\w+)\s*(\{[^{};]{0,200}\})?\s*:=\s*", re.IGNORECASE)
_ASSIGNED = re.compile(r"(?<![\w.])([A-Za-z]\w*)\s*(?:\{[^{};]{0,200}\}\s*)?:=$")
_COMPONENT_ASSIGNED = re.compile(r"(?<![\w.\\])([A-Za-z]\w*)(?:\s*\{[^{};]{0,200}\})?\s*(?:\.\s*\w+\s*)*:=")
_MOVE = re.compile(r"\b((?:Move|Trigg|Search|Arc|Spot|Paint|Disp)\w*)\b([^;]{0,3000});", re.IGNORECASE)
_WORK_OBJECT = re.compile(r"\\\s*WObj\s*:=\s*([A-Za-z]\w*)", re.IGNORECASE)
_OFFSET = re.compile(r"\b(Offs|RelTool)\s*\(", re.IGNORECASE)
_NAME = re.compile(r"[A-Za-z]\w*")
_DISPLACED = re.compile(r"\b(PDispOn|PDispSet|EOffsOn|EOffsSet)\b", re.IGNORECASE)
_AXES = {0: 0, 1: 3, 2: 5}  # the axis of each of cf1, cf4 and cf6, from 0
_SHAPES = {(6, 6): "joints", (3, 4, 4, 6): "pose"}
_UNUSED_TOOL = "the tool (no move of this file uses the target)"
_UNUSED_WORK = "the work object (no move of this file uses the target)"


@dataclass(frozen=True)
class _Move:
    """A move of the program with its tool and work object."""

    start: int
    end: int
    tool: str
    work: str


def rapid_targets(source: Source) -> ProgramTargets:
    """Targets of a RAPID module or program. Raises CalibError where brackets do not match."""
    left: list[LeftLiteral] = []
    found: list[tuple[ProgramTarget, str]] = []  # and the variable that holds it; "" in a move
    counts: dict[str, int] = {}
    changed = _assigned_later(source)
    frames = {"tool": {"tool0": np.eye(4)}, "work": {"wobj0": np.eye(4)}}
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
                transform = None if name in changed else _frame(source, group, kind)
                if transform is not None:
                    frames[kind][name] = transform
                role = "the definition of a tool" if kind == "tool" else "the definition of a work object"
                left.append(LeftLiteral(line, declaration[2], role))
            continue
        if shape == (3, 4):
            if group.parent is None:
                left.append(LeftLiteral(line, what, "a pose, no robtarget"))
            continue
        if shape not in _SHAPES:
            continue
        name, array, reason = _place_of(source, group, declaration)
        spans = group.children[0].items + (group.children[1].items if len(shape) == 4 else [])
        numbers = source.numbers(spans)
        if reason or isinstance(numbers, str):
            left.append(LeftLiteral(line, what, reason or str(numbers)))
            continue
        kind = _SHAPES[shape]
        ranges = _ranges(source, group.children[2]) if kind == "pose" else ()
        shown = name
        if array:
            counts[name] = counts.get(name, 0) + 1
            shown = f"{name}{{{counts[name]}}}"
        found.append((ProgramTarget(shown, line, kind, numbers, group.start, ranges_deg=ranges), name))  # type: ignore[arg-type]
    moves = _moves(source)
    by_name = _moves_by_name(source, moves, {name.lower() for _, name in found if name})
    move_starts = [move.start for move in moves]
    targets: list[ProgramTarget] = []
    for target, name in found:
        if not name:
            k = bisect_right(move_starts, target.place) - 1
            if k < 0 or target.place >= moves[k].end:
                left.append(LeftLiteral(target.line, target.name or "a target", "an argument or part of an expression"))
                continue
            word = source.code[moves[k].start : moves[k].end].split(None, 1)[0]
            target = replace(target, name=word)
            own = [moves[k]]
        else:
            own = by_name.get(name.lower(), [])
        if target.kind == "pose":
            tools = [_named(frames["tool"], move.tool) for move in own] or [NamedFrame(_UNUSED_TOOL, None)]
            works = [_named(frames["work"], move.work) for move in own] or [NamedFrame(_UNUSED_WORK, None)]
            with_both = with_frames(target, tools, works)
            if isinstance(with_both, str):
                left.append(LeftLiteral(target.line, target.name, with_both))
                continue
            target = with_both
        targets.append(target)
    left += [
        LeftLiteral(source.line(m.start()), m[1], "an offset from a target, which moves along with it")
        for m in _OFFSET.finditer(source.code)
    ]
    displaced = _DISPLACED.search(source.code)
    notes: tuple[str, ...] = ()
    if displaced is not None:
        line = source.line(displaced.start())
        notes = (f"{displaced[1]} in line {line} displaces targets: they are corrected where they stand without it",)
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
        if kind not in ("robtarget", "jointtarget"):
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


def _assigned_later(source: Source) -> set[str]:
    """Lower-case names of the variables that are assigned outside of their declaration."""
    declared = {match.start(2) for match in _DECLARATION.finditer(source.code)}
    return {m[1].lower() for m in _COMPONENT_ASSIGNED.finditer(source.code) if m.start(1) not in declared}


def _frame(source: Source, group: Group, kind: str) -> np.ndarray | None:
    """Transform (4, 4) of a tooldata or wobjdata literal; None for one that moves, or is no plain literal."""
    items = [source.code[a:b].strip().upper() for a, b in group.items]
    if kind == "tool":
        poses = group.children[:1]
        plain = len(items) == 3 and items[0] == "TRUE"
    else:
        poses = group.children
        plain = len(items) == 5 and items[:2] == ["FALSE", "TRUE"] and len(poses) == 2
    if not plain:
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


def _moves(source: Source) -> list[_Move]:
    found: list[_Move] = []
    for match in _MOVE.finditer(source.code):
        arguments = _arguments(match[2])
        work = _WORK_OBJECT.search(match[2])
        tool = ""
        for argument in arguments:
            if _WORK_OBJECT.search(argument):
                tool = argument.partition("\\")[0].strip()
        tool = tool or (arguments[-1].partition("\\")[0].strip() if len(arguments) > 2 else "")
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
    """Moves that name variables, one for each pair of a tool and a work object."""
    found: dict[str, dict[tuple[str, str], _Move]] = {}
    for move in moves:
        inside = {m[0].lower() for m in _NAME.finditer(source.code, move.start, move.end)}
        for name in inside & names:
            frames = (move.tool.lower(), move.work.lower())
            found.setdefault(name, {}).setdefault(frames, move)
    return {name: list(different.values()) for name, different in found.items()}


def _named(frames: dict[str, np.ndarray], name: str) -> NamedFrame:
    return NamedFrame(name, frames.get(name.lower()))
