"""How a measuring program moves, waits and triggers. Nothing slow is imported."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Signal:
    """What tells the instrument to measure, or the arm that it has measured.

    A trigger is `none`, a pulse of a digital `output`, or a line to a `socket`. Until a pose is measured the arm stands
    for a `time`, waits for a digital `input`, or for a line as `reply` on the socket.
    """

    kind: Literal["none", "output", "socket", "time", "input", "reply"]
    signal: str = ""  # number or name of an output or input
    host: str = ""
    port: int = 0


@dataclass(frozen=True)
class MeasuringOptions:
    """How a measuring program moves, waits and triggers."""

    speed: float | None = None  # in the unit of the language; None: its usual one
    settle_s: float = 1.0  # at rest before the trigger
    stand_s: float = 3.0  # after the trigger, where nothing tells that it is measured
    trigger: Signal = Signal("none")
    pulse_s: float = 0.2  # length of the pulse of an output
    measured: Signal = Signal("time")
    tool_name: str = ""  # tool whose load counts: number (KRL) or name (RAPID); "" leaves the controller's
