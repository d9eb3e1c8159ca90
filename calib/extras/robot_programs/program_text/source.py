"""Source text of a robot program as statements: words, signs and brackets, each with its place, comments left out.

Bytes are read as Latin-1, one character each, so that a place in the text is a place in the file and all that is not
replaced stays as it was, whatever its encoding and line ends.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from calib.errors import CalibError
from calib.extras.robot_programs.program_text.targets import Number

LARGEST = 1e7  # mm, m, rad or deg: no coordinate and no joint value of any arm is beyond
NUMBER = re.compile(r"[+-]?[ \t]*(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_WRAPPED = re.compile(rf"\s*(?:([A-Za-z]\w*)\s*\(\s*)?({NUMBER.pattern})\s*(\))?\s*")
_BYTE_ORDER_MARK = "\xef\xbb\xbf"  # of UTF-8, read as Latin-1
_TOKEN = re.compile(r"\.?[\w$]+(?:[ \t]*\.[ \t]*\w+)*|:=|[=<>!]=|[\r\n]|\S", re.ASCII)
_CLOSING = {")": "(", "]": "[", "}": "{"}
_DEEPEST = 50  # brackets within brackets
_LONGEST_SHOWN = 60  # characters of a literal in a message


@dataclass(frozen=True, eq=False)
class Part:
    """A word with what its dots lead to, a sign, or a pair of brackets with the word in front of them."""

    start: int
    end: int
    text: str  # of brackets that of the word, or ""; lower case where the language does not tell cases apart
    bracket: str = ""  # "(", "[" or "{"
    items: tuple[Item, ...] = ()

    @property
    def is_word(self) -> bool:
        """Whether it is a word alone."""
        return not self.bracket and (self.text[0].isalnum() or self.text[0] in "_$.")


@dataclass(frozen=True, eq=False)
class Item:
    """What stands between the commas of brackets or of a statement."""

    start: int
    end: int
    parts: tuple[Part, ...]

    def behind(self, count: int) -> Item:
        """What stands behind the first parts."""
        return Item(self.parts[count - 1].end, self.end, self.parts[count:])

    def deep(self) -> Iterable[Part]:
        """All parts, those within brackets too."""
        for part in self.parts:
            yield part
            for item in part.items:
                yield from item.deep()


Statement = tuple[Item, ...]
"""What stands between its commas; the first item has parts."""
_Read = tuple[Statement, int]


@dataclass(frozen=True)
class Syntax:
    """How a language is told apart into statements."""

    masked: re.Pattern[str]  # what is no code: comments and strings
    ends: str  # signs that end a statement
    behind_words: str  # brackets that belong to the word in front of them
    any_case: bool = True


class Source:
    """A program's text, its statements, and all parts of them, each with its statement.

    The texts of other files of the program follow its own.
    """

    def __init__(self, syntax: Syntax, path: str, text: str, others: Sequence[tuple[str, str]] = ()) -> None:
        """Read a program's text, and those of other files by their paths. Raises CalibError for unmatched brackets."""
        self.own_end = len(text)
        self._files = [(0, path)]
        for other, more in others:
            text += "\n"
            self._files.append((len(text), other))
            text += more
        self.text = text
        code = syntax.masked.sub(lambda match: " " * len(match[0]), text.replace(_BYTE_ORDER_MARK, "   "))
        self.code = code.lower() if syntax.any_case else code
        self._line_starts = [0, *(m.end() for m in re.finditer(r"\r\n|\r|\n", text))]
        self._syntax, self.statements, tokens, place = syntax, list[Statement](), _TOKEN.finditer(self.code), 0
        while place < len(self.code):
            items, place = self._read(tokens, None, place)
            self.statements += [items] if items[0].parts else []
        self.parts = [(part, each) for each in self.statements for item in each for part in item.deep()]

    def _read(self, tokens: Iterator[re.Match[str]], opened: re.Match[str] | None, begin: int, depth: int = 0) -> _Read:
        """Items of brackets that have been opened, or of a statement, and the place behind its end."""
        items, parts = list[Item](), list[Part]()
        for match in tokens:
            token, place = match[0], match.start()
            is_end = token in (_CLOSING if opened else self._syntax.ends)
            if token in _CLOSING and (opened is None or opened[0] != _CLOSING[token]):
                known = f"line {self.line(opened.start())} opened {opened[0]}" if opened else "none is open"
                raise self._error(place, f"{token} closes no bracket ({known})")
            if is_end or token == ",":
                items.append(Item(begin, place, tuple(parts)))
                begin, parts = place + 1, []
                if is_end:
                    return tuple(items), begin
            elif token in "([{":
                leads = bool(parts) and parts[-1].is_word and token in self._syntax.behind_words
                start, word = (parts[-1].start, parts.pop().text) if leads else (place, "")
                if depth == _DEEPEST:
                    raise self._error(place, f"brackets stand {_DEEPEST} deep in each other")
                inside, end = self._read(tokens, match, place + 1, depth + 1)
                parts.append(Part(start, end, word, token, inside))
            elif not token.isspace():
                parts.append(Part(place, match.end(), "".join(token.split())))
        if opened is not None:
            raise self._error(opened.start(), f"the bracket {opened[0]} is never closed")
        return (*items, Item(begin, len(self.code), tuple(parts))), len(self.code)

    def _error(self, place: int, words: str) -> CalibError:
        where = f"{self._file(place)[1]}: line {self.line(place)}"
        return CalibError(f"{where}: {words}; a program that a controller accepts is needed")

    def _file(self, place: int) -> tuple[int, str]:
        """Start and path of the file in which a place is."""
        return self._files[bisect_right(self._files, place, key=lambda each: each[0]) - 1]

    def line(self, place: int) -> int:
        """Number of the line, from 1, at a place in the text, in its own file."""
        first, at = (bisect_right(self._line_starts, each) for each in (self._file(place)[0], place))
        return at - first + 1

    def at_line(self, place: int) -> str:
        """Words for the line of a place, with the file where it is another one."""
        return f"line {self.line(place)}" + ("" if place <= self.own_end else f" of {Path(self._file(place)[1]).name}")

    def numbers(
        self, items: Sequence[Item], units: Mapping[str, float] = MappingProxyType({})
    ) -> tuple[Number, ...] | str:
        """Plain numbers that items are, or the reason why they are none.

        units: functions that turn a plain number into another unit, with the value of 1.
        """
        found: list[Number] = []
        for item in items:
            match = _WRAPPED.fullmatch(self.code, item.start, item.end)
            unit = 1.0 if match is None or not match[1] else units.get(match[1])
            if match is None or unit is None or bool(match[1]) is not bool(match[3]):
                return f"{self.shown(item.start, item.end) or 'nothing'} is an expression, not a plain number"
            value = float("".join(match[2].split())) * unit
            if not abs(value) <= LARGEST:
                return f"{self.shown(*match.span(2))} is beyond any joint value or coordinate"
            found.append(Number(*match.span(2), value, _decimals(match[2]), unit))
        return tuple(found)

    def shown(self, start: int, end: int) -> str:
        """Text between two places in one line, cut where it is long."""
        words = " ".join(self.text[start:end][: 10 * _LONGEST_SHOWN].split())
        return words if len(words) <= _LONGEST_SHOWN else words[: _LONGEST_SHOWN - 3] + "..."


def _decimals(text: str) -> int:
    mantissa, _, exponent = text.lower().partition("e")
    count = len(mantissa.partition(".")[2]) - int(exponent[:6] or 0)
    return min(max(count, 0), 12)
