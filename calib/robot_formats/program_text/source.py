"""Source text of a robot program: comments masked, brackets matched, every number with its place.

Bytes are read as Latin-1, one character each, so that a place in the text is a place in the file and all that is not
replaced stays as it was, whatever its encoding and line ends.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError

NUMBER = re.compile(r"[+-]?[ \t]*(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
LARGEST = 1e7  # mm, m, rad or deg: no coordinate and no joint value of any arm is beyond
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

    def written(self, value: float, least_decimals: int) -> str:
        """Text of a new value with the decimals of this number, and not fewer than a least count."""
        return f"{value:z.{max(self.decimals, least_decimals)}f}"


@dataclass(frozen=True)
class NamedFrame:
    """A tool or work frame that a target refers to."""

    name: str  # as the program calls it
    transform: Array | None  # (4, 4) mm; None where the program's file does not define it


@dataclass(frozen=True)
class ProgramTarget:
    """A target written as plain numbers in a program."""

    name: str  # variable that holds it, or the instruction in which it stands
    line: int  # from 1
    kind: Literal["joints", "pose"]
    numbers: tuple[Number, ...]  # six joint values, or a position and an orientation in the maker's form
    place: int = 0  # of the literal, characters from the start of the text
    tool: NamedFrame | None = None  # flange_T_tool; None for joints
    work: NamedFrame | None = None  # base_T_work; None for joints
    ranges_deg: tuple[tuple[float, float], ...] = ()  # of each commanded joint value by the configuration; () if none

    @property
    def values(self) -> Array:
        """Numbers of the target in the program's own units."""
        return np.array([number.value for number in self.numbers])


@dataclass(frozen=True)
class LeftLiteral:
    """Something in a program that looks like a target and is none that can be corrected."""

    line: int
    what: str
    reason: str


@dataclass(frozen=True)
class ProgramTargets:
    """Targets of a program, what else looks like one, and remarks on the whole."""

    targets: tuple[ProgramTarget, ...]
    left: tuple[LeftLiteral, ...]
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

    def index_of(self, place: int) -> int:
        """Index of the item at a place in the text."""
        return bisect_right(self.commas, place)


@dataclass(frozen=True)
class Word:
    """An identifier in the code, with the innermost brackets around it."""

    place: int
    text: str
    group: Group | None


class Source:
    """A program's text, and the same with comments and the insides of strings blanked."""

    def __init__(self, path: str, text: str, masked: re.Pattern[str]) -> None:
        """Mask the matches of a pattern: comments wholly, strings but for their quotes."""
        self.path = path
        self.text = text
        self.code = masked.sub(_blank, text)

    @cached_property
    def line_starts(self) -> list[int]:
        """Places at which lines start."""
        return [0, *(m.end() for m in re.finditer(r"\r\n|\r|\n", self.text))]

    def line(self, place: int) -> int:
        """Number of the line, from 1, at a place in the text."""
        return bisect_right(self.line_starts, place)

    def line_start(self, place: int) -> int:
        """Place at which the line of a place starts."""
        return self.line_starts[self.line(place) - 1]

    def line_end(self, place: int) -> int:
        """Place at which the line of a place ends."""
        number = self.line(place)
        return self.line_starts[number] if number < len(self.line_starts) else len(self.text)

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
                        f"{self.path}: line {self.line(place)}: {token} closes no bracket ({opened}); a program that a "
                        "controller accepts is needed"
                    )
                inner.end = place + 1
                inner = inner.parent
            else:
                words.append(Word(place, token, inner))
        if inner is not None:
            raise CalibError(
                f"{self.path}: line {self.line(inner.start)}: the bracket {inner.bracket} is never closed; a program "
                "that a controller accepts is needed"
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

    def before(self, place: int) -> str:
        """Code in front of a place, without blanks at its end."""
        return self.code[max(0, place - _HELD_BACK) : place].rstrip()

    def function_of(self, group: Group) -> str:
        """Name in front of an opening bracket; "" where there is none."""
        found = re.search(r"[A-Za-z_$][\w$]*$", self.before(group.start))
        return found[0] if found else ""

    def is_item(self, start: int, end: int, group: Group) -> bool:
        """Whether a span is a whole item between the commas of a group."""
        k = group.index_of(start)
        first = group.commas[k - 1] if k else group.start
        last = group.commas[k] if k < len(group.commas) else group.end - 1
        return self.code[first + 1 : last].strip() == self.code[start:end].strip()

    def numbers(self, spans: Sequence[tuple[int, int]]) -> tuple[Number, ...] | str:
        """Plain numbers at spans of the text, or the reason why they are none."""
        found: list[Number] = []
        for start, end in spans:
            item = self.code[start:end]
            text = item.strip()
            if NUMBER.fullmatch(text) is None:
                return f"{shown(text) or 'nothing'} is an expression, not a plain number"
            value = float(text.replace(" ", "").replace("\t", ""))
            if not abs(value) <= LARGEST:
                return f"{shown(text)} is beyond any joint value or coordinate"
            first = start + len(item) - len(item.lstrip())
            found.append(Number(first, first + len(text), value, _decimals(text)))
        return tuple(found)

    def literal(self, start: int, end: int) -> str:
        """Text of a literal in one line, for a message."""
        return shown(self.text[start:end])


def shown(text: str) -> str:
    """Text in one line, cut where it is long."""
    words = " ".join(text[: 10 * _LONGEST_SHOWN].split())
    return words if len(words) <= _LONGEST_SHOWN else words[: _LONGEST_SHOWN - 3] + "..."


def distinct_frames(frames: Iterable[NamedFrame]) -> list[NamedFrame]:
    """Frames without repeats of the same one."""
    return list({(frame.name, id(frame.transform)): frame for frame in frames}.values())


def one_frame(frames: Sequence[NamedFrame]) -> NamedFrame | str:
    """Frame that all uses of a target agree on, or the names where they do not."""
    first = frames[0]
    for other in frames[1:]:
        same = other.name == first.name and (other.transform is None) == (first.transform is None)
        if same and first.transform is not None and other.transform is not None:
            same = bool(np.array_equal(first.transform, other.transform))
        if not same:
            return f"{first.name} and {other.name}"
    return first


def with_frames(target: ProgramTarget, tools: Sequence[NamedFrame], works: Sequence[NamedFrame]) -> ProgramTarget | str:
    """Pose target with the tool and work frame of its uses, or the reason why there is no single one."""
    tool, work = one_frame(tools), one_frame(works)
    if isinstance(tool, str):
        return f"it is used with several tools, {tool}; write a target for each"
    if isinstance(work, str):
        return f"it is used with several work frames, {work}; write a target for each"
    return replace(target, tool=tool, work=work)


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
