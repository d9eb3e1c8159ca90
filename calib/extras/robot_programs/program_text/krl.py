"""Targets in KRL: aggregates of A1 ... A6, or of X, Y, Z, A, B and C, in motions, assignments and .dat files.

A .dat file of inline forms tells tool and base by their numbers (`DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,...}` for the
point XP1); number 0 is the flange and the robot's base, the others are known where the file has TOOL_DATA and
BASE_DATA. Status and turn: KUKA, *KSS System Software, Operating and Programming Instructions for System Integrators*.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from math import inf
from typing import Never

import numpy as np

from calib.extras.robot_programs.program_text.flow import FlowEvent
from calib.extras.robot_programs.program_text.motions import COMPUTED, Frames, Literal, Reading, Visit
from calib.extras.robot_programs.program_text.pose_numbers import pose_transform
from calib.extras.robot_programs.program_text.source import (
    Configuration,
    Group,
    NamedFrame,
    ProgramTargets,
    Source,
)

MASKED = re.compile(r"\"[^\"\r\n]*\"?|;[^\r\n]*|(?:(?<=\n)|(?<=\r)|\A)[ \t]*&[^\r\n]*")
JOINTS = ("A1", "A2", "A3", "A4", "A5", "A6")
POSE = ("X", "Y", "Z", "A", "B", "C")
_EXTERNAL = {"E1", "E2", "E3", "E4", "E5", "E6"}
_COMPONENTS = {*JOINTS, *POSE, "S", "T", *_EXTERNAL}
_JOINT_MOTIONS = {"PTP", "SPTP"}
_CIRCULAR = {"CIRC", "SCIRC"}
_MOTIONS = {*_JOINT_MOTIONS, "LIN", "SLIN", "SPL", *_CIRCULAR}
_NO_POSITION = re.compile(r"\b(FRAME|FDAT|LDAT|PDAT|LOAD)[ \t]+([A-Za-z_]\w*)", re.IGNORECASE)
_COMPONENT = re.compile(r"\s*([A-Za-z_]\w*)\s+(\S.*?)\s*", re.DOTALL)
_HELD = re.compile(r"([\w$\]]*\.)?(\$?[A-Za-z_]\w*)\s*(?:\[\s*([^\]]*?)\s*\])?\s*(?<![=<>])=$")
_CHANGED = re.compile(
    r"^[ \t]*([A-Za-z_]\w*)[ \t]*(?:\[[^\]\r\n]*\])?[ \t]*\.[ \t]*(\w+)[ \t]*=(?!=)([^\r\n]*)",
    re.IGNORECASE | re.MULTILINE,
)
_STATEMENT = re.compile(r"(?:\A|(?<=[\r\n]))[ \t]*(?:GLOBAL[ \t]+)?([A-Za-z_]\w*)", re.IGNORECASE)
_AIM = re.compile(r"\s*([A-Za-z_]\w*)\s*(?:\[\s*([^\]\r\n]*?)\s*\])?\s*(?=[,:\r\n]|C_|WITH\b|$)", re.IGNORECASE)
_FRAME_SET = re.compile(r"(?<![\w$])\$(BASE|TOOL)\b(\.\w+)?\s*=(?!=)\s*", re.IGNORECASE)
_BAS = re.compile(r"\bBAS\s*\(\s*#(BASE|TOOL)\s*,\s*(\w+)\s*\)", re.IGNORECASE)
_ACTIVE = re.compile(r"\bFDAT_ACT\s*=\s*([A-Za-z_]\w*)", re.IGNORECASE)
_DATA = re.compile(r"\$?(BASE|TOOL)_DATA\s*\[\s*(\d+)\s*\]", re.IGNORECASE)
_FDAT = re.compile(r"\bFDAT\s+F(\w+)\s*=\s*(\{[^}]*\})", re.IGNORECASE)
_NUMBER_OF = re.compile(r"\b(BASE|TOOL)_NO\s+(\d{1,9})", re.IGNORECASE)
_FIXED_TOOL = re.compile(r"\$IPO_MODE\s*=\s*#TCP\b", re.IGNORECASE)
_BLOCKS: dict[str, tuple[str, str]] = {  # kind and name of the event
    "IF": ("if", ""), "SWITCH": ("if", "SWITCH"), "ELSE": ("else", ""), "DEFAULT": ("else", ""),
    "CASE": ("else", "case"), "FOR": ("loop", ""), "WHILE": ("loop", ""), "LOOP": ("loop", "always"),
    "REPEAT": ("loop", "always"), "UNTIL": ("end", ""),
    **dict.fromkeys(("END", "ENDFCT", "ENDIF", "ENDSWITCH", "ENDFOR", "ENDWHILE", "ENDLOOP"), ("end", "")),
}  # fmt: skip


def krl_targets(source: Source) -> ProgramTargets:
    """Targets of a KRL source or data file. Raises CalibError where brackets do not match."""
    frames = _Frames.of(source)
    visits = list(_visits(source, frames))
    inline = {visit.place: source.first_word(visit.place).upper() for visit in visits if not visit.variable}
    changed, no_position = _changed(source), _no_positions(source, {visit.variable for visit in visits})
    reading = Reading(source, visits)
    for group in source.own_groups:
        parts = _components(source, group)
        names = set(parts)
        if not names or not names <= _COMPONENTS or not names & {*JOINTS, *POSE}:
            continue
        name, element, wrong = inline.get(group.start, ""), "", ""
        if not name:
            name, element, wrong = _holder(source, group, no_position)
        wanted = JOINTS if names & set(JOINTS) else POSE
        if not wrong and not set(wanted) <= names:
            missing = ", ".join(each for each in wanted if each not in names)
            wrong = f"part of a position: the controller keeps the present {missing}"
        if wrong:
            reading.leave(group.start, group.end, wrong)
            continue
        variable = name.upper()
        reason, tool, work = changed.get(variable, ""), None, None
        numbered = frames.of_point.get(variable.removeprefix("X")) if group.start not in inline else None
        if isinstance(numbered, str):
            reason = numbered
        elif numbered is not None:
            tool, work = numbered
        elif wanted is POSE and not reason and frames.fixed_tool is not None:
            reason = f"{source.at_line(frames.fixed_tool)} moves a workpiece at a fixed tool"
        external = source.numbers([span for each, span in parts.items() if each in _EXTERNAL])
        reading.take(
            Literal(
                f"{name}[{element}]" if element else name, group.start, group.end,
                "pose" if wanted is POSE else "joints", [parts[each] for each in wanted], variable, element,
                _configuration(source, parts), tool=tool, work=work, reason=reason,
                moves_external=isinstance(external, str) or any(number.value for number in external),
            )
        )  # fmt: skip
    return reading.result(
        list(_structure(source)), frames.set_at("TOOL"), frames.set_at("BASE"), acts=bool(visits), top_first=False
    )


def _components(source: Source, group: Group) -> dict[str, tuple[int, int]]:
    """Places of an aggregate's values by the names of its components, upper case; {} for anything else."""
    found: dict[str, tuple[int, int]] = {}
    for k, (start, end) in enumerate(group.items if group.bracket == "{" and not group.children else []):
        if k == 0:  # {E6POS: X 1, ...}
            prefix = re.match(r"\s*\w+\s*:", source.code[start:end])
            start += prefix.end() if prefix else 0
        match = _COMPONENT.fullmatch(source.code, start, end)
        if match is None or match[1].upper() in found:
            return {}
        found[match[1].upper()] = match.span(2)
    return found


def _holder(source: Source, group: Group, no_position: dict[str, str]) -> tuple[str, str, str]:
    """Variable that holds an aggregate, the element of an array, and why it is no target ("" where it is)."""
    held = _HELD.search(source.before(group.start))
    if source.first_word(group.start).upper().endswith("_REL"):
        return "", "", "a relative motion"
    if held is None or group.parent is not None:
        return "", "", "an argument or part of an expression"
    if held[1] or held[2].startswith("$") or held[2].upper() in ("BASE_DATA", "TOOL_DATA"):
        return held[2], "", "the definition of a tool or base, or another variable of the system"
    kind = no_position.get(held[2].upper())
    return held[2], held[3] or "", f"a {kind}, no position" if kind else ""


def _no_positions(source: Source, visited: set[str]) -> dict[str, str]:
    """Types of the variables, upper case, that are declared as something else; a FRAME may be moved to."""
    declared = {match[2].upper(): match[1].upper() for match in _NO_POSITION.finditer(source.code)}
    return {name: kind for name, kind in declared.items() if kind != "FRAME" or name not in visited}


def _changed(source: Source) -> dict[str, str]:
    """Reasons why variables are left, upper case: one of their components is set anew, not from the old value."""
    return {
        match[1].upper(): f"{source.at_line(match.start(1))} sets its {match[2]} anew"
        for match in _CHANGED.finditer(source.code)
        if not re.search(rf"\b{match[1]}\b", match[3], re.IGNORECASE)
    }


def _configuration(source: Source, parts: dict[str, tuple[int, int]]) -> Configuration:
    """Posture by status and turn.

    Bits of S: the wrist is behind axis 1; ahead of the line from axis 2 to axis 3; axis 5 is negative. Those of T:
    each axis is negative.
    """
    status, turns = (_bits(source, parts[name]) if name in parts else None for name in "ST")
    ranges: tuple[tuple[float, float], ...] = ()
    if turns is not None:
        ranges = tuple(_sign_range(turns >> k & 1) for k in range(6))
    elif status is not None:
        ranges = tuple(_sign_range(status >> 2 & 1) if k == 4 else (-inf, inf) for k in range(6))
    if status is None:
        return Configuration(ranges)
    return Configuration(ranges, behind=bool(status & 1), elbow=bool(status & 2))


def _sign_range(negative: int) -> tuple[float, float]:
    return (-inf, 0.0) if negative else (0.0, inf)


def _bits(source: Source, span: tuple[int, int]) -> int | None:
    """Whole number of a status or turn, such as 35, 'B100011' or 'H23'; None for anything else."""
    text = source.code[slice(*span)].strip().replace(" ", "").upper()
    found = re.fullmatch(r"'B([01]{1,8})'|'H([0-9A-F]{1,2})'|(\d{1,3})", text)
    if found is None:
        return None
    return int(found[1], 2) if found[1] else int(found[2], 16) if found[2] else int(found[3])


def _visits(source: Source, frames: _Frames) -> Iterable[Visit]:
    """Motions of the program."""
    for match in _STATEMENT.finditer(source.code):
        motion, place = match[1].upper(), match.end()
        if motion in ("PTP_REL", "SPTP_REL"):
            yield Visit(place, COMPUTED, is_joint=True)
        if motion not in _MOTIONS:
            continue
        line_end = source.line_end(place)
        tool, work = (frames.of_motion(kind, place, line_end) for kind in ("TOOL", "BASE"))
        for _ in range(2 if motion in _CIRCULAR else 1):
            place += len(source.code[place:line_end]) - len(source.code[place:line_end].lstrip())
            group, aim = source.by_start.get(place), _AIM.match(source.code, place, line_end)
            after = source.code[group.end : line_end].lstrip() if group else ""
            if group is not None and not after.startswith(":"):
                variable, element, end = "", "", group.end
            elif aim is not None:
                index = aim[2]
                variable, element, end = aim[1].upper(), index if not index or index.isdigit() else COMPUTED, aim.end()
            else:
                variable, element, end = COMPUTED, "", line_end
            is_joint = motion in _JOINT_MOTIONS
            yield Visit(place, variable, element or "", is_joint, keeps=not is_joint, tool=tool, work=work)
            place = source.code.find(",", end, line_end) + 1
            if not place:
                break


@dataclass(frozen=True)
class _Frames:
    """Tools and bases of a program."""

    source: Source
    data: dict[tuple[str, int], NamedFrame]  # numbered ones
    of_point: dict[str, tuple[NamedFrame, NamedFrame] | str]  # of points of inline forms, by their names without X
    fixed_tool: int | None  # place at which motions change to a fixed tool

    @classmethod
    def of(cls, source: Source) -> _Frames:
        """Frames that a program and its data files define."""
        data: dict[tuple[str, int], NamedFrame] = {}
        for match in _DATA.finditer(source.code):
            equals = re.compile(r"\s*=(?!=)\s*").match(source.code, match.end())
            if equals is not None:
                key, name = (match[1].upper(), int(match[2][:9])), match[0].lstrip("$").upper()
                frame = NamedFrame(name, _frame(source, equals.end()))
                data[key] = frame if data.setdefault(key, frame) == frame else NamedFrame(name, None)
        fixed = _FIXED_TOOL.search(source.code)
        found = cls(source, data, {}, None if fixed is None else fixed.start())
        for match in _FDAT.finditer(source.code):
            numbers = {m[1].upper(): int(m[2]) for m in _NUMBER_OF.finditer(match[2])}
            if "#TCP" in match[2].upper():
                found.of_point[match[1].upper()] = "it moves a workpiece at a fixed tool (IPO_FRAME #TCP)"
            elif len(numbers) == 2:
                pair = (found.numbered("TOOL", numbers["TOOL"]), found.numbered("BASE", numbers["BASE"]))
                found.of_point[match[1].upper()] = pair
        return found

    def numbered(self, kind: str, number: int) -> NamedFrame:
        """Tool or base by its number."""
        unknown = NamedFrame(f"{kind}_DATA[{number}]", None)
        return self.data.get((kind, number), unknown) if number else NamedFrame("$NULLFRAME", np.eye(4))

    def of_motion(self, kind: str, start: int, end: int) -> NamedFrame | None:
        """Frame that a motion itself sets behind WITH; None where it does not."""
        return next(
            (self._set(m) for m in _FRAME_SET.finditer(self.source.code, start, end) if m[1].upper() == kind), None
        )

    def set_at(self, kind: str) -> Frames:
        """Where frames of a kind are set outside of motions."""
        code, first_word = self.source.code, self.source.first_word
        sets = [
            FlowEvent(match.start(), "set", value=self._set(match))
            for match in _FRAME_SET.finditer(code)
            if match[1].upper() == kind and first_word(match.start()).upper() not in _MOTIONS
        ]
        for match in _BAS.finditer(code):
            if match[1].upper() == kind:
                unknown = NamedFrame(f"{kind}_DATA[{match[2]}]", None)
                frame = self.numbered(kind, int(match[2][:9])) if match[2].isdigit() else unknown
                sets.append(FlowEvent(match.start(), "set", value=frame))
        for match in _ACTIVE.finditer(code):
            sets.append(FlowEvent(match.start(), "set", value=NamedFrame(f"the {kind.lower()} of {match[1]}", None)))
        return Frames(NamedFrame(f"the {kind.lower()} (the file sets no ${kind})", None), sets)

    def _set(self, match: re.Match[str]) -> NamedFrame:
        source, kind, place = self.source, match[1].upper(), match.end()
        value = re.split(r"\s*,\s*\$|\s+C_\w+", source.code[place : source.line_end(place)].strip(), maxsplit=1)[0]
        if value.upper() == "$NULLFRAME" or (kind == "BASE" and value.upper() in ("$WORLD", "$ROBROOT")):
            return NamedFrame(value, np.eye(4))
        data = _DATA.fullmatch(value)
        if data is not None and data[1].upper() == kind and not match[2]:
            return self.numbered(kind, int(data[2][:9]))
        plain = re.fullmatch(r"[A-Za-z_]\w*", value) is not None and not match[2]
        name = value if plain else f"${kind} of {source.at_line(match.start())}"
        return NamedFrame(name, None if match[2] else _frame(source, place))


def _frame(source: Source, place: int) -> np.ndarray | None:
    """Transform (4, 4) of the whole aggregate at a place; None where there is no plain one."""
    group = source.by_start.get(place)
    parts = {} if group is None else _components(source, group)
    if group is None or set(parts) != set(POSE):
        return None
    rest = source.code[group.end : source.line_end(group.end)].strip()
    numbers = source.numbers([parts[each] for each in POSE])
    if isinstance(numbers, str) or (rest and not re.match(r",\s*\$|C_\w+", rest)):
        return None
    return pose_transform("KRL", np.array([number.value for number in numbers]))


def _structure(source: Source) -> Iterable[FlowEvent[Never]]:
    """The program's routines, branches, loops and calls."""
    for match in _STATEMENT.finditer(source.code):
        word, place = match[1].upper(), match.start(1)
        line = source.code[place : source.line_end(place)]
        if word in ("DEF", "DEFFCT"):
            name = re.match(r"[^\r\n(]*?(\w+)\s*\(", line)
            yield FlowEvent(place, "routine", name[1].upper() if name else "")
        elif word in _BLOCKS:
            kind, name_ = _BLOCKS[word]
            yield FlowEvent(place, kind, name_)  # type: ignore[arg-type]
        if word not in ("DEF", "DEFFCT", "EXT", "EXTFCT", "EXTFCTP", "DECL", "SWITCH"):
            for call in re.finditer(r"(?<![\w$#.])([A-Za-z_]\w*)\s*\(", line):
                yield FlowEvent(place + call.start(), "call", call[1].upper())
