"""Options of `jig`. Nothing slow is imported."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from inspector.cli.options.declaration import argument, option
from inspector.cli.options.shared import Output
from inspector.cli.options.values import number_above_0, whole


def grid(text: str) -> tuple[int, int]:
    """Columns and rows from "2x3"."""
    columns, separator, rows = text.lower().partition("x")
    if not separator:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of columns and rows; write 2x3")
    return whole(columns, 1, 26, "columns"), whole(rows, 1, 26, "rows")


size_mm = number_above_0("a size; a number of mm above 0")


@dataclass(frozen=True, kw_only=True)
class JigOptions(Output):
    """Parts to print for measuring: sockets for a ball, a three-faced corner."""

    part: str = argument("sockets for a ball, three faces, a ball's stem", choices=("plate", "corner", "stem"))
    out: Path | None = option("default: a file of the part's name", metavar="FILE.stl")
    sockets: tuple[int, int] = option("columns and rows of a plate (default: 2x2)", (2, 2), metavar="NxM", parse=grid)
    pitch_mm: float = option("between sockets (default: 100)", 100.0, metavar="MM", parse=size_mm)
    ball_mm: float = option("ball's diameter (default: 20)", 20.0, metavar="MM", parse=size_mm)
    edge_mm: float = option("edges of the corner (default: 60)", 60.0, metavar="MM", parse=size_mm)
    length_mm: float = option("flange to the ball's centre (default: 80)", 80.0, metavar="MM", parse=size_mm)
    bolts: str = option("bolt circle by ISO 9409-1 (default: 50-4-M6)", "50-4-M6", metavar="D-N-M")
