"""Blocks of which a result's presentation consists: paragraphs, lists, tables, places of figures.

A sentence is a text, or a sequence of texts and references. A reference names a pose, a joint, an effect or a model of
the dataset: the page makes it a link that selects it, everywhere else it is its own words.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

LONG_NAME = 22  # characters of a word that stays in one line
_SHORT_NAME = 14  # characters
_CONTENT = ("rows", "words", "sentences", "pairs", "blocks")  # fields without which a block has nothing to show


class Named:
    """A name within a sentence or a cell that is more than text; where it cannot be shown so, it is its words."""

    words: str

    def __str__(self) -> str:
        return self.words


@dataclass(frozen=True)
class Reference(Named):
    """A name within a sentence or a cell that stands for a pose, joint or effect; a click selects that object."""

    kind: Literal["pose", "joint", "effect", "planned", "step", "setup"]
    value: str | int  # a pose's id, a joint's number from 1, an effect's key, an index
    words: str


@dataclass(frozen=True)
class Link(Named):
    """A name within a sentence or a cell that leads to another page."""

    words: str
    address: str  # relative to the page, quoted as addresses are


@dataclass(frozen=True)
class Coloured(Named):
    """A name in the colour that it has in the 3D scene and in figures (one of the palette, never from outside)."""

    words: str
    colour: str


@dataclass(frozen=True)
class Bar(Named):
    """A number with a bar behind it whose length is its share of the largest in the column."""

    words: str
    share: float  # 0 to 1


@dataclass(frozen=True)
class Small(Named):
    """A less important name beside another, smaller and grey on a page."""

    words: str


Span = str | Named
Words = Span | Sequence[Span]  # a sentence, or a cell of a table


def plain(words: Words) -> str:
    """Plain text of a sentence, each reference by its own text."""
    return str(words) if isinstance(words, Span) else "".join(map(str, words))


def spans(*parts: Words) -> tuple[Span, ...]:
    """One sentence of several parts, each a text, a reference or a sequence of these; empty texts are left out."""
    flat: list[Span] = []
    for part in parts:
        flat += [part] if isinstance(part, Span) else part
    return tuple(span for span in flat if span != "")


def joined(parts: Iterable[Words], between: str = "; ") -> tuple[Span, ...]:
    """Parts of a sentence with a text between each two of them."""
    return spans(*(words for k, part in enumerate(parts) for words in (between if k else "", part)))


def listed(names: Iterable[Words], last: str = "and") -> tuple[Span, ...]:
    """Names joined for a sentence, each with its reference: "a, b and c"."""
    *first, end = [*names] or [""]
    return joined((joined(first, ", "), end), f" {last} ") if first else spans(end)


def capitalised(words: Words) -> tuple[Span, ...]:
    """A sentence with a capital letter first, where it begins with a text."""
    first, *rest = spans(words) or ("",)
    return (first[:1].upper() + first[1:] if isinstance(first, str) else first, *rest)


def pose(pose_id: object, words: str = "") -> Reference:
    """Reference to a pose by its id."""
    return Reference("pose", str(pose_id), words or str(pose_id))


def joint(number: int, words: str = "") -> Reference:
    """Reference to a joint by its number, counted from 1."""
    return Reference("joint", number, words or str(number))


def effect(key: str, words: str = "") -> Reference:
    """Reference to an effect by its key in the catalogue."""
    return Reference("effect", key, words or key)


def effects(keys: Iterable[str], last: str = "and") -> tuple[Span, ...]:
    """List of references to effects: "backlash and tool_sag"."""
    return listed(map(effect, keys), last)


@dataclass(frozen=True)
class Block:
    """Part of a report, a panel or a notebook's view; `templates/blocks.html` has a macro of each class's name.

    A block without content, such as a list without sentences, is left out wherever blocks are shown.
    """

    @property
    def kind(self) -> str:
        """Name of its macro."""
        return type(self).__name__

    @property
    def is_empty(self) -> bool:
        """Whether it has nothing to show."""
        return not next((getattr(self, name) for name in _CONTENT if hasattr(self, name)), True)


def shown(blocks: Iterable[Block]) -> list[Block]:
    """Blocks that have something to show."""
    return [block for block in blocks if not block.is_empty]


@dataclass(frozen=True)
class Paragraph(Block):
    """One or several sentences; `soft` ones are smaller and grey, a `heading` is put above the blocks that follow."""

    words: Words
    soft: bool = False
    heading: bool = False


@dataclass(frozen=True)
class Bullets(Block):
    """A bulleted list of sentences."""

    sentences: Sequence[Words]


@dataclass(frozen=True)
class Table(Block):
    """A table of text: the columns listed in `left` are left-aligned words, others numbers; row `mark` is emphasised.

    rows_select: what a click on each row selects, one a row; None where it selects nothing.
    height: CSS length from which the page lets the table scroll by itself; "" shows all of it.
    """

    headers: Sequence[str]
    rows: Sequence[Sequence[object]]
    caption: str = ""
    left: Sequence[int] = (0,)
    mark: int | None = None
    rows_select: Sequence[Reference | None] = ()
    height: str = ""

    def cell_class(self, column: int, value: object) -> str:
        """The CSS class of a cell: a number, a short name, words, or words of which one is too long for a line."""
        if column not in self.left:
            return "num"
        words = plain(value) if isinstance(value, tuple | list) else str(value)
        if " " not in words and len(words) <= _SHORT_NAME:
            return "wide short"  # a date, a serial number, one word: not to be broken
        return "wide long" if max(map(len, words.split()), default=0) > LONG_NAME else "wide"


@dataclass(frozen=True)
class Folded(Block):
    """Blocks that open with a click on their title; omitted in plain text."""

    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True)
class Facts(Block):
    """A table of names and values, one row each."""

    pairs: Sequence[tuple[str, object]]


@dataclass(frozen=True)
class KeyFigures(Block):
    """A few important numbers, displayed before all else."""

    pairs: Sequence[tuple[str, object]]


@dataclass(frozen=True)
class Headline(Block):
    """Decrease of the error from stage to stage: figure and name of each stage, the noise, and a note below."""

    stages: Sequence[tuple[str, str]]
    noise: str
    note: str
    good: bool  # whether the last error is what noise leaves


@dataclass(frozen=True)
class Part:
    """Part of a whole: its name, its share in words, the share, its colour (of the palette), and a further note."""

    name: str
    words: str  # "3 %"
    share: float  # 0 to 1
    colour: str
    note: str  # shown where the mouse is on it


@dataclass(frozen=True)
class Shares(Block):
    """A whole divided into parts, drawn as one stacked bar with a legend; `words` say the same as a sentence."""

    words: str
    heading: str  # what is divided
    parts: Sequence[Part]
    note: str = ""


@dataclass(frozen=True)
class Verdict(Block):
    """The verdict on a result, marked with a colour of the palette (never one from outside)."""

    words: Words
    colour: str
    label: str = ""  # stands before it on a terminal


@dataclass(frozen=True)
class Drawing(Block):
    """A picture given as SVG, or a frame of another page, whose texts are escaped already."""

    svg: str
    caption: str


@dataclass(frozen=True)
class FigurePlace(Block):
    """Placeholder of a figure, drawn where a plotting library is available; omitted in plain text.

    figure: what draws it, a function's name in `inspector.figures`; it is called with `of`.
    height_px: 0 for the height that the figure itself has.
    """

    figure: str
    of: tuple[object, ...]
    caption: str
    height_px: int = 330
    width_px: int = 850


@dataclass(frozen=True)
class Section:
    """A heading and the blocks below it; a `brief` section is printed on a terminal, too."""

    heading: str
    blocks: Sequence[Block]
    brief: bool = False


@dataclass(frozen=True)
class Presentation:
    """Everything shown of a result: a title, the first blocks, and sections that open with a click in a notebook."""

    title: str
    head: Sequence[Block]
    sections: Sequence[Section] = ()
