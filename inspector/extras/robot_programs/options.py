"""Options that robot programs add to `plan` and `correct`. Nothing slow is imported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from inspector.cli.options.declaration import option, several


@dataclass(frozen=True, kw_only=True)
class PlanProgramOptions:
    """The program that measures the poses."""

    program: Path | None = option(
        "write the program that moves to each pose, settles, records the joints and stands while it is measured: "
        ".script (URScript), .src (KRL, and its .dat), .mod (RAPID)",
    )


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
    tool_frame: str | None = option(
        "tool frame on the flange, where the program does not define it: x,y,z,rx,ry,rz (URScript, m and rad), "
        "X,Y,Z,A,B,C (KRL, mm and degrees), x,y,z,q1,q2,q3,q4 (RAPID, mm)",
        metavar="NUMBERS",
    )
    work_frame: str | None = option(
        "work frame in the robot's base, where the program does not define it, in the same numbers",
        metavar="NUMBERS",
    )
