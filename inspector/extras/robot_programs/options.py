"""Options that robot programs add to `plan` and `correct`. Nothing slow is imported."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.extras.robot_programs.measuring_options import Signal
from inspector.cli.options import values
from inspector.cli.options.declaration import option, several

_LONGEST_WAIT_S = 3600.0  # that an arm stands at a pose


def parsed_trigger(text: str) -> Signal:
    """Trigger of a measurement, such as "output:1" or "socket:10.0.0.5:5000"."""
    kind, _, rest = text.partition(":")
    if kind == "output" and rest.strip():
        return Signal("output", rest.strip())
    host, _, number = rest.rpartition(":")
    if kind == "socket" and host and number.isdecimal() and 0 < int(number) < 65536:
        return Signal("socket", host=host, port=int(number))
    raise argparse.ArgumentTypeError(f"{text!r} is no trigger; output:1, output:doMeasure or socket:10.0.0.5:5000")


def parsed_signal(text: str) -> Signal:
    """Signal that a pose is measured, such as "input:2", or "reply"."""
    kind, _, rest = text.partition(":")
    if kind == "input" and rest.strip():
        return Signal("input", rest.strip())
    if text == "reply":
        return Signal("reply")
    raise argparse.ArgumentTypeError(f"{text!r} is no signal to wait for; input:2, input:diDone or reply")


parsed_speed = values.number_above_0("a speed; a number above 0, in the unit of the language")
parsed_wait_s = values.number_that(
    lambda s: 0.0 <= s <= _LONGEST_WAIT_S, f"a time to stand; seconds, 0 to {_LONGEST_WAIT_S:g}"
)


@dataclass(frozen=True, kw_only=True)
class PlanProgramOptions:
    """The program that measures the poses: its file, speed, waits and signals."""

    program: Path | None = option(
        "write the program that moves to each pose, settles, triggers, waits and records the joints: .script "
        "(URScript), .src (KRL, and its .dat), .mod (RAPID)",
    )
    speed: float | None = option(
        "of --program: URScript deg/s of the leading joint (default 15), KRL %% of each axis's top speed (10), "
        "RAPID mm/s of the tool (100)",
        metavar="X",
        parse=parsed_speed,
    )
    settle_s: float | None = option("at rest before the trigger (default 1)", metavar="X", parse=parsed_wait_s)
    trigger: Signal | None = option(
        "output:NUMBER (RAPID: output:NAME), a pulse, or socket:HOST:PORT, a line with the pose's name; default none",
        metavar="SIGNAL",
        parse=parsed_trigger,
    )
    pulse_s: float | None = option("length of the pulse (default 0.2)", metavar="X", parse=values.seconds)
    measured: Signal | None = option(
        "wait for input:NUMBER (RAPID: input:NAME), or reply (a line on the socket), however long it takes",
        metavar="SIGNAL",
        parse=parsed_signal,
    )
    stand_s: float | None = option(
        "without --measured: at rest after the trigger (default 3)", metavar="X", parse=parsed_wait_s
    )
    tool_name: str | None = option("tool whose load counts: number (KRL), name (RAPID, default tool0)", metavar="NAME")


@dataclass(frozen=True, kw_only=True)
class CorrectProgramOptions:
    """A robot program in place of joint targets."""

    program: Path | None = option(
        "a robot program to correct: .script (URScript), .src or .dat (KRL), .mod, .sys or .prg (RAPID)",
        group="targets",
        required=True,
    )
    others: Sequence[Path] = several(
        "of --program: another file of the controller, which defines tools and bases or moves to the targets "
        "($config.dat, a module); give it several times for several",
        spelled=["--with"],
    )
    tool_frame: Sequence[str] = several(
        "tool frame on the flange, where the program does not define it (several by their names): "
        "x,y,z,rx,ry,rz (URScript, m and rad), X,Y,Z,A,B,C (KRL, mm and degrees), x,y,z,q1,q2,q3,q4 (RAPID, mm)",
        metavar="[NAME=]NUMBERS",
    )
    work_frame: Sequence[str] = several(
        "work frame in the robot's base, where the program does not define it (several by their names): "
        "x,y,z,rx,ry,rz (URScript, m and rad), X,Y,Z,A,B,C (KRL, mm and degrees), x,y,z,q1,q2,q3,q4 (RAPID, mm)",
        metavar="[NAME=]NUMBERS",
    )
