"""Targets in URScript: joint lists and poses that are assigned, or given to a motion directly.

A variable that holds six numbers may also be a wrench or a speed. So an assigned list counts as a target where a motion
of the same program uses the variable, or where the program does nothing, as a list of points. The pose that
`pose_trans` puts behind a frame is a target in that frame, unless the frame is itself a target, with which it moves.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import zip_longest
from math import pi
from typing import Never

import numpy as np

from calib.extras.robot_programs.program_text.flow import FlowEvent
from calib.extras.robot_programs.program_text.motions import COMPUTED, Frames, Literal, Reading, Visit
from calib.extras.robot_programs.program_text.pose_numbers import pose_transform
from calib.extras.robot_programs.program_text.source import (
    Group,
    NamedFrame,
    ProgramTargets,
    Source,
    Word,
)

MASKED = re.compile(r"\"[^\"\r\n]*\"?|'[^'\r\n]*'?|#[^\r\n]*")
_MOTIONS = {"movej": 1, "movel": 1, "movep": 1, "movec": 2, "servoj": 1, "servoc": 1, "servol": 1}
_INVERSE = ("get_inverse_kin", "get_inverse_kin_has_solution")
_GOES = _MOTIONS | dict.fromkeys((*_INVERSE, "get_forward_kin"), 1)
"""Functions, and how many of their first arguments are targets."""
_JOINT_MOTIONS = {"movej", "servoj", *_INVERSE}
_JUMPS = {"speedj", "freedrive_mode", "teach_mode"}  # which leave the arm in any posture
_KEYWORDS = {"q", "x", "pose", "pose_to", "pose_via"}
_NEAR, _TCP = "qnear", "set_tcp"
_PLAIN = {"d2r", "pose_trans", _TCP}  # calls in a list of points
_UNITS = {"d2r": pi / 180.0}
_BLOCKS = {"def": "routine", "thread": "routine", "sec": "routine", "if": "if", "while": "loop", "for": "loop"}
_NAME = re.compile(r"([A-Za-z_]\w*)\s*(?:\[\s*([^\]]*?)\s*\])?")
_KEYWORD = re.compile(r"\s*([A-Za-z_]\w*)\s*=(?!=)")
_VALUE = re.compile(r"[\w$]+\s*=(?!=)\s*")
_BASE = NamedFrame("base", np.eye(4))


def urscript_targets(source: Source) -> ProgramTargets:
    """Targets of a URScript program. Raises CalibError where brackets do not match."""
    return _Program(source).targets()


@dataclass(frozen=True)
class _Aim:
    """What an expression stands for: a variable, or a literal of six numbers, perhaps behind a frame."""

    place: int
    variable: str = COMPUTED
    element: str = ""
    group: Group | None = None  # of a literal
    is_pose: bool = False
    frame: tuple[int, int] | None = None  # first argument of pose_trans
    near: tuple[float, ...] = ()
    by_inverse: bool = False  # whether it is what get_inverse_kin finds there


class _Program:
    def __init__(self, source: Source) -> None:
        self._source, self._code = source, source.code
        self._acts = any(self._is_call(word) and word.text not in _PLAIN for word in source.words)
        self._assigned: dict[str, list[int]] = {}
        self._changed: dict[str, int] = {}  # variables of which a number is set anew, with the place
        for word in source.words:
            self._read_assignment(word)
        self._structure = list(self._blocks())
        calls = [self._call_at(mark.place) for mark in self._structure if mark.kind == "routine"]
        self._parameters = {
            self._code[start:end].partition("=")[0].strip() for call in calls if call for start, end in call.items
        } - {""}
        self._aims: dict[int, tuple[str, _Aim]] = {}  # of motions, with the function, by their places
        for group in source.groups:
            self._read_motion(group)
        self._visited = {aim.variable for _, aim in self._aims.values()}

    def targets(self) -> ProgramTargets:
        """Targets with their frames, and what else looks like one."""
        source = self._source
        visits = [
            Visit(
                aim.place, "" if aim.group else aim.variable, aim.element, near=aim.near,
                is_joint=aim.by_inverse or function in _JOINT_MOTIONS,
            )
            for function, aim in self._aims.values()
        ]  # fmt: skip
        reading = Reading(source, visits, _UNITS)
        seen: set[int] = set()
        for name, element, aim in (*((function, "", aim) for function, aim in self._aims.values()), *self._held()):
            if aim.group is not None and aim.group.start < source.own_end:
                seen.add(aim.group.start)
                reading.take(self._literal(name, element, aim, aim.group))
        for group in source.own_groups:
            start = self._start(group)
            if start is not None and group.start not in seen:
                function = source.function_of(group.parent) if group.parent and group.parent.bracket == "(" else ""
                reading.leave(start, group.end, f"an argument of {function}" if function else "part of an expression")
        tools = Frames(NamedFrame("the controller's own TCP (no set_tcp before it)", None), list(self._tools()))
        return reading.result(self._structure, tools, Frames(_BASE), acts=self._acts, top_first=True)

    def _start(self, group: Group) -> int | None:
        """Place at which a list or pose of six begins; None for anything else."""
        if group.bracket != "[" or any(child.bracket == "[" for child in group.children) or len(group.items) != 6:
            return None
        before = self._code[max(0, group.start - 2) : group.start]
        if before.endswith("p") and not (len(before) > 1 and (before[0].isalnum() or before[0] == "_")):
            return group.start - 1
        return None if before[-1:].isalnum() or before[-1:] in ("_", "]", ")") else group.start

    def _aim(self, start: int, end: int) -> _Aim:
        """What an expression stands for."""
        code = self._code
        start += len(code[start:end]) - len(code[start:end].lstrip())
        stop = start + len(code[start:end].rstrip())
        opening = re.compile(r"(?:p\s*)?(?=\[)|([A-Za-z_]\w*)\s*(?=\()").match(code, start, stop)
        group = self._source.by_start.get(opening.end()) if opening else None
        if opening is None or group is None or group.end != stop:
            name = _NAME.fullmatch(code, start, stop)
            if name is None:
                return _Aim(start)
            index = name[2] or ""
            return _Aim(start, name[1], index if not index or index.isdigit() else COMPUTED)
        if opening[1] is None:
            is_six = self._start(group) is not None
            return _Aim(start, group=group if is_six else None, is_pose=code[start] == "p")
        if opening[1] == "pose_trans" and len(group.items) == 2:
            inner = self._aim(*group.items[1])
            return replace(inner, frame=group.items[0]) if inner.group and inner.is_pose else _Aim(start)
        if opening[1] in _INVERSE:
            return replace(self._argument(*group.items[0])[1], near=self._near(group), by_inverse=True)
        return _Aim(start)

    def _argument(self, start: int, end: int) -> tuple[str, _Aim]:
        """Keyword of an argument, "" without one, and what it stands for."""
        keyword = _KEYWORD.match(self._code, start, end)
        return (keyword[1] if keyword else ""), self._aim(keyword.end() if keyword else start, end)

    def _read_motion(self, group: Group) -> None:
        """Keep what a call goes to, where it is a motion's, or asks for joints there."""
        function = self._source.function_of(group) if group.bracket == "(" else ""
        if function in _JUMPS:
            self._aims[group.start] = "movej", _Aim(group.start)
        for k, item in enumerate(group.items if function in _GOES else []):
            keyword, aim = self._argument(*item)
            if keyword in _KEYWORDS or (not keyword and k < _GOES[function]):
                self._aims.setdefault(aim.place, (function, aim))

    def _held(self) -> Iterable[tuple[str, str, _Aim]]:
        """Variables that are assigned literals, with the element where these stand in a list."""
        for name, places in self._assigned.items():
            for place in places:
                aim, group = self._value(place), self._source.by_start.get(self._value(place).place)
                if aim.group is not None and aim.place not in self._aims:
                    yield name, "", aim
                elif group is not None and group.bracket == "[":
                    for k, (start, end) in enumerate(group.items):
                        yield name, str(k), self._aim(start, end)

    def _value(self, place: int) -> _Aim:
        """What is assigned to the variable at a place."""
        start = _VALUE.match(self._code, place)
        assert start is not None, "an assignment has been read there"
        opening = re.compile(r"[\w\s]*?(?=[(\[])").match(self._code, start.end(), self._source.line_end(place))
        group = self._source.by_start.get(opening.end()) if opening else None
        end = self._source.line_end(place if group is None else group.end)
        return self._aim(start.end(), start.end() + len(self._code[start.end() : end].rstrip("; \t\r\n")))

    def _literal(self, name: str, element: str, aim: _Aim, group: Group) -> Literal:
        """Target of a literal that a variable holds or a motion has."""
        near = aim.near or (self._joints_of(name.removesuffix("_p") + "_q") if name.endswith("_p") else ())
        work = _BASE if aim.frame is None else self._frame(*aim.frame)
        reason = work if isinstance(work, str) else ""
        if name in self._changed:
            reason = f"{self._source.at_line(self._changed[name])} sets one of its numbers anew"
        elif name in self._parameters:
            reason = "a function of the program has a parameter of its name"
        return Literal(
            f"{name}[{element}]" if element else name, aim.place, group.end, "pose" if aim.is_pose else "joints",
            group.items, name, element, near=near, work=None if isinstance(work, str) else work, reason=reason,
        )  # fmt: skip

    def _frame(self, start: int, end: int) -> NamedFrame | str:
        """Frame that the first argument of a `pose_trans` is, or why the pose behind it is left."""
        aim = self._aim(start, end)
        if aim.group is not None:
            return self._plain_frame(aim, f"the frame of {self._source.at_line(start)}")
        name = aim.variable
        if name in self._visited and name != COMPUTED:
            return f"an offset from {name}, which moves along with it"
        places = self._assigned.get(name, [])
        if name == COMPUTED or name in self._parameters or name in self._changed or len(places) > 1:
            return f"it stands behind {self._source.literal(start, end).strip()}, which the program computes"
        frame = self._plain_frame(self._value(places[0]), name) if places else NamedFrame(name, None)
        computed = f"it stands behind {name}, which the program computes"
        return computed if places and frame.transform is None else frame

    def _plain_frame(self, aim: _Aim, name: str) -> NamedFrame:
        """Frame by a literal of plain numbers; without its transform for anything else."""
        numbers = "" if aim.group is None or aim.frame else self._source.numbers(aim.group.items, _UNITS)
        if isinstance(numbers, str):
            return NamedFrame(name, None)
        return NamedFrame(name, pose_transform("URScript", np.array([number.value for number in numbers])))

    def _tools(self) -> Iterable[FlowEvent[NamedFrame]]:
        """Where the program sets its tool."""
        for word in self._source.words:
            call = self._call_at(word.place) if word.text == _TCP else None
            if call is not None:
                aim = self._aim(*call.items[0])
                places = self._assigned.get(aim.variable, [])
                name = f"the TCP of {self._source.at_line(word.place)}"
                if (
                    aim.group is None
                    and len(places) == 1
                    and aim.variable not in self._parameters | self._changed.keys()
                ):
                    aim, name = self._value(places[0]), aim.variable
                yield FlowEvent(word.place, "set", value=self._plain_frame(aim, name))

    def _near(self, call: Group) -> tuple[float, ...]:
        """Joints near which a call of `get_inverse_kin` looks; () where none are told in plain numbers."""
        for k, item in enumerate(call.items):
            keyword, aim = self._argument(*item)
            if keyword == _NEAR or (k == 1 and not keyword):
                return self._joints_of(aim.variable) if aim.group is None else self._plain(aim)
        return ()

    def _joints_of(self, name: str) -> tuple[float, ...]:
        """Plain joint values that a variable holds once and for all; () for others."""
        places = self._assigned.get(name, [])
        return self._plain(self._value(places[0])) if len(places) == 1 else ()

    def _plain(self, aim: _Aim) -> tuple[float, ...]:
        numbers = "" if aim.group is None or aim.is_pose else self._source.numbers(aim.group.items, _UNITS)
        return () if isinstance(numbers, str) else tuple(number.value for number in numbers)

    def _is_call(self, word: Word) -> bool:
        return self._call_at(word.place, word.place + len(word.text)) is not None

    def _call_at(self, place: int, end: int | None = None) -> Group | None:
        """Brackets behind the name at a place, or behind an end."""
        opening = self._code.find("(", place if end is None else end)
        between = "" if end is None else self._code[end:opening].strip()
        return self._source.by_start.get(opening) if opening >= 0 and not between else None

    def _read_assignment(self, word: Word) -> None:
        """Keep an assignment to a variable, as a whole or to one of its numbers."""
        end = word.place + len(word.text)
        index = self._source.by_start.get(end) if self._code[end : end + 1] == "[" else None
        behind = self._code[index.end if index else end : self._source.line_end(index.end if index else end)]
        if word.group is None and re.match(r"\s*=(?!=)", behind):
            if index is None:
                self._assigned.setdefault(word.text, []).append(word.place)
            elif not re.search(rf"\b{word.text}\b", behind):
                self._changed.setdefault(word.text, word.place)

    def _blocks(self) -> Iterable[FlowEvent[Never]]:
        """The program's functions, branches, loops and calls."""
        words = self._source.words
        defined: set[int] = set()
        for word, following in zip_longest(words, words[1:]):
            kind = _BLOCKS.get(word.text)
            if kind == "routine" and following is not None:
                defined.add(following.place)
                yield FlowEvent(word.place, "routine", following.text)
            elif kind in ("if", "loop"):
                yield FlowEvent(word.place, kind)  # type: ignore[arg-type]
            elif word.text in ("elif", "else"):
                yield FlowEvent(word.place, "else", word.text.removeprefix("else"))
            elif word.text == "end":
                yield FlowEvent(word.place, "end")
            elif word.place not in defined and self._is_call(word):
                yield FlowEvent(word.place, "call", word.text)
