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

    path: Path = argument("dataset folder, or a robot: a file of any form, rb5 or panda")
    poses: int | None = option("a first set of K poses (default 20 for a robot)", metavar="K", parse=values.pose_count)
    add: int | None = option(
        "K more poses for a dataset (default 5, or as many as the purpose takes)",
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
    seed: int = option("of the poses to choose from (default 0)", 0, parse=values.seed)
    out: Path | None = option("write the poses: .csv (poses.csv)")
