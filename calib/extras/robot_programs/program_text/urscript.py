"""Targets in URScript: joint lists and poses that are assigned, or given to a motion directly.

A variable that holds six numbers may also be a wrench or a speed. So an assigned list counts as a target where a motion
of the same program uses the variable, or where the program does nothing, as a list of points. The pose that
`pose_trans` puts behind a frame is a target in that frame, unless the frame is itself a target, with which it moves.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from math import pi

import numpy as np

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
from calib.extras.robot_programs.program_text.targets import NamedFrame, ProgramTarget

_INVERSE = ("get_inverse_kin", "get_inverse_kin_has_solution")
_JOINT_MOTIONS = ("movej", "servoj", *_INVERSE)
_GOES = {
    "movel": 1,
    "movep": 1,
    "movec": 2,
    "servoc": 1,
    "servol": 1,
    "get_forward_kin": 1,
    **dict.fromkeys(_JOINT_MOTIONS, 1),
}
"""Functions, and how many of their first arguments are targets."""
_JUMPS = ("speedj", "freedrive_mode", "teach_mode")  # which leave the arm in any posture
_KEYWORDS = ("q", "x", "pose", "pose_to", "pose_via")
_PLAIN = ("d2r", "pose_trans", "set_tcp")  # calls in a list of points
_BLOCKS: dict[str, FlowKind] = {
    **dict.fromkeys(("def", "thread", "sec"), "routine"), "if": "if", "elif": "else", "else": "otherwise",
    "while": "loop", "for": "loop", "end": "end",
}  # fmt: skip
_BASE = NamedFrame("base", np.eye(4))


class UrscriptReader(ProgramReader):
    """Targets of a URScript program."""

    language = "URScript"
    syntax = Syntax(re.compile(r"\"[^\"\r\n]*\"?|'[^'\r\n]*'?|#[^\r\n]*"), "\r\n", "([", any_case=False)
    blocks, first_index, top_first, units = _BLOCKS, 0, True, {"d2r": pi / 180.0}

    @property
    def acts(self) -> bool:
        """Whether it calls anything that a list of points does not."""
        return any(part.bracket == "(" and part.text not in ("", *_PLAIN) for part, _ in self.source.parts)

    def is_changed(self, assignment: Assignment) -> bool:
        """Whether a number of a list is set."""
        return bool(assignment.index)

    def is_literal(self, part: Part) -> bool:
        """Whether brackets are a list or a pose."""
        return part.bracket == "[" and part.text in ("", "p")

    def aim(self, item: Item) -> Aim:
        """What an expression stands for, through `pose_trans` and `get_inverse_kin`."""
        call = item.parts[0] if len(item.parts) == 1 else None
        if call is not None and call.text in _INVERSE and call.items:
            return replace(self.aim(_argument(call.items[0])[1]), near=self._near(call), is_joint=True)
        if call is not None and call.text == "pose_trans" and len(call.items) == 2:
            inner = self.aim(call.items[1])
            is_pose = inner.literal is not None and inner.literal.text == "p"
            return replace(inner, frame=call.items[0]) if is_pose else Aim(call.start)
        return super().aim(item)

    def moves(self, statement: Statement) -> Iterable[Visit]:
        """The motions of a line, and what asks for joints at a pose."""
        seen: set[int] = set()
        for call in (part for item in statement for part in item.deep() if part.bracket == "("):
            if call.text in _JUMPS:
                yield Visit(Aim(call.start), is_joint=True)
            for k, item in enumerate(call.items if call.text in _GOES else ()):
                keyword, value = _argument(item)
                aim = self.aim(value)
                if (keyword in _KEYWORDS if keyword else k < _GOES[call.text]) and aim.place not in seen:
                    seen.add(aim.place)
                    yield Visit(aim, call.text, aim.is_joint or call.text in _JOINT_MOTIONS)

    def told(self, held: Held) -> Told | str | None:
        """The target of a list or pose of six."""
        literal = held.literal
        if len(literal.items) != 6 or any(part.bracket == "[" for item in literal.items for part in item.parts):
            return None
        is_pose = literal.text == "p"
        near = held.aim.near or (self._joints_of(held.name[:-2] + "_q") if held.name.endswith("_p") else ())
        work = _BASE if held.aim.frame is None else self._frame(held.aim.frame)
        target = ProgramTarget("pose" if is_pose else "joints", near=near)
        if isinstance(work, str):
            return Told(target, literal.items, reason=work)
        return Told(replace(target, work=work if is_pose else None), literal.items)

    def _once(self, name: str) -> Aim | None:
        """What is assigned to a variable once and for all; None for others."""
        every = self.assignments.get(name, [])
        known = len(every) == 1 and name not in self.changed and name not in self.parameters
        return self.aim(every[0].value) if known else None

    def _frame(self, item: Item) -> NamedFrame | str:
        """Frame that the first argument of a `pose_trans` is, or why the pose behind it is left."""
        aim = self.aim(item)
        name = aim.variable
        if name in self._visited:
            return f"an offset from {name}, which moves along with it"
        if name not in ("", COMPUTED) and name not in self.assignments and name not in self.parameters:
            return NamedFrame(name, None)
        frame = self._plain_frame(
            aim if aim.literal else self._once(name), name or f"the frame of {self.source.at_line(item.start)}"
        )
        return f"it stands behind {self.text(item)}, which the program computes" if frame.transform is None else frame

    @cached_property
    def _visited(self) -> set[str]:
        return {visit.aim.variable for visit in self.visits} - {"", COMPUTED}

    def _plain_frame(self, aim: Aim | None, name: str) -> NamedFrame:
        """Frame by a literal of plain numbers; without its transform for anything else."""
        values = self._plain(aim, "p")
        return NamedFrame(name, pose_transform("URScript", np.array(values)) if len(values) == 6 else None)

    def _plain(self, aim: Aim | None, text: str) -> tuple[float, ...]:
        """Plain numbers of a pose ("p") or list (""); () for anything else."""
        literal = None if aim is None or aim.frame else aim.literal
        numbers = "" if literal is None or literal.text != text else self.source.numbers(literal.items, self.units)
        return () if isinstance(numbers, str) else tuple(number.value for number in numbers)

    def _joints_of(self, name: str) -> tuple[float, ...]:
        return self._plain(self._once(name), "")

    def _near(self, call: Part) -> tuple[float, ...]:
        """Joints near which a call of `get_inverse_kin` looks; () where none are told in plain numbers."""
        for k, item in enumerate(call.items):
            keyword, value = _argument(item)
            if keyword == "qnear" or (k == 1 and not keyword):
                aim = self.aim(value)
                return self._plain(aim, "") if aim.literal else self._joints_of(aim.variable)
        return ()

    def before(self, kind: FrameKind) -> NamedFrame:
        """Tool at the program's start; poses are in the base or behind a frame of their own."""
        return NamedFrame("the controller's own TCP (no set_tcp before it)", None) if kind == "tool" else _BASE

    def sets(self, kind: FrameKind) -> Iterable[tuple[int, NamedFrame]]:
        """Places where the tool is set, and the tools."""
        for call, _ in self.source.parts if kind == "tool" else ():
            if call.text == "set_tcp" and call.items:
                aim = self.aim(call.items[0])
                held = None if aim.literal else self._once(aim.variable)
                name = f"the TCP of {self.source.at_line(call.start)}" if held is None else aim.variable
                yield call.start, self._plain_frame(held or aim, name)


def _argument(item: Item) -> tuple[str, Item]:
    """Keyword of an argument, "" without one, and its value."""
    is_named = [part.text for part in item.parts[1:2]] == ["="]
    return (item.parts[0].text, item.behind(2)) if is_named else ("", item)
