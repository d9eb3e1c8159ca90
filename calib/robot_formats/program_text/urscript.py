"""Targets in URScript: joint lists and poses that are assigned, or given to a motion directly.

A variable that holds six numbers may also be a wrench or a speed. So an assigned list counts as a target where a motion
of the same program uses the variable, or where nothing uses it, as in a list of points.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from calib.robot_formats.program_text.pose_numbers import pose_transform
from calib.robot_formats.program_text.source import (
    Group,
    LeftLiteral,
    NamedFrame,
    Number,
    ProgramTarget,
    ProgramTargets,
    Source,
    Word,
    distinct_frames,
    with_frames,
)

MASKED = re.compile(r"\"[^\"\r\n]*\"?|'[^'\r\n]*'?|#[^\r\n]*")
_TARGETS_OF = {
    "movej": 1,
    "movel": 1,
    "movep": 1,
    "movec": 2,
    "servoj": 1,
    "servoc": 1,
    "servol": 1,
    "get_inverse_kin": 1,
    "get_inverse_kin_has_solution": 1,
    "get_forward_kin": 1,
}
"""Functions, and how many of their first arguments are targets."""
_KEYWORDS = {"q", "pose", "pose_to", "pose_via"}
_OFFSETS = {"pose_trans", "pose_add"}
_TCP = "set_tcp"
_UNKNOWN_TCP = "the controller's own TCP (no set_tcp before it)"
_ASSIGNED = re.compile(r"([A-Za-z_]\w*)\s*(?<![=<>!])=$")
_BASE = NamedFrame("base", np.eye(4))


@dataclass(frozen=True)
class _Use:
    """One use of a variable."""

    place: int
    function: str  # "" outside of a call
    is_target: bool
    moves_along: bool = False  # the start of an offset, or one of its numbers


def urscript_targets(source: Source) -> ProgramTargets:
    """Targets of a URScript program. Raises CalibError where brackets do not match."""
    left: list[LeftLiteral] = []
    found: list[tuple[ProgramTarget, bool]] = []  # and whether it is held by a variable
    tcps: list[tuple[int, NamedFrame]] = []
    named_poses: dict[str, list[Group]] = {}
    for group in source.groups:
        if group.bracket != "[" or any(child.bracket == "[" for child in group.children):
            continue
        before = source.code[max(0, group.start - 2) : group.start]
        is_pose = before.endswith("p") and not (len(before) > 1 and (before[0].isalnum() or before[0] == "_"))
        if not is_pose and (before[-1:].isalnum() or before[-1:] in ("_", "]", ")")):
            continue  # an index
        items = group.items
        if len(items) != 6:
            continue
        start = group.start - is_pose
        line, what = source.line(start), source.literal(start, group.end)
        numbers = source.numbers(items)
        name, role = _place_of(source, group, start)
        if role == "":
            if name and is_pose:
                named_poses.setdefault(name, []).append(group)
            if isinstance(numbers, str):
                role = numbers
        if role == _TCP:
            if isinstance(numbers, str):
                tcps.append((start, NamedFrame(f"the TCP of line {line}", None)))
            else:
                tcps.append((start, _tcp(f"the TCP of line {line}", numbers)))
            role = "the tool's definition"
        if role or isinstance(numbers, str):
            left.append(LeftLiteral(line, what, role or str(numbers)))
            continue
        kind = "pose" if is_pose else "joints"
        motion = "" if name else source.function_of(group.parent) if group.parent else ""
        target = ProgramTarget(name or motion, line, kind, numbers, start)  # type: ignore[arg-type]
        found.append((target, bool(name)))
    uses = _uses(source, {target.name for target, named in found if named} | set(named_poses))
    for name, groups in named_poses.items():
        numbers = source.numbers(groups[0].items)
        plain = len(groups) == 1 and not isinstance(numbers, str)
        for use in uses.get(name, []):
            if use.function == _TCP:
                tcps.append((use.place, _tcp(name, numbers) if plain else NamedFrame(name, None)))  # type: ignore[arg-type]
    tcps += [(place, NamedFrame(f"the TCP of line {source.line(place)}", None)) for place in _other_tcps(source, tcps)]
    tcps.sort(key=lambda each: each[0])
    reasons = {name: _unfit(own) for name, own in uses.items()}
    tools = {
        name: distinct_frames(_tcp_at(tcps, use.place) for use in own if use.is_target) for name, own in uses.items()
    }
    targets: list[ProgramTarget] = []
    for target, named in found:
        if named and reasons.get(target.name):
            left.append(LeftLiteral(target.line, target.name, reasons[target.name]))
            continue
        if target.kind == "pose":
            used = tools.get(target.name) if named else None
            with_tool = with_frames(target, used or [_tcp_at(tcps, target.place)], [_BASE])
            if isinstance(with_tool, str):
                left.append(LeftLiteral(target.line, target.name, with_tool))
                continue
            target = with_tool
        targets.append(target)
    return ProgramTargets(tuple(targets), tuple(sorted(left, key=lambda each: each.line)))


def _place_of(source: Source, group: Group, start: int) -> tuple[str, str]:
    """Name of the variable that holds a literal ("" for an argument), and why it is no target ("" where it is)."""
    before, parent = source.before(start), group.parent
    assigned = _ASSIGNED.search(before)
    if parent is None:
        if assigned is None:
            return "", "part of an expression"
        rest = source.code[group.end : source.line_end(group.end)].strip()
        return assigned[1], "" if rest in ("", ";") else "part of an expression"
    if parent.bracket != "(":
        return "", "an element of a list; give it a variable of its own"
    function = source.function_of(parent)
    index = parent.index_of(start)
    if function == _TCP and source.is_item(start, group.end, parent):
        return "", _TCP
    if assigned is not None and function:
        fits = assigned[1] in _KEYWORDS and function in _TARGETS_OF
        return "", "" if fits else f"the argument {assigned[1]} of {function}"
    if not source.is_item(start, group.end, parent):
        return "", "part of an expression"
    if index < _TARGETS_OF.get(function, 0):
        return "", ""
    return "", f"an argument of {function}" if function else "part of an expression"


def _uses(source: Source, names: set[str]) -> dict[str, list[_Use]]:
    """Uses of variables, their own assignments left out."""
    found: dict[str, list[_Use]] = {}
    for word in source.words:
        if word.text in names:
            end = word.place + len(word.text)
            after = source.code[end : end + _AHEAD].lstrip()
            is_assignment = word.group is None and after[:1] == "=" and after[:2] != "=="
            if not is_assignment:
                found.setdefault(word.text, []).append(_use(source, word))
    return found


_AHEAD = 40  # characters behind a variable that are looked at


def _use(source: Source, word: Word) -> _Use:
    group = word.group
    if source.code[word.place + len(word.text) : word.place + len(word.text) + 1] == "[":
        return _Use(word.place, "", False, moves_along=True)  # one of its numbers
    if group is None or group.bracket != "(":
        return _Use(word.place, "", False)
    function = source.function_of(group)
    whole = source.is_item(word.place, word.place + len(word.text), group)
    keyword = _ASSIGNED.search(source.before(word.place))
    first = group.index_of(word.place) < _TARGETS_OF.get(function, 0)
    is_target = (whole and first) or (keyword is not None and keyword[1] in _KEYWORDS and function in _TARGETS_OF)
    moves_along = whole and function in _OFFSETS and group.index_of(word.place) == 0
    return _Use(word.place, function, is_target, moves_along)


def _unfit(uses: list[_Use]) -> str:
    """Reason why a variable with these uses holds no target; "" where it does."""
    is_moved_to = any(use.is_target for use in uses)
    others = [use for use in uses if not use.is_target and not (use.moves_along and is_moved_to)]
    if not others:
        return ""
    by = f"by {others[0].function}" if others[0].function else "in an expression"
    return f"the variable is also used {by}" if len(others) < len(uses) else f"the variable is used {by}, in no motion"


def _tcp(name: str, numbers: tuple[Number, ...]) -> NamedFrame:
    return NamedFrame(name, pose_transform("URScript", np.array([number.value for number in numbers])))


def _tcp_at(tcps: list[tuple[int, NamedFrame]], place: int) -> NamedFrame:
    """Tool that the last set_tcp in front of a place sets."""
    k = bisect_left(tcps, place, key=lambda each: each[0])
    return tcps[k - 1][1] if k else NamedFrame(_UNKNOWN_TCP, None)


def _other_tcps(source: Source, known: list[tuple[int, NamedFrame]]) -> list[int]:
    """Places of calls of set_tcp whose argument is neither a literal nor a variable that holds one."""
    lines = {source.line(place) for place, _ in known}
    calls = [word.place for word in source.words if word.text == _TCP]
    return [place for place in calls if source.line(place) not in lines]
