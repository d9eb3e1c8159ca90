"""What is found in a robot program: targets with their frames, and what looks like one and is left."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.array_types import Array

Kind = Literal["joints", "pose"]
UNKNOWN_PLACE = -1  # of a target


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
    transform: Array | None  # (4, 4) mm; None where the program's files do not define it, so that a user has to give it

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

    kind: Kind
    name: str = ""  # variable that holds it, or the instruction in which it stands
    line: int = 0  # from 1
    numbers: tuple[Number, ...] = ()  # six joint values, or a position and an orientation in the maker's form
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
