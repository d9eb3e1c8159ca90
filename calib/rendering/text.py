"""Blocks rendered as plain text for a terminal: sentences as lines, tables in columns, no figures."""

from __future__ import annotations

from collections.abc import Sequence

from calib.rendering.blocks import (
    Block,
    Bullets,
    Facts,
    Headline,
    KeyFigures,
    Paragraph,
    Presentation,
    Shares,
    Table,
    Verdict,
    Words,
    plain,
    shown,
)

_INDENT = "  "


def text(told: Presentation) -> str:
    """Plain text of a presentation's first blocks and brief sections."""
    lines = list(_lines(told.head))
    for section in told.sections:
        if section.brief and shown(section.blocks):
            lines += [f"{section.heading}:", *(f"{_INDENT}{line}" for line in _lines(section.blocks))]
    return "\n".join(line.rstrip() for line in lines)


def block_text(*blocks: Block) -> str:
    """Plain text of some blocks."""
    return "\n".join(line.rstrip() for line in _lines(blocks))


def _lines(blocks: Sequence[Block]) -> list[str]:
    return [line for block in shown(blocks) for line in _block_lines(block)]


def _block_lines(block: Block) -> list[str]:
    match block:
        case Verdict():
            return f"{block.label}: {plain(block.words)}".removeprefix(": ").splitlines()
        case Paragraph():
            return plain(block.words).splitlines()
        case Bullets():
            return [f"{_INDENT}{plain(sentence)}" for sentence in block.sentences]
        case Facts() | KeyFigures():
            return _columns([(name, _cell(value)) for name, value in block.pairs], left=(0, 1))
        case Headline():
            return [f"{' → '.join(f'{size} {name}' for size, name in block.stages)} ({block.noise})", block.note]
        case Shares():
            return [block.words]
        case Table():
            rows = [tuple(block.headers), *(tuple(_cell(value) for value in row) for row in block.rows)]
            return [*([f"{block.caption}:"] if block.caption else []), *_columns(rows, block.left)]
        case _:
            return []  # a picture


def _cell(value: object) -> str:
    return plain(value) if isinstance(value, tuple | list) else str(value)


def _columns(rows: Sequence[Sequence[Words]], left: Sequence[int]) -> list[str]:
    """Lines of a table with aligned cells: columns in `left` to the left, the others to the right."""
    cells = [[plain(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)] if cells else []
    return [
        _INDENT
        + _INDENT.join(
            cell.ljust(width) if k in left else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    ]
