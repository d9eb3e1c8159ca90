"""Targets in KRL: aggregates of A1 ... A6, or of X, Y, Z, A, B and C, in motions, assignments and .dat files.

A .dat file of inline forms tells tool and base by their numbers (`DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,...}` for the
point XP1); number 0 is the flange and the robot's base, the others are known where the file has TOOL_DATA and
BASE_DATA.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from math import inf

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
    distinct_frames,
    with_frames,
)

MASKED = re.compile(r"\"[^\"\r\n]*\"?|;[^\r\n]*|(?:(?<=\n)|(?<=\r)|\A)[ \t]*&[^\r\n]*")
JOINTS = ("A1", "A2", "A3", "A4", "A5", "A6")
POSE = ("X", "Y", "Z", "A", "B", "C")
_BESIDES = {"S", "T", "E1", "E2", "E3", "E4", "E5", "E6"}
_MOTIONS = {"PTP", "LIN", "CIRC", "SPTP", "SLIN", "SCIRC", "SPL"}
_COMPONENT = re.compile(r"\s*([A-Za-z_]\w*)\s+(\S.*?)\s*", re.DOTALL)
_ASSIGNED = re.compile(r"(\$?[A-Za-z_]\w*)\s*(?:\[\s*(\d*)[^\]]*\])?\s*(?<![=<>])=$")
_DECLARED = re.compile(
    r"\b(E6POS|POS|E6AXIS|AXIS|FRAME|FDAT|LDAT|PDAT|LOAD)\b[ \t]+([A-Za-z_]\w*(?:[ \t]*\[[^\]\r\n]*\])?"
    r"(?:[ \t]*,[ \t]*[A-Za-z_]\w*(?:[ \t]*\[[^\]\r\n]*\])?)*)",
    re.IGNORECASE,
)
_FRAME_SET = re.compile(r"(?<![\w$])\$(BASE|TOOL)\b(\.\w+)?\s*=(?!=)\s*", re.IGNORECASE)
_BAS = re.compile(r"\bBAS\s*\(\s*#(BASE|TOOL)\s*,\s*(\w+)\s*\)", re.IGNORECASE)
_DATA = re.compile(r"\$?(BASE|TOOL)_DATA\s*\[\s*(\d+)\s*\]", re.IGNORECASE)
_NUMBER_OF = re.compile(r"\b(BASE|TOOL)_NO\s+(-?\d+)", re.IGNORECASE)
_FIXED_TOOL = re.compile(r"\$IPO_MODE\s*=\s*#TCP\b|\bIPO_FRAME\s+#TCP\b", re.IGNORECASE)
_UNKNOWN = {"TOOL": "the tool (the file sets no $TOOL)", "BASE": "the base (the file sets no $BASE)"}


def krl_targets(source: Source) -> ProgramTargets:
    """Targets of a KRL source or data file. Raises CalibError where brackets do not match."""
    left: list[LeftLiteral] = []
    found: list[tuple[ProgramTarget, bool]] = []  # and whether it is held by a variable
    types = _declared(source)
    frames = _Frames(source)
    for group in source.groups:
        if group.bracket != "{" or any(child.bracket == "{" for child in group.children):
            continue
        parts = _components(source, group)
        names = set(parts)
        if not names or not names <= {*JOINTS, *POSE, *_BESIDES} or not names & {*JOINTS, *POSE}:
            continue
        line, what = source.line(group.start), source.literal(group.start, group.end)
        kind, wanted = ("joints", JOINTS) if names & set(JOINTS) else ("pose", POSE)
        name, reason = _place_of(source, group, types)
        if not reason and not set(wanted) <= names:
            missing = ", ".join(each for each in wanted if each not in names)
            reason = f"part of a position: the controller keeps the present {missing}"
        numbers = source.numbers([parts[each] for each in wanted if each in parts])
        if reason or isinstance(numbers, str):
            left.append(LeftLiteral(line, what, reason or str(numbers)))
            continue
        ranges = _ranges(source, parts) if kind == "pose" else ()
        held = bool(name)
        name = name or _first_word(source, group.start).upper()
        target = ProgramTarget(name, line, kind, numbers, group.start, ranges_deg=ranges)  # type: ignore[arg-type]
        found.append((target, held))
    uses = _motions_of(source, {target.name.partition("[")[0].upper() for target, held in found if held})
    used = {
        name: (
            distinct_frames(frames.at("TOOL", place) for place in places),
            distinct_frames(frames.at("BASE", place) for place in places),
        )
        for name, places in uses.items()
    }
    fixed_tool = _FIXED_TOOL.search(source.code)
    targets: list[ProgramTarget] = []
    for target, held in found:
        if target.kind == "pose":
            if fixed_tool is not None:
                reason = f"line {source.line(fixed_tool.start())} moves a workpiece at a fixed tool"
                left.append(LeftLiteral(target.line, target.name, reason))
                continue
            base_name = target.name.partition("[")[0].upper()
            numbered = frames.numbered(base_name) if held else None
            tools, works = [frames.at("TOOL", target.place)], [frames.at("BASE", target.place)]
            if numbered:
                tools, works = [numbered[0]], [numbered[1]]
            elif held and base_name in used:
                tools, works = used[base_name]
            with_both = with_frames(target, tools, works)
            if isinstance(with_both, str):
                left.append(LeftLiteral(target.line, target.name, with_both))
                continue
            target = with_both
        targets.append(target)
    return ProgramTargets(tuple(targets), tuple(sorted(left, key=lambda each: each.line)))


def _components(source: Source, group: Group) -> dict[str, tuple[int, int]]:
    """Places of an aggregate's values by the names of its components, upper case; {} for anything else."""
    found: dict[str, tuple[int, int]] = {}
    for k, (start, end) in enumerate(group.items):
        if k == 0:  # {E6POS: X 1, ...}
            prefix = re.match(r"\s*\w+\s*:", source.code[start:end])
            start += prefix.end() if prefix else 0
        match = _COMPONENT.fullmatch(source.code, start, end)
        if match is None or match[1].upper() in found:
            return {}
        found[match[1].upper()] = match.span(2)
    return found


def _place_of(source: Source, group: Group, types: dict[str, str]) -> tuple[str, str]:
    """Name of the variable that holds an aggregate ("" in a motion), and why it is no target ("" where it is)."""
    before = source.before(group.start)
    after = source.code[group.end : source.line_end(group.end)].lstrip()
    if before.endswith(":") or after.startswith(":"):
        return "", "part of a product of frames (:)"
    first = _first_word(source, group.start).upper()
    if first.endswith("_REL"):
        return "", "a relative motion"
    assigned = _ASSIGNED.search(before)
    if assigned is not None and group.parent is None:
        name, index = assigned[1], assigned[2]
        if name.startswith("$") or name.upper() in ("BASE_DATA", "TOOL_DATA"):
            is_frame = re.fullmatch(r"\$?(BASE|TOOL)(_DATA)?", name, re.IGNORECASE)
            return name, "the definition of a tool or base" if is_frame else "a variable of the system"
        kind = types.get(name.upper(), "")
        if kind in ("FRAME", "LOAD"):
            return name, f"a {kind}, no position"
        return (f"{name}[{index}]" if index else name), ""
    if group.parent is None and first in _MOTIONS:
        return "", ""
    return "", "an argument or part of an expression"


def _first_word(source: Source, place: int) -> str:
    found = re.compile(r"\s*([A-Za-z_$][\w$]*)").match(source.code, source.line_start(place))
    return found[1] if found else ""


def _declared(source: Source) -> dict[str, str]:
    """Types of the variables that the file declares, all in upper case."""
    found: dict[str, str] = {}
    for match in _DECLARED.finditer(source.code):
        for name in match[2].split(","):
            found[name.partition("[")[0].strip().upper()] = match[1].upper()
    return found


def _ranges(source: Source, parts: dict[str, tuple[int, int]]) -> tuple[tuple[float, float], ...]:
    """Ranges of the axes by the bits of T, each the sign of an axis; () without T."""
    if "T" not in parts:
        return ()
    start, end = parts["T"]
    text = source.code[start:end].strip()
    bits = re.fullmatch(r"'\s*([BH])\s*([0-9A-Fa-f]{1,8})\s*'", text, re.IGNORECASE)
    try:
        turns = int(bits[2], 2 if bits[1].upper() == "B" else 16) if bits else int(text[:9])
    except ValueError:
        return ()
    if not 0 <= turns < 64 and bits is None:
        return ()
    return tuple((-inf, 0.0) if turns >> k & 1 else (0.0, inf) for k in range(6))


def _motions_of(source: Source, names: set[str]) -> dict[str, list[int]]:
    """Places at which motions use variables, by their upper-case names."""
    found: dict[str, list[int]] = {}
    for word in source.words:
        if word.text.upper() in names and _first_word(source, word.place).upper() in _MOTIONS:
            found.setdefault(word.text.upper(), []).append(word.place)
    return found


class _Frames:
    """Tools and bases of a file: what it sets in its order, and its numbered data."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._by_start = {group.start: group for group in source.groups if group.bracket == "{"}
        self._data: dict[tuple[str, int], NamedFrame] = {}
        for match in _DATA.finditer(source.code):
            equals = re.compile(r"\s*=(?!=)\s*").match(source.code, match.end())
            if equals is not None:
                key = (match[1].upper(), int(match[2][:9]))
                several = key in self._data
                self._data[key] = NamedFrame(_name(*key), None if several else self._literal(equals.end()))
        self._events: dict[str, list[tuple[int, NamedFrame]]] = {"BASE": [], "TOOL": []}
        for match in _FRAME_SET.finditer(source.code):
            self._events[match[1].upper()].append((match.start(), self._set(match)))
        for match in _BAS.finditer(source.code):
            kind, number = match[1].upper(), match[2]
            unknown = NamedFrame(f"{kind}_DATA[{number}]", None)
            frame = self._number(kind, int(number[:9])) if number.isdigit() else unknown
            self._events[kind].append((match.start(), frame))
        self._places: dict[str, list[int]] = {}
        for kind, events in self._events.items():
            events.sort(key=lambda each: each[0])
            self._places[kind] = [place for place, _ in events]
        self._fdat = self._read_fdat()

    def at(self, kind: str, place: int) -> NamedFrame:
        """Frame that the last assignment in front of a place sets."""
        k = bisect_left(self._places[kind], place)
        return self._events[kind][k - 1][1] if k else NamedFrame(_UNKNOWN[kind], None)

    def numbered(self, name: str) -> tuple[NamedFrame, NamedFrame] | None:
        """Tool and base of a point by its FDAT: that of XP1 is FP1."""
        return self._fdat.get("F" + name.removeprefix("X"))

    def _number(self, kind: str, number: int) -> NamedFrame:
        if number == 0:
            return NamedFrame("$NULLFRAME", np.eye(4))
        return self._data.get((kind, number), NamedFrame(_name(kind, number), None))

    def _set(self, match: re.Match[str]) -> NamedFrame:
        source, kind, place = self._source, match[1].upper(), match.end()
        rest = source.code[place : source.line_end(place)].strip()
        name = f"${kind} of line {source.line(match.start())}"
        if match[2]:  # a component of the frame
            return NamedFrame(name, None)
        if rest.upper() == "$NULLFRAME" or (kind == "BASE" and rest.upper() in ("$WORLD", "$ROBROOT")):
            return NamedFrame(rest, np.eye(4))
        data = _DATA.fullmatch(rest)
        if data is not None and data[1].upper() == kind:
            return self._number(kind, int(data[2][:9]))
        return NamedFrame(name, self._literal(place))

    def _literal(self, place: int) -> np.ndarray | None:
        """Transform (4, 4) of the whole aggregate at a place; None where there is no plain one."""
        group = self._by_start.get(place)
        if group is None:
            return None
        parts = _components(self._source, group)
        rest = self._source.code[group.end : self._source.line_end(group.end)].strip()
        if rest or set(parts) != set(POSE):
            return None
        numbers = self._source.numbers([parts[each] for each in POSE])
        return None if isinstance(numbers, str) else pose_transform("KRL", _values(numbers))

    def _read_fdat(self) -> dict[str, tuple[NamedFrame, NamedFrame]]:
        found: dict[str, tuple[NamedFrame, NamedFrame]] = {}
        for match in re.finditer(r"\bFDAT\s+([A-Za-z_]\w*)\s*=\s*", self._source.code, re.IGNORECASE):
            group = self._by_start.get(match.end())
            if group is None:
                continue
            inside = self._source.code[group.start : group.end]
            numbers = {m[1].upper(): int(m[2][:9]) for m in _NUMBER_OF.finditer(inside)}
            if {"TOOL", "BASE"} <= set(numbers):
                pair = (self._number("TOOL", numbers["TOOL"]), self._number("BASE", numbers["BASE"]))
                found[match[1].upper()] = pair
        return found


def _name(kind: str, number: int) -> str:
    return f"{kind}_DATA[{number}]"


def _values(numbers: tuple[Number, ...]) -> np.ndarray:
    return np.array([number.value for number in numbers])
