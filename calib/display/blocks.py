"""What a report and a notebook's view consist of: paragraphs, lists, tables. The templates escape their values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

LONG_NAME = 22  # characters of a word that stays in one line
_SHORT_NAME = 14  # characters


@dataclass(frozen=True)
class Block:
    """Something that `templates/blocks.html` has a macro for."""

    kind: ClassVar[str]  # the name of that macro


@dataclass(frozen=True)
class Paragraph(Block):
    """A sentence or several; `soft` ones are smaller and grey, a `heading` stands over what follows."""

    kind: ClassVar[str] = "paragraph"
    sentence: str
    soft: bool = False
    heading: bool = False


@dataclass(frozen=True)
class Bullets(Block):
    """A plain list."""

    kind: ClassVar[str] = "bullets"
    sentences: Sequence[str]


@dataclass(frozen=True)
class Link:
    """A cell of a table that leads somewhere."""

    words: str
    address: str  # relative to the page, quoted as addresses are

    def __str__(self) -> str:
        return self.words


@dataclass(frozen=True)
class Table(Block):
    """A table: the columns in `left` hold words, the others numbers; row `mark` is emphasised."""

    kind: ClassVar[str] = "table"
    headers: Sequence[str]
    rows: Sequence[Sequence[object]]
    caption: str = ""
    left: Sequence[int] = (0,)
    mark: int | None = None

    def cell_class(self, column: int, value: object) -> str:
        """The CSS class of a cell: a number, a short name, words, or words of which one is too long for a line."""
        if column not in self.left:
            return "num"
        if "-" in str(value) and " " not in str(value) and len(str(value)) <= _SHORT_NAME:
            return "wide short"  # a date, a serial number: not to be broken at its hyphens
        return "wide long" if max(map(len, str(value).split()), default=0) > LONG_NAME else "wide"


@dataclass(frozen=True)
class Facts(Block):
    """Name and value, a row each."""

    kind: ClassVar[str] = "facts"
    pairs: Sequence[tuple[str, object]]


@dataclass(frozen=True)
class KeyFigures(Block):
    """A few numbers to be seen first."""

    kind: ClassVar[str] = "key_figures"
    pairs: Sequence[tuple[str, object]]


@dataclass(frozen=True)
class Headline(Block):
    """The way of the error: figure and name of each stage, and what is said below."""

    kind: ClassVar[str] = "headline"
    stages: Sequence[tuple[str, str]]
    noise: str
    note: str
    good: bool  # whether the last error is what noise leaves


@dataclass(frozen=True)
class VerdictLine(Block):
    """The answer, marked with a colour of the palette (never one from outside)."""

    kind: ClassVar[str] = "verdict"
    sentence: str
    colour: str


@dataclass(frozen=True)
class Drawing(Block):
    """A picture that is SVG already, whose words were escaped by the one who drew it."""

    kind: ClassVar[str] = "drawing"
    svg: str
    caption: str


@dataclass(frozen=True)
class Section:
    """A heading and what stands below it."""

    heading: str
    blocks: Sequence[Block]
