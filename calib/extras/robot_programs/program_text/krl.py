"""Targets in KRL: aggregates of A1 ... A6, or of X, Y, Z, A, B and C, in motions, assignments and .dat files.

A .dat file of inline forms tells tool and base by their numbers (`DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,...}` for the
point XP1); number 0 is the flange and the robot's base, the others are known where the file has TOOL_DATA and
BASE_DATA. Status and turn: KUKA, *KSS System Software, Operating and Programming Instructions for System Integrators*.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from math import inf

import numpy as np

from calib.array_types import Array
from calib.extras.robot_programs.program_text.flow import FlowKind
from calib.extras.robot_programs.program_text.pose_numbers import pose_transform
from calib.extras.robot_programs.program_text.reading import (
    COMPUTED,
    Aim,
    Assignment,
    FrameKind,
    Held,
    ProgramReader,
    Told,
    Visit,
)
from calib.extras.robot_programs.program_text.source import Item, Part, Statement, Syntax
from calib.extras.robot_programs.program_text.targets import Configuration, NamedFrame, ProgramTarget

_BLOCKS: dict[str, FlowKind] = {
    "def": "routine", "deffct": "routine", "if": "if", "switch": "switch", "else": "otherwise", "case": "else",
    "default": "otherwise", "for": "loop", "while": "loop", "loop": "always", "repeat": "always", "until": "end",
    **dict.fromkeys(("end", "endfct", "endif", "endswitch", "endfor", "endwhile", "endloop"), "end"),
}  # fmt: skip
_JOINTS = ("a1", "a2", "a3", "a4", "a5", "a6")
_POSE = ("x", "y", "z", "a", "b", "c")
_EXTERNAL = ("e1", "e2", "e3", "e4", "e5", "e6")
_MOTIONS = {"ptp": 1, "sptp": 1, "lin": 1, "slin": 1, "spl": 1, "circ": 2, "scirc": 2}  # and how many targets each has
_NULL = {"$nullframe": ("tool", "base"), "$world": ("base",), "$robroot": ("base",)}
_NO_POSITION = re.compile(r"\$|(base|tool)_data")
_NAMES = {"tool": "tool", "work": "base"}
_FIXED = "moves a workpiece at a fixed tool"


class KrlReader(ProgramReader):
    """Targets of a KRL source or data file."""

    language, blocks = "KRL", _BLOCKS
    syntax = Syntax(re.compile(r"\"[^\"\r\n]*\"?|;[^\r\n]*|(?:(?<=\n)|(?<=\r)|\A)[ \t]*&[^\r\n]*"), "\r\n", "([")

    def moves(self, statement: Statement) -> Iterable[Visit]:
        """The motions of a line; where a relative joint motion ends is not known."""
        motion = statement[0].parts[0]
        is_joint = motion.text.removesuffix("_rel").endswith("ptp")
        if motion.text in ("ptp_rel", "sptp_rel"):
            yield Visit(Aim(motion.end), is_joint=True)
        for item in (statement[0].behind(1), *statement[1:])[: _MOTIONS.get(motion.text, 0)]:
            aim = self.aim(replace(item, parts=item.parts[:1]))
            if aim.literal is not None and ":" in [part.text for part in item.parts[1:2]]:
                aim = Aim(aim.place)  # an offset from it
            own = self._with(statement)
            name = self.text(motion).upper()
            yield Visit(aim, name, is_joint, not is_joint, tool=own.get("tool"), work=own.get("base"))

    def _with(self, statement: Statement) -> dict[str, NamedFrame]:
        """Frames that a motion sets behind WITH, by their kinds."""
        places = [part.start for item in statement for part in item.parts]
        return {each.name[1:]: self._frame(each) for place in places if (each := self._set_places.get(place))}

    @cached_property
    def _set_places(self) -> dict[int, Assignment]:
        return {each.place: each for kind in ("tool", "base") for each in self._sets(kind)}

    def told(self, held: Held) -> Told | str | None:
        """The target of an aggregate."""
        parts = _components(held.literal)
        wanted = _JOINTS if parts.keys() & {*_JOINTS} else _POSE
        if not parts.keys() <= {*_JOINTS, *_POSE, *_EXTERNAL, "s", "t"} or not parts.keys() & {*wanted}:
            return None
        missing = ", ".join(each.upper() for each in wanted if each not in parts)
        if held.by is not None and (
            held.by.component or "frame" in held.by.before or _NO_POSITION.match(held.variable)
        ):
            return "a frame, the definition of a tool or base, or another variable of the system"
        if missing:
            return f"part of a position: the controller keeps the present {missing}"
        target = ProgramTarget("pose" if wanted is _POSE else "joints", configuration=self._configuration(parts))
        form = self._forms.get(held.variable.removeprefix("x"), {}) if held.variable else {}
        reason = self._fixed_tool if wanted is _POSE and not form else ""
        if "tcp" in [part.text for item in form.values() for part in item.parts]:
            reason = f"it {_FIXED} (IPO_FRAME #TCP)"
        if {"tool_no", "base_no"} <= form.keys():
            tool, work = (self._numbered(kind, self.text(form[f"{kind}_no"])) for kind in ("tool", "base"))
            target = replace(target, tool=tool, work=work)
        external = [parts[each] for each in _EXTERNAL if each in parts]
        return Told(target, [parts[each] for each in wanted], external, reason=reason)

    def _configuration(self, parts: dict[str, Item]) -> Configuration:
        """Posture by status and turn.

        Bits of S: the wrist is behind axis 1; ahead of the line from axis 2 to axis 3; axis 5 is negative. Those of T:
        each axis is negative.
        """
        status, turns = (_bits(self.text(parts[name])) if name in parts else None for name in "st")
        signs = [None if turns is None else turns >> k & 1 for k in range(6)]
        if turns is None and status is not None:
            signs[4] = status >> 2 & 1
        ranges = tuple((0.0 if sign == 0 else -inf, 0.0 if sign == 1 else inf) for sign in signs)
        if status is None:
            return Configuration() if turns is None else Configuration(ranges)
        return Configuration(ranges, behind=bool(status & 1), elbow=bool(status & 2))

    @cached_property
    def _forms(self) -> dict[str, dict[str, Item]]:
        """Components of the FDAT of inline forms, by the names of their points without X."""
        every = (
            each for one in self.assignments.values() for each in one if "fdat" in each.before and each.value.parts
        )
        return {each.name[1:]: _components(each.value.parts[0]) for each in every}

    @cached_property
    def _fixed_tool(self) -> str:
        """Why poses are left of a program whose tool stands still; "" where it moves."""
        for each in self.assignments.get("$ipo_mode", []):
            if "tcp" in [part.text for part in each.value.parts]:
                return f"{self.source.at_line(each.place)} {_FIXED}"
        return ""

    def _plain(self, value: Item) -> Array | None:
        """Transform (4, 4) of an aggregate of plain numbers, whatever follows it; None for anything else."""
        parts = _components(value.parts[0]) if value.parts else {}
        numbers = self.source.numbers([parts[each] for each in _POSE]) if parts.keys() == {*_POSE} else ""
        return None if isinstance(numbers, str) else pose_transform("KRL", np.array([n.value for n in numbers]))

    def _numbered(self, kind: str, number: str) -> NamedFrame:
        """Tool or base by its number, if all that the files say of it is the same."""
        name = f"{kind}_data"
        every = [one for each in (name, f"${name}") for one in self.assignments.get(each, []) if one.index == number]
        frames = {NamedFrame(f"{name.upper()}[{number}]", self._plain(each.value)) for each in every}
        if number == "0":
            return NamedFrame("$NULLFRAME", np.eye(4))
        return frames.pop() if len(frames) == 1 else NamedFrame(f"{name.upper()}[{number}]", None)

    def _sets(self, kind: str) -> list[Assignment]:
        """Where the frame of a kind is set, in motions or by themselves."""
        return self.assignments.get(f"${kind}", [])

    def _frame(self, each: Assignment) -> NamedFrame:
        """Frame that an assignment sets."""
        kind, name = each.name[1:], self.text(each.value)
        aim = self.aim(replace(each.value, parts=each.value.parts[:1]))
        if not each.component and aim.literal is None:
            if kind in _NULL.get(aim.variable, ()):
                return NamedFrame(name, np.eye(4))
            if aim.variable.removeprefix("$") == f"{kind}_data" and aim.element != COMPUTED:
                return self._numbered(kind, aim.element)
            if aim.variable != COMPUTED and not aim.element:
                return NamedFrame(name, None)
        transform = None if each.component else self._plain(each.value)
        return NamedFrame(f"${kind.upper()} of {self.source.at_line(each.place)}", transform)

    def before(self, kind: FrameKind) -> NamedFrame:
        """Tool or base at the program's start."""
        return NamedFrame(f"the {_NAMES[kind]} (the file sets no ${_NAMES[kind].upper()})", None)

    def sets(self, kind: FrameKind) -> Iterable[tuple[int, NamedFrame]]:
        """Places and frames: set outside of motions, directly, by an inline form and by BAS."""
        name = _NAMES[kind]
        for each in self._sets(name):
            if not {*each.before} & _MOTIONS.keys():
                yield each.place, self._frame(each)
        for each in self.assignments.get("fdat_act", []):
            yield each.place, NamedFrame(f"the {name} of {self.text(each.value)}", None)
        for call, _ in self.source.parts:
            texts = [part.text for item in call.items for part in item.parts]
            if call.text == "bas" and texts[:2] == ["#", name]:
                yield call.start, self._numbered(name, "".join(texts[2:]))


def _components(brackets: Part) -> dict[str, Item]:
    """Values of an aggregate by the names of its components, lower case; "" for what is none."""
    found: dict[str, Item] = {}
    for item in brackets.items if brackets.bracket == "{" else ():
        item = item.behind(2) if [part.text for part in item.parts[1:2]] == [":"] else item  # {E6POS: X 1, ...}
        name = item.parts[0].text if len(item.parts) > 1 and item.parts[0].is_word else ""
        found["" if name in found else name] = item.behind(1) if name else item
    return found


def _bits(text: str) -> int | None:
    """Whole number of a status or turn, such as 35, 'B100011' or 'H23'; None for anything else."""
    found = re.fullmatch(r"'b([01]{1,8})'|'h([0-9a-f]{1,2})'|(\d{1,3})", "".join(text.lower().split()))
    groups = () if found is None else zip(found.groups(), (2, 16, 10), strict=True)
    return next((int(digits, base) for digits, base in groups if digits), None)
