"""Targets in KRL: aggregates of A1 ... A6, or of X, Y, Z, A, B and C, in motions, assignments and .dat files.

A .dat file of inline forms tells tool and base by their numbers (`DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,...}` for the
point XP1); number 0 is the flange and the robot's base, the others are known where the file has TOOL_DATA and
BASE_DATA.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from calib.extras.robot_programs.program_text.flow import FlowEvent, reaching
from calib.extras.robot_programs.program_text.pose_numbers import pose_transform
from calib.extras.robot_programs.program_text.source import (
    FramesOfUses,
    Group,
    NamedFrame,
    Number,
    ParsedTarget,
    ProgramTarget,
    ProgramTargets,
    SkippedLiteral,
    Source,
    external_axes,
    framed,
)

MASKED = re.compile(r"\"[^\"\r\n]*\"?|;[^\r\n]*|(?:(?<=\n)|(?<=\r)|\A)[ \t]*&[^\r\n]*")
JOINTS = ("A1", "A2", "A3", "A4", "A5", "A6")
POSE = ("X", "Y", "Z", "A", "B", "C")
_EXTERNAL = {"E1", "E2", "E3", "E4", "E5", "E6"}
_BESIDES = {"S", "T", *_EXTERNAL}
_POSITIONS = ("POS", "E6POS", "AXIS", "E6AXIS")
_CIRCULAR = {"CIRC", "SCIRC"}
_CONTINUOUS = {"LIN", "SLIN", "SPL", *_CIRCULAR}
_MOTIONS = {"PTP", "SPTP", *_CONTINUOUS}
_COMPONENT = re.compile(r"\s*([A-Za-z_]\w*)\s+(\S.*?)\s*", re.DOTALL)
_ASSIGNED = re.compile(r"([\w$\]]*\.)?(\$?[A-Za-z_]\w*)\s*(?:\[\s*(\d*)[^\]]*\])?\s*(?<![=<>])=$")
_DECLARED = re.compile(
    r"\b(E6POS|POS|E6AXIS|AXIS|FRAME|FDAT|LDAT|PDAT|LOAD)\b[ \t]+([A-Za-z_]\w*(?:[ \t]*\[[^\]\r\n]*\])?"
    r"(?:[ \t]*,[ \t]*[A-Za-z_]\w*(?:[ \t]*\[[^\]\r\n]*\])?)*)",
    re.IGNORECASE,
)
_FRAME_SET = re.compile(r"(?<![\w$])\$(BASE|TOOL)\b(\.\w+)?\s*=(?!=)\s*", re.IGNORECASE)
_BAS = re.compile(r"\bBAS\s*\(\s*#(BASE|TOOL)\s*,\s*(\w+)\s*\)", re.IGNORECASE)
_DATA = re.compile(r"\$?(BASE|TOOL)_DATA\s*\[\s*(\d+)\s*\]", re.IGNORECASE)
_NUMBER_OF = re.compile(r"\b(BASE|TOOL)_NO\s+(-?\d+)", re.IGNORECASE)
_MOTION = re.compile(rf"^[ \t]*(?:{'|'.join(sorted(_MOTIONS))})\b", re.IGNORECASE | re.MULTILINE)
_STATEMENT = re.compile(r"(?:\A|(?<=[\r\n]))[ \t]*(?:GLOBAL[ \t]+)?([A-Za-z_]\w*)", re.IGNORECASE)
_INDEX = re.compile(r"^\s*\[[^\]\r\n]*\]")
_COMPONENT_SET = re.compile(r"\s*\.\s*(\w+)\s*=(?!=)(.*)")
_DECLARES = re.compile(r"\s*(?:GLOBAL\s+)?(?:DECL|EXT|DEF|DEFFCT)\b", re.IGNORECASE)
_ACTIVE = re.compile(r"\bFDAT_ACT\s*=\s*([A-Za-z_]\w*)", re.IGNORECASE)
_VARIABLE_SET = re.compile(r"(?<![\w$.\]])([A-Za-z_]\w*)[ \t]*(\.[ \t]*\w+[ \t]*)?=(?!=)[ \t]*", re.IGNORECASE)
_FIXED_TOOL = re.compile(r"\$IPO_MODE\s*=\s*#TCP\b|\bIPO_FRAME\s+#TCP\b", re.IGNORECASE)
_UNKNOWN = {"TOOL": "the tool (the file sets no $TOOL)", "BASE": "the base (the file sets no $BASE)"}


def krl_targets(source: Source) -> ProgramTargets:
    """Targets of a KRL source or data file. Raises CalibError where brackets do not match."""
    left: list[SkippedLiteral] = []
    found: list[ParsedTarget] = []
    outside: list[int] = []  # lines of targets whose external axes stand elsewhere than at 0
    types = _declared(source)
    for group in source.own_groups:
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
            left.append(SkippedLiteral(line, what, reason or str(numbers)))
            continue
        ranges = _ranges(source, parts) if kind == "pose" else ()
        shown = name or _first_word(source, group.start).upper()
        target = ProgramTarget(shown, line, kind, numbers, group.start, ranges_deg=ranges)  # type: ignore[arg-type]
        found.append(ParsedTarget(target, name.partition("[")[0].upper()))
        external = source.numbers([span for each, span in parts.items() if each in _EXTERNAL])
        if isinstance(external, str) or any(number.value for number in external):
            outside.append(line)
    moves = _MOTION.search(source.code) is not None
    uses = _uses(source, {held.variable for held in found if held.variable})
    fits: list[ParsedTarget] = []
    for held in found:
        target, own = held.target, uses.get(held.variable, [])
        reason = _unfit(source, held, own, types) if held.variable else ""
        if not reason and target.kind == "joints" and moves and held.variable and not any(use.motion for use in own):
            reason = "no motion of the program uses it"
        if reason:
            left.append(SkippedLiteral(target.line, target.name, reason))
            continue
        words = [use.motion for use in own if use.motion] or [_first_word(source, target.place).upper()]
        # the controller keeps the posture in linear and circular motions, whatever S and T are
        bind = not set(words) & _CONTINUOUS
        fits.append(replace(held, target=replace(target, ranges_bind=bind)))
    places = {
        held.target.place: [use.place for use in uses.get(held.variable, []) if use.motion] or [held.target.place]
        for held in fits
    }
    frames = _Frames(source, {place for each in places.values() for place in each})

    def frames_of(held: ParsedTarget) -> FramesOfUses | str:
        numbered = frames.numbered(held.variable) if held.variable else None
        if numbered is not None:
            return numbered
        own = places[held.target.place]
        if moves and own == [held.target.place] and held.variable:
            return "no motion of the program uses it, so its tool and base are not known"
        fixed = frames.fixed_tool()
        if fixed is not None:
            return f"{source.at_line(fixed)} moves a workpiece at a fixed tool"
        tools, bases = ([frame for place in own for frame in frames.at(kind, place)] for kind in ("TOOL", "BASE"))
        return tools, bases

    targets, without = framed(fits, frames_of)
    notes = external_axes(outside)
    return ProgramTargets(tuple(targets), tuple(sorted([*left, *without], key=lambda each: each.line)), notes)


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
        name, index = assigned[2], assigned[3]
        if assigned[1]:
            return name, "a component of a structure"
        if name.startswith("$") or name.upper() in ("BASE_DATA", "TOOL_DATA"):
            is_frame = re.fullmatch(r"\$?(BASE|TOOL)(_DATA)?", name, re.IGNORECASE)
            return name, "the definition of a tool or base" if is_frame else "a variable of the system"
        kind = types.get(name.upper(), "")
        if kind not in ("", "FRAME", *_POSITIONS):
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


@dataclass(frozen=True)
class _Use:
    """One use of a variable."""

    place: int
    motion: str = ""  # upper case, where the variable is its destination, or the start of one
    sets: str = ""  # component that is set anew, without the variable itself


def _uses(source: Source, names: set[str]) -> dict[str, list[_Use]]:
    """Uses of variables by their upper-case names, their own assignments left out."""
    found: dict[str, list[_Use]] = {}
    for word in source.words:
        name = word.text.upper()
        if name not in names or source.code[word.place - 1 : word.place] in (".", "#"):
            continue
        behind = source.code[word.place + len(word.text) : source.line_end(word.place)]
        rest = _INDEX.sub("", behind, count=1)
        component = _COMPONENT_SET.match(rest)
        if component is not None:
            again = re.search(rf"\b{re.escape(word.text)}\b", component[2], re.IGNORECASE)
            found.setdefault(name, []).append(_Use(word.place, sets="" if again else component[1]))
            continue
        if re.match(r"\s*=(?!=)", rest) or _DECLARES.match(source.code, source.line_start(word.place)):
            continue
        motion = _first_word(source, word.place).upper()
        before = source.code[source.line_start(word.place) : word.place]
        is_first = re.fullmatch(r"\s*\w+\s+", before) is not None
        is_second = motion in _CIRCULAR and before.rstrip().endswith(",")
        fits = motion in _MOTIONS and (is_first or is_second) and not rest.lstrip().startswith((".", "("))
        found.setdefault(name, []).append(_Use(word.place, motion if fits else ""))
    return found


def _unfit(source: Source, held: ParsedTarget, uses: list[_Use], types: dict[str, str]) -> str:
    """Reason why a variable with these uses holds no target; "" where it does."""
    changed = next((use for use in uses if use.sets), None)
    if changed is not None:
        return f"{source.at_line(changed.place)} sets its {changed.sets} anew"
    if types.get(held.variable) == "FRAME" and not (uses and all(use.motion for use in uses)):
        return "a FRAME, no position"
    return ""


class _Frames:
    """Tools and bases of a program: what may be set at places, and the numbered data."""

    def __init__(self, source: Source, places: Iterable[int]) -> None:
        self._source = source
        self._by_start = {group.start: group for group in source.groups if group.bracket == "{"}
        self._data: dict[tuple[str, int], NamedFrame] = {}
        for match in _DATA.finditer(source.code):
            equals = re.compile(r"\s*=(?!=)\s*").match(source.code, match.end())
            if equals is not None:
                key = (match[1].upper(), int(match[2][:9]))
                frame = NamedFrame(_name(*key), self._literal(equals.end()))
                known = self._data.setdefault(key, frame)
                self._data[key] = frame if known == frame else NamedFrame(_name(*key), None)
        self._variables = self._read_variables()
        self._fixed = {match.start() for match in _FIXED_TOOL.finditer(source.code)}
        self._fdat = self._read_fdat()
        blocks = list(_blocks(source))
        uses = [FlowEvent[NamedFrame](place, "use") for place in places]
        self._at = {
            kind: reaching([*blocks, *self._sets(kind), *uses], NamedFrame(_UNKNOWN[kind], None), top_first=False)
            for kind in ("TOOL", "BASE")
        }

    def at(self, kind: str, place: int) -> Iterable[NamedFrame]:
        """Frames that may be set at a place."""
        source = self._source
        of_motion = [
            match
            for match in _FRAME_SET.finditer(source.code, place, source.line_end(place))
            if match[1].upper() == kind
        ]
        if of_motion:
            return [self._set(of_motion[0])]
        return self._at[kind].get(place) or [NamedFrame(_UNKNOWN[kind], None)]

    def numbered(self, name: str) -> tuple[list[NamedFrame], list[NamedFrame]] | str | None:
        """Tool and base of a point by its FDAT: that of XP1 is FP1."""
        return self._fdat.get("F" + name.removeprefix("X"))

    def fixed_tool(self) -> int | None:
        """Place at which the program's motions change to a fixed tool; None where they do not."""
        return min(self._fixed, default=None)

    def _sets(self, kind: str) -> list[FlowEvent[NamedFrame]]:
        source = self._source
        found = [
            FlowEvent(match.start(), "set", value=self._set(match))
            for match in _FRAME_SET.finditer(source.code)
            if match[1].upper() == kind and _first_word(source, match.start()).upper() not in _MOTIONS
        ]
        for match in _BAS.finditer(source.code):
            number = match[2]
            if match[1].upper() == kind:
                unknown = NamedFrame(f"{kind}_DATA[{number}]", None)
                frame = self._number(kind, int(number[:9])) if number.isdigit() else unknown
                found.append(FlowEvent(match.start(), "set", value=frame))
        for match in _ACTIVE.finditer(source.code):
            known = self._fdat.get(match[1].upper())
            frames = known[kind == "BASE"] if isinstance(known, tuple) else []
            frame = frames[0] if frames else NamedFrame(f"the {kind.lower()} of {match[1]}", None)
            found.append(FlowEvent(match.start(), "set", value=frame))
        return found

    def _number(self, kind: str, number: int) -> NamedFrame:
        if number == 0:
            return NamedFrame("$NULLFRAME", np.eye(4))
        return self._data.get((kind, number), NamedFrame(_name(kind, number), None))

    def _set(self, match: re.Match[str]) -> NamedFrame:
        source, kind, place = self._source, match[1].upper(), match.end()
        rest = source.code[place : source.line_end(place)].strip()
        name = f"${kind} of {source.at_line(match.start())}"
        if match[2]:  # a component of the frame
            return NamedFrame(name, None)
        value = re.split(r"\s*,\s*\$|\s+C_\w+", rest, maxsplit=1)[0]
        if value.upper() == "$NULLFRAME" or (kind == "BASE" and value.upper() in ("$WORLD", "$ROBROOT")):
            return NamedFrame(value, np.eye(4))
        data = _DATA.fullmatch(value)
        if data is not None and data[1].upper() == kind:
            return self._number(kind, int(data[2][:9]))
        if value.upper() in self._variables:
            return NamedFrame(value, self._variables[value.upper()])
        return NamedFrame(name, self._literal(place))

    def _read_variables(self) -> dict[str, np.ndarray | None]:
        """Frames that variables hold, by their upper-case names; None where one is set several times or in parts."""
        found: dict[str, np.ndarray | None] = {}
        for match in _VARIABLE_SET.finditer(self._source.code):
            name = match[1].upper()
            transform = None if match[2] else self._literal(match.end())
            found[name] = None if name in found else transform
        return found

    def _literal(self, place: int) -> np.ndarray | None:
        """Transform (4, 4) of the whole aggregate at a place; None where there is no plain one."""
        group = self._by_start.get(place)
        if group is None:
            return None
        parts = _components(self._source, group)
        rest = self._source.code[group.end : self._source.line_end(group.end)].strip()
        if (rest and not re.match(r",\s*\$|C_\w+", rest)) or set(parts) != set(POSE):
            return None
        numbers = self._source.numbers([parts[each] for each in POSE])
        return None if isinstance(numbers, str) else pose_transform("KRL", _values(numbers))

    def _read_fdat(self) -> dict[str, tuple[list[NamedFrame], list[NamedFrame]] | str]:
        found: dict[str, tuple[list[NamedFrame], list[NamedFrame]] | str] = {}
        for match in re.finditer(r"\bFDAT\s+([A-Za-z_]\w*)\s*=\s*", self._source.code, re.IGNORECASE):
            group = self._by_start.get(match.end())
            if group is None:
                continue
            inside = self._source.code[group.start : group.end]
            numbers = {m[1].upper(): int(m[2][:9]) for m in _NUMBER_OF.finditer(inside)}
            fixed = {place for place in self._fixed if group.start <= place < group.end}
            self._fixed -= fixed
            if fixed:
                found[match[1].upper()] = "it moves a workpiece at a fixed tool (IPO_FRAME #TCP)"
            elif {"TOOL", "BASE"} <= set(numbers):
                pair = ([self._number("TOOL", numbers["TOOL"])], [self._number("BASE", numbers["BASE"])])
                found[match[1].upper()] = pair
        return found


def _blocks(source: Source) -> Iterable[FlowEvent[NamedFrame]]:
    """Marks of the program's routines, branches, loops and calls."""
    for match in _STATEMENT.finditer(source.code):
        word, place = match[1].upper(), match.start(1)
        if word in ("DEF", "DEFFCT"):
            name = re.compile(r"[^\r\n(]*?(\w+)\s*\(").match(source.code, match.end())
            yield FlowEvent(place, "routine", name[1].upper() if name else "")
        elif word in ("IF", "SWITCH"):
            yield FlowEvent(place, "if", word)
            if word == "SWITCH":  # nothing stands before the first CASE
                continue
        elif word in ("ELSE", "CASE", "DEFAULT"):
            yield FlowEvent(place, "else", "case" if word == "CASE" else "")
        elif word in ("FOR", "WHILE"):
            yield FlowEvent(place, "loop")
        elif word in ("LOOP", "REPEAT"):
            yield FlowEvent(place, "loop", "always")
        elif word in ("END", "ENDFCT", "ENDIF", "ENDSWITCH", "ENDFOR", "ENDWHILE", "ENDLOOP", "UNTIL"):
            yield FlowEvent(place, "end")
        if word not in ("DEF", "DEFFCT", "EXT", "EXTFCT", "EXTFCTP", "DECL"):
            line = source.code[place : source.line_end(place)]
            for call in re.finditer(r"(?<![\w$#.])([A-Za-z_]\w*)\s*\(", line):
                yield FlowEvent(place + call.start(), "call", call[1].upper())


def _name(kind: str, number: int) -> str:
    return f"{kind}_DATA[{number}]"


def _values(numbers: tuple[Number, ...]) -> np.ndarray:
    return np.array([number.value for number in numbers])
