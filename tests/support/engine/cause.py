"""A cause: something that moves an arm, or what is reported of it, by as much as its size says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tests.support.engine.mechanics import Array, Deformation, Posture

if TYPE_CHECKING:
    from tests.support.engine.cell import Cell

Deform = Callable[["Cell", Posture, float], Deformation]
Report = Callable[["Cell", Posture, Array, float], Array]


@dataclass(frozen=True, eq=False)
class Cause:
    """A cause whose displacement grows with its size, mostly in proportion; size 1 has no special meaning."""

    name: str
    deform: Deform | None = None  # of the arm, in the posture in which it is loaded
    report: Report | None = None  # (N, 3) mm added to what the scanner reports, by where the point really is
