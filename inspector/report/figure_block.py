"""Figures among the blocks of a report, and their conversion to pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import plotly.graph_objects as go

from calib.present.blocks import Block, Drawing, FigurePlace
from inspector.figures.results.places import draw
from inspector.figures.svg.figure import svg_of


@dataclass(frozen=True)
class Figure(Block):
    """A plotly figure in its light version with its caption, drawn by the page as SVG in the page's colours."""

    kind: ClassVar[str] = "figure"
    drawn: go.Figure
    caption: str
    height_px: int = 330
    width_px: int = 850


def still(blocks: Sequence[Block], names: Iterator[str]) -> list[Block]:
    """The blocks with figures replaced by SVG; `names` are the figures' names, which prefix their ids."""
    return [_still(block, names) for block in blocks]


def _still(block: Block, names: Iterator[str]) -> Block:
    if isinstance(block, FigurePlace):
        return Drawing(draw(block, next(names)), block.caption)
    if not isinstance(block, Figure):
        return block
    drawn = svg_of(block.drawn, block.width_px, block.height_px, name=next(names), title=block.caption)
    return Drawing(drawn, block.caption)
