"""Targets in RAPID: jointtarget and robtarget literals, with the tool and work object of the moves that use them.

Tools and work objects count as the file defines them (`PERS tooldata tool1:=[...]`); a controller may have other values
of persistent variables by now. What the program assigns anew at run time counts as not defined. Configurations: ABB,
*Technical reference manual, RAPID Instructions, Functions and Data types* (`confdata`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import cached_property
from math import inf

import numpy as np

from calib.extras.robot_programs.program_text.flow import FlowKind
from calib.extras.robot_programs.program_text.pose_numbers import pose_transform
from calib.extras.robot_programs.program_text.reading import (
    Assignment,
    Held,
    ProgramReader,
    Told,
    Visit,
)
from calib.extras.robot_programs.program_text.source import Item, Part, Statement, Syntax
from calib.extras.robot_programs.program_text.targets import (
    NO_CONFIGURATION,
    Configuration,
    NamedFrame,
    ProgramTarget,
)

_BLOCKS: dict[str, FlowKind] = {
    **dict.fromkeys(("proc", "func", "trap"), "routine"), "if": "if", "test": "switch", "elseif": "else",
    "case": "else", "else": "otherwise", "default": "otherwise", "for": "loop", "while": "loop",
    **dict.fromkeys(("endproc", "endfunc", "endtrap", "endif", "endtest", "endfor", "endwhile"), "end"),
}  # fmt: skip
_MOVE = re.compile(
    r"move(?:absj|[jlc](?:do|ao|go|sync)?)|trigg[jlc](?:ios)?|arc[lc]\d?(?:start|end)?|spotm?[jl]"
    r"|(?:paint|disp|cap|laser)[lc]|nut[jl]|fcpress(?:1l|[lc])|contactl"
)
_BY_JOINTS = re.compile(r"(?:move(?:abs)?|trigg|search)j")
_SIGNAL = re.compile(r"move.(?:do|ao|go)")  # whose last arguments are a signal and its value
_OFFSETS = ("offs", "reltool")
_DISPLACES = ("pdispon", "pdispset", "eoffson", "eoffsset")
_STILL = {"tooldata": ("true",), "wobjdata": ("false", "true")}
"""Flags of the tools on the flange, and of the work objects that stand: robhold and ufprog."""
_POSE, _JOINTS = [3, 4, 4, 6], [6, 6]  # counts of numbers in the lists of a target


class RapidReader(ProgramReader):
    """Targets of a RAPID module or program."""

    language = "RAPID"
    syntax = Syntax(re.compile(r"\"[^\"\r\n]*\"?|![^\r\n]*"), ";:", "({")
    assigns, index, blocks, then = ":=", "{}", _BLOCKS, "then"

    def is_changed(self, assignment: Assignment) -> bool:
        """Whether an assignment is no declaration."""
        return not {"const", "pers", "var"} & {*assignment.before}

    def moves(self, statement: Statement) -> Iterable[Visit]:
        """The motions of a statement, which may stand behind the condition of an IF."""
        parts = statement[0].parts
        k = next((k for k, part in enumerate(parts) if not part.bracket and _MOVE.fullmatch(part.text)), None)
        for part in parts:
            if part.text in _DISPLACES:
                where = f"{self.text(part)} in {self.source.at_line(part.start)}"
                self.notes.append(f"{where} displaces targets: they are corrected where they stand without it")
        if k is None:
            return
        name = parts[k].text
        items = (statement[0].behind(k + 1), *statement[1:])
        arguments = [(item, words) for item in items if (words := self._words(item))]
        of_work = next((item for item in items if "wobj" in [part.text for part in item.parts]), None)
        last = -3 if _SIGNAL.fullmatch(name) else -1
        tools = [each for each in arguments if of_work is None or each[0].start <= of_work.start]
        told = tools[last if of_work is None else -1][1][0] if len(tools) > 2 else None
        tool = self._named(self.text(told) if told is not None and told.is_word else "the tool")
        work = self._named("wobj0" if of_work is None else self.text(of_work.parts[-1]))
        is_joint = bool(_BY_JOINTS.match(name))
        for item, words in arguments[: 2 if name[4:5] == "c" else 1]:
            is_offset = words[0].text in _OFFSETS and words[0].items
            yield Visit(
                self.aim(words[0].items[0] if is_offset else Item(item.start, item.end, words)),
                self.text(parts[k]),
                is_joint,
                keeps=("j" if is_joint else "l") in self._without_configuration,
                tool=tool if isinstance(tool, NamedFrame) else None,
                work=work if isinstance(work, NamedFrame) else None,
                reason=next((each for each in (tool, work) if isinstance(each, str)), ""),
            )

    @staticmethod
    def _words(item: Item) -> tuple[Part, ...]:
        """An argument without what is optional of it."""
        texts = [part.text for part in item.parts]
        return item.parts[: texts.index("\\")] if "\\" in texts else item.parts

    @cached_property
    def _without_configuration(self) -> set[str]:
        """Letters of the motions whose configurations are off; anywhere counts as everywhere."""
        return {each[1] for each in re.finditer(r"\bconf([jl])\s*\\\s*off\b", self.source.code)}

    def _named(self, name: str) -> NamedFrame | str:
        """Tool or work object of a name, or why its targets are left."""
        declared = self.assignments.get(name.lower(), [])
        if name.lower() in ("tool0", "wobj0"):
            return NamedFrame(name, np.eye(4))
        found = {NamedFrame(name, None) if self.is_changed(each) else self._frame(each) for each in declared}
        return found.pop() if len(found) == 1 else NamedFrame(name, None)

    def _frame(self, declared: Assignment) -> NamedFrame | str:
        """Frame of a tooldata or wobjdata literal, or why it moves."""
        name, kind = self.name(declared), declared.before[-1]
        value = self.aim(declared.value).literal
        if value is None or kind not in _STILL:
            return NamedFrame(name, None)
        flags = tuple(self.text(item).lower() for item in value.items)[: len(_STILL[kind])]
        if flags != _STILL[kind]:
            return "the robot holds the workpiece, or a mechanical unit moves it (robhold, ufprog)"
        poses = [part for item in value.items for part in item.parts if _counts(part) == [3, 4]]
        numbers = self.source.numbers([item for pose in poses for each in pose.items for item in each.parts[0].items])
        transform = np.eye(4)
        try:
            for k in range(len(_STILL[kind])):
                pose = () if isinstance(numbers, str) else numbers[7 * k : 7 * k + 7]
                transform = transform @ pose_transform("RAPID", np.array([number.value for number in pose]))
        except ValueError:
            return NamedFrame(name, None)
        return NamedFrame(name, transform)

    def told(self, held: Held) -> Told | str | None:
        """The target of a literal."""
        counts = _counts(held.literal)
        kind = held.by.before[-1] if held.by is not None and held.by.before else ""
        if kind in _STILL and not held.element:
            return "the definition of a tool or work object"
        if counts not in (_POSE, _JOINTS):
            plain = kind not in ("robtarget", "jointtarget") or bool(held.by and held.by.index) or held.element
            return None if plain else "its parts are not all plain numbers"
        lists = [item.parts[0] for item in held.literal.items]
        external = lists[-1].items
        if counts == _JOINTS:
            return Told(ProgramTarget("joints"), lists[0].items, external, is_kept=True)
        target = ProgramTarget("pose", configuration=self._configuration(lists[2].items))
        return Told(target, [*lists[0].items, *lists[1].items], external)

    def _configuration(self, items: Sequence[Item]) -> Configuration:
        """Posture by the quadrants cf1, cf4 and cf6 and by cfx; none where they are no whole numbers.

        Bits of cfx: axis 5 is negative; the wrist is behind the lower arm; it is behind axis 1.
        """
        numbers = self.source.numbers(items)
        if isinstance(numbers, str) or any(number.value % 1.0 for number in numbers):
            return NO_CONFIGURATION
        quadrants = dict(zip((0, 3, 5), (90.0 * number.value for number in numbers), strict=False))
        ranges = tuple((quadrants[k], quadrants[k] + 90.0) if k in quadrants else (-inf, inf) for k in range(6))
        cfx = int(numbers[3].value)
        return Configuration(ranges, behind=bool(cfx & 4), elbow_as_at_zero=not cfx & 2, axis_5_negative=bool(cfx & 1))


def _counts(part: Part) -> list[int]:
    """Counts of numbers in the lists that a list consists of; [] for other lists."""
    lists = [item.parts[0] for item in part.items if len(item.parts) == 1 and item.parts[0].bracket == "["]
    return [len(each.items) for each in lists] if part.bracket == "[" and len(lists) == len(part.items) > 1 else []
