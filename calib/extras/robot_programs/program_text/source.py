"""Source text of a robot program: comments masked, brackets matched, every number with its place.

Bytes are read as Latin-1, one character each, so that a place in the text is a place in the file and all that is not
replaced stays as it was, whatever its encoding and line ends.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.rendering import numbers

NUMBER = re.compile(r"[+-]?[ \t]*(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
Kind = Literal["joints", "pose"]
LARGEST = 1e7  # mm, m, rad or deg: no coordinate and no joint value of any arm is beyond
_WRAPPED = re.compile(rf"\s*(?:([A-Za-z]\w*)\s*\(\s*)?({NUMBER.pattern})\s*(\))?\s*")
_BYTE_ORDER_MARK = "\xef\xbb\xbf"  # of UTF-8, read as Latin-1
_TOKEN = re.compile(r"[()\[\]{},]|[A-Za-z_$][\w$]*")
_CLOSING = {")": "(", "]": "[", "}": "{"}
_LONGEST_SHOWN = 60  # characters of a literal in a message
_HELD_BACK = 200  # characters before a literal that are looked at


@dataclass(frozen=True)
class Number:
    """A plain number in a program, with its place in the text."""

    start: int
    end: int
    value: float
    decimals: int  # behind the point, an exponent counted
    unit: float = 1.0  # value of a written 1, as of d2r(1)

    def written(self, value: float, least_decimals: int) -> str | None:
        """Text of a new value with this number's decimals, and not fewer than a least count; None where it stays."""
        text = f"{value / self.unit:z.{max(self.decimals, least_decimals)}f}"
        return None if float(text) == round(self.value / self.unit, self.decimals) else text


@dataclass(frozen=True, eq=False)
class NamedFrame:
    """A tool or work frame that a target refers to; two are the same where name and numbers are."""

    name: str  # as the program calls it
    transform: Array | None  # (4, 4) mm; None where the program's files do not define it

    @property
    def is_open(self) -> bool:
        """Whether a user has to give it."""
        return self.transform is None

    def _key(self) -> tuple[str, bytes]:
        return self.name.lower(), b"" if self.transform is None else self.transform.tobytes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, NamedFrame) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())


@dataclass(frozen=True)
class Arrival:
    """A motion that ends at a target."""

    is_joint: bool  # otherwise its posture is that of its start
    after: frozenset[int]  # places of the targets from which it may come; `UNKNOWN_PLACE` for one that is not known


UNKNOWN_PLACE = -1  # of a target


@dataclass(frozen=True)
class Configuration:
    """What a program tells of a pose's posture, in its maker's numbers."""

    ranges_deg: tuple[tuple[float, float], ...] = ()  # of each commanded joint value; () if none are told
    behind: bool | None = None  # whether the wrist is on the other side of axis 1 than with all joints at 0
    elbow: bool | None = None  # whether the wrist is ahead of the line from axis 2 to axis 3, as joint 3 turns
    elbow_as_at_zero: bool | None = None  # whether it is on the side of that line on which it is with all joints at 0
    axis_5_negative: bool | None = None


NO_CONFIGURATION = Configuration()


@dataclass(frozen=True)
class ProgramTarget:
    """A target written as plain numbers in a program."""

    name: str  # variable that holds it, or the instruction in which it stands
    line: int  # from 1
    kind: Kind
    numbers: tuple[Number, ...]  # six joint values, or a position and an orientation in the maker's form
    place: int = 0  # of the literal, characters from the start of the text
    tool: NamedFrame | None = None  # flange_T_tool; None for joints
    work: NamedFrame | None = None  # base_T_work; None for joints
    configuration: Configuration = NO_CONFIGURATION
    keeps_posture: bool = False  # whether the controller keeps the posture of the way, whatever the configuration is
    near: tuple[float, ...] = ()  # joint values near those of a pose, in the program's own units; () if none are told
    arrivals: tuple[Arrival, ...] = ()

    @property
    def values(self) -> Array:
        """Numbers of the target in the program's own units."""
        return np.array([number.value for number in self.numbers])


@dataclass(frozen=True)
class SkippedLiteral:
    """Something in a program that looks like a target and is none that can be corrected."""

    line: int
    what: str
    reason: str


@dataclass(frozen=True)
class ProgramTargets:
    """Targets of a program, what else looks like one, and remarks on the whole."""

    targets: tuple[ProgramTarget, ...]
    left: tuple[SkippedLiteral, ...]
    notes: tuple[str, ...] = ()


@dataclass(eq=False)
class Group:
    """A pair of brackets with what is in it."""

    start: int
    bracket: str  # "(", "[" or "{"
    parent: Group | None
    end: int = 0  # behind the closing bracket
    commas: list[int] = field(default_factory=list)
    children: list[Group] = field(default_factory=list)

    @property
    def items(self) -> list[tuple[int, int]]:
        """Start and end of what stands between the commas."""
        edges = [self.start, *self.commas, self.end - 1]
        return [(a + 1, b) for a, b in pairwise(edges)]


@dataclass(frozen=True)
class Word:
    """An identifier in the code, with the innermost brackets around it."""

    place: int
    text: str
    group: Group | None


class Source:
    """A program's text, and the same with comments and the insides of strings blanked.

    The texts of other files of the program follow its own. What is found there defines frames and uses targets.
    """

    def __init__(self, path: str, text: str, masked: re.Pattern[str], others: Sequence[tuple[str, str]] = ()) -> None:
        """Mask the matches of a pattern: comments wholly, strings but for their quotes.

        Args:
            path: of the program's file.
            text: of the program.
            masked: what is no code.
            others: paths and texts of other files.
        """
        self.own_end = len(text)
        self._files = [(0, path)]
        for other, more in others:
            text += "\n"
            self._files.append((len(text), other))
            text += more
        self.text = text
        self.code = masked.sub(_blank, text.replace(_BYTE_ORDER_MARK, "   "))

    @cached_property
    def line_starts(self) -> list[int]:
        """Places at which lines start."""
        return [0, *(m.end() for m in re.finditer(r"\r\n|\r|\n", self.text))]

    def _file(self, place: int) -> tuple[int, str]:
        """Start and path of the file in which a place is."""
        return self._files[bisect_right(self._files, place, key=lambda each: each[0]) - 1]

    def path(self, place: int) -> str:
        """Path of the file in which a place is."""
        return self._file(place)[1]

    def line(self, place: int) -> int:
        """Number of the line, from 1, at a place in the text, in its own file."""
        return self._line(place) - self._line(self._file(place)[0]) + 1

    def at_line(self, place: int) -> str:
        """Words for the line of a place, with the file where it is another one."""
        return f"line {self.line(place)}" + ("" if place <= self.own_end else f" of {Path(self.path(place)).name}")

    def _line(self, place: int) -> int:
        return bisect_right(self.line_starts, place)

    def line_start(self, place: int) -> int:
        """Place at which the line of a place starts."""
        return self.line_starts[self._line(place) - 1]

    def line_end(self, place: int) -> int:
        """Place at which the line of a place ends."""
        number = self._line(place)
        return self.line_starts[number] if number < len(self.line_starts) else len(self.text)

    @property
    def own_groups(self) -> list[Group]:
        """Brackets of the program's own file."""
        return [group for group in self.groups if group.start < self.own_end]

    @cached_property
    def scanned(self) -> tuple[list[Group], list[Word]]:
        """Brackets in the order of their start, and identifiers. Raises CalibError where brackets do not match."""
        groups: list[Group] = []
        words: list[Word] = []
        inner: Group | None = None
        for match in _TOKEN.finditer(self.code):
            token, place = match[0], match.start()
            if token in "([{":
                group = Group(place, token, inner)
                if inner is not None:
                    inner.children.append(group)
                groups.append(group)
                inner = group
            elif token == ",":
                if inner is not None:
                    inner.commas.append(place)
            elif token in _CLOSING:
                if inner is None or inner.bracket != _CLOSING[token]:
                    opened = "none is open"
                    if inner is not None:
                        opened = f"line {self.line(inner.start)} opened {inner.bracket}"
                    raise CalibError(
                        f"{self.path(place)}: line {self.line(place)}: {token} closes no bracket ({opened}); a program "
                        "that a controller accepts is needed"
                    )
                inner.end = place + 1
                inner = inner.parent
            else:
                words.append(Word(place, token, inner))
        if inner is not None:
            raise CalibError(
                f"{self.path(inner.start)}: line {self.line(inner.start)}: the bracket {inner.bracket} is never "
                "closed; a program that a controller accepts is needed"
            )
        return groups, words

    @property
    def groups(self) -> list[Group]:
        """All brackets in the order of their start."""
        return self.scanned[0]

    @property
    def words(self) -> list[Word]:
        """All identifiers in their order."""
        return self.scanned[1]

    @cached_property
    def by_start(self) -> dict[int, Group]:
        """Brackets by the place of the opening one."""
        return {group.start: group for group in self.groups}

    def first_word(self, place: int) -> str:
        """First identifier of the line of a place; "" where there is none."""
        found = re.compile(r"\s*([A-Za-z_$][\w$]*)").match(self.code, self.line_start(place))
        return found[1] if found else ""

    def before(self, place: int) -> str:
        """Code in front of a place, without blanks at its end."""
        return self.code[max(0, place - _HELD_BACK) : place].rstrip()

    def function_of(self, group: Group) -> str:
        """Name in front of an opening bracket; "" where there is none."""
        found = re.search(r"[A-Za-z_$][\w$]*$", self.before(group.start))
        return found[0] if found else ""

    def numbers(
        self, spans: Sequence[tuple[int, int]], units: Mapping[str, float] = MappingProxyType({})
    ) -> tuple[Number, ...] | str:
        """Plain numbers at spans of the text, or the reason why they are none.

        Args:
            spans: starts and ends.
            units: functions that turn a plain number into another unit, with the value of 1.
        """
        found: list[Number] = []
        for start, end in spans:
            match = _WRAPPED.fullmatch(self.code, start, end)
            unit = 1.0 if match is None or not match[1] else units.get(match[1])
            if match is None or unit is None or bool(match[1]) is not bool(match[3]):
                return f"{shown(self.code[start:end]) or 'nothing'} is an expression, not a plain number"
            text = match[2]
            value = float(text.replace(" ", "").replace("\t", "")) * unit
            if not abs(value) <= LARGEST:
                return f"{shown(text)} is beyond any joint value or coordinate"
            found.append(Number(*match.span(2), value, _decimals(text), unit))
        return tuple(found)

    def literal(self, start: int, end: int) -> str:
        """Text of a literal in one line, for a message."""
        return shown(self.text[start:end])


def shown(text: str) -> str:
    """Text in one line, cut where it is long."""
    words = " ".join(text[: 10 * _LONGEST_SHOWN].split())
    return words if len(words) <= _LONGEST_SHOWN else words[: _LONGEST_SHOWN - 3] + "..."


def external_axes(lines: Sequence[int]) -> tuple[str, ...]:
    """Note on targets, by their lines, whose external axes do not stand at 0; () where there are none."""
    if not lines:
        return ()
    where = f"line {numbers.in_short(lines, 1)}"
    return (f"external axes move ({where}): the arm's base is taken to stand, which is wrong where they carry it",)


def _decimals(text: str) -> int:
    mantissa, _, exponent = text.lower().partition("e")
    count = len(mantissa.partition(".")[2]) - int(exponent[:6] or 0)
    return min(max(count, 0), 12)


def _blank(match: re.Match[str]) -> str:
    text = match[0]
    if text[0] in "\"'" and len(text) > 1:
        closed = text[-1] == text[0]
        return text[0] + " " * (len(text) - 2) + (text[0] if closed else " ")
    return " " * len(text)
