"""Options of the command that plans poses. Nothing slow is imported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.options import PLAN_CRITERIA
from calib.planning.purpose import purposes
from inspector.cli.options import values
from inspector.cli.options.declaration import argument, option, several
from inspector.cli.options.shared import FittingOptions, RobotFileOptions


@dataclass(frozen=True, kw_only=True)
class PlanOptions(FittingOptions, RobotFileOptions):
    """Which poses to measure, and the error that they will leave."""

    path: Path = argument("dataset folder, or a robot: a file of any form, rb5 or panda", metavar="PATH")
    poses: int | None = option("a first set of K poses (default 20 for a robot)", metavar="K", parse=values.pose_count)
    add: int | None = option(
        "K more poses for a dataset (default 5; 8 to watch; as many as it takes to prove)",
        metavar="K",
        parse=values.pose_count,
    )
    purpose: str = option(
        ", ".join([*(purpose.help for purpose in purposes().values()), "or effects with commas between"]),
        "calibration",
        metavar="WHAT",
        spelled=["--for"],
    )
    criterion: str = option(
        "of a calibration: I, right over the region (default), or D, parameters known", "I", choices=PLAN_CRITERIA
    )
    region: str | tuple[float, ...] = option(  # a name, or x0, x1, y0, y1, z0, z1 of a box, mm
        "where it is to be right: auto (the test poses where there are), test, measurable, all (joints' ranges), "
        "or a box X0,X1,Y0,Y1,Z0,Z1 of the tool point, mm in the base frame",
        "auto",
        metavar="WHERE",
        parse=values.plan_region,
    )
    candidates: Path | None = option("choose among these poses (columns as poses.csv) alone", metavar="FILE.csv")
    target: str = option(
        "of a robot: what is measured, a jig that shows three faces, or a ball or mirror, seen from everywhere",
        "corner",
        choices=("corner", "ball"),
    )
    boxes: Sequence[tuple[float, ...]] = several(  # as the box of a region
        "of a robot: an obstacle, mm in the base frame; may be given several times",
        metavar="X0,X1,Y0,Y1,Z0,Z1",
        parse=values.box,
    )
    scanner: tuple[float, ...] | None = option(  # x, y, z, mm; then those of the point that it looks at
        "where the scanner stands, mm in the base frame, and the point that it looks at (x,y,z)",
        metavar="X,Y,Z[,TOWARD]",
        parse=values.scanner_place,
    )
    noise_mm: float | None = option(
        "of a measured point, each axis, for a robot (default 0.05)", metavar="X", parse=values.rmse_mm
    )
    payload_kg: float | None = option(
        "a known payload that some poses may carry, for --for split, prove (default 2) and effects",
        metavar="X",
        parse=values.mass_kg,
    )
    seed: int = option("of the poses to choose from (default 0)", 0)
    out: Path | None = option(
        "write the poses: .csv (poses.csv), .script (URScript), .dat (KRL), .mod (RAPID), .yaml (ROS trajectory)",
        metavar="FILE",
    )
    program: Path | None = option(
        "write the program that moves to each pose, settles, triggers, waits and records the joints: .script "
        "(URScript), .src (KRL, and its .dat), .mod (RAPID)",
        metavar="FILE",
    )
    template: Path | None = option("of --program: your own template (Jinja2), for any language", metavar="FILE")
    template_out: Path | None = option("write the template of --program's language, to be edited", metavar="FILE")
    speed: float | None = option(
        "of --program: URScript deg/s of the leading joint (default 15), KRL %% of each axis's top speed (10), "
        "RAPID mm/s of the tool (100)",
        metavar="X",
        parse=values.speed,
    )
    settle_s: float | None = option("at rest before the trigger (default 1)", metavar="X", parse=values.wait_s)
    trigger: tuple[str, ...] | None = option(  # output and its signal, or socket, host and port
        "output:NUMBER (RAPID: output:NAME), a pulse, or socket:HOST:PORT, a line with the pose's name; default none",
        metavar="SIGNAL",
        parse=values.trigger,
    )
    pulse_s: float | None = option("length of the pulse (default 0.2)", metavar="X", parse=values.seconds)
    measured: tuple[str, ...] | None = option(  # input and its signal, or reply
        "wait for input:NUMBER (RAPID: input:NAME), or reply (a line on the socket), however long it takes",
        metavar="SIGNAL",
        parse=values.measured_signal,
    )
    stand_s: float | None = option(
        "without --measured: at rest after the trigger (default 3)", metavar="X", parse=values.wait_s
    )
    tool_name: str | None = option("tool whose load counts: number (KRL), name (RAPID, default tool0)", metavar="NAME")
