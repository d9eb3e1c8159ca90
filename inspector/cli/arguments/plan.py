"""Arguments of `plan`. Nothing slow is imported."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from calib.options import PLAN_CRITERIA
from inspector.cli.arguments import values
from inspector.cli.arguments.shared import add_fit, add_json, links_arguments


def plan_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of `plan`: purpose and number of the poses, and the scanner's place."""
    sub.add_argument(
        "--poses", type=values.pose_count, metavar="K", help="a first set of K poses (default 20 for a robot)"
    )
    sub.add_argument(
        "--add",
        type=values.pose_count,
        metavar="K",
        help="K more poses for a dataset (default 5; 8 to watch; as many as it takes to prove)",
    )
    sub.add_argument(
        "--for",
        dest="purpose",
        default="calibration",
        metavar="WHAT",
        help="calibration (default), split (settle a set that a diagnosis left open), prove (the same by changing one "
        "condition; of a robot, what gives way under a payload), watch (8 check poses), or effects with commas between",
    )
    sub.add_argument(
        "--criterion",
        choices=PLAN_CRITERIA,
        default="I",
        help="of a calibration: I, right over the region (default), or D, parameters known",
    )
    sub.add_argument(
        "--region",
        type=values.plan_region,
        default="auto",
        metavar="WHERE",
        help="where it is to be right: auto (the test poses where there are), test, measurable, all (joints' ranges), "
        "or a box X0,X1,Y0,Y1,Z0,Z1 of the tool point, mm in the base frame",
    )
    sub.add_argument(
        "--candidates", type=Path, metavar="FILE.csv", help="choose among these poses (columns as poses.csv) alone"
    )
    sub.add_argument(
        "--target",
        choices=("corner", "ball"),
        default="corner",
        help="of a robot: what is measured, a jig that shows three faces, or a ball or mirror, seen from everywhere",
    )
    sub.add_argument(
        "--boxes",
        type=values.box,
        action="append",
        default=[],
        metavar="X0,X1,Y0,Y1,Z0,Z1",
        help="of a robot: an obstacle, mm in the base frame; may be given several times",
    )
    sub.add_argument(
        "--scanner",
        type=values.scanner_place,
        metavar="X,Y,Z[,TOWARD]",
        help="where the scanner stands, mm in the base frame, and the point that it looks at (x,y,z)",
    )
    sub.add_argument(
        "--noise-mm",
        type=values.rmse_mm,
        metavar="X",
        help="of a measured point, each axis, for a robot (default 0.05)",
    )
    sub.add_argument(
        "--payload-kg",
        type=values.mass_kg,
        metavar="X",
        help="a known payload that some poses may carry, for --for split, prove (default 2) and effects",
    )
    sub.add_argument("--seed", type=int, default=0, help="of the poses to choose from (default 0)")
    sub.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="write the poses: .csv (poses.csv), .script (URScript), .dat (KRL), .mod (RAPID), .yaml (ROS trajectory)",
    )
    _program_arguments(sub)
    links_arguments(sub)
    add_fit(sub)
    add_json(sub)


def _program_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of the program that measures the poses: its file, template, speed, waits and signals."""
    sub.add_argument(
        "--program",
        type=Path,
        metavar="FILE",
        help="write the program that moves to each pose, settles, triggers, waits and records the joints: .script "
        "(URScript), .src (KRL, and its .dat), .mod (RAPID)",
    )
    sub.add_argument(
        "--template", type=Path, metavar="FILE", help="of --program: your own template (Jinja2), for any language"
    )
    sub.add_argument(
        "--template-out", type=Path, metavar="FILE", help="write the template of --program's language, to be edited"
    )
    sub.add_argument(
        "--speed",
        type=values.speed,
        metavar="X",
        help="of --program: URScript deg/s of the leading joint (default 15), KRL %% of each axis's top speed (10), "
        "RAPID mm/s of the tool (100)",
    )
    sub.add_argument("--settle-s", type=values.wait_s, metavar="X", help="at rest before the trigger (default 1)")
    sub.add_argument(
        "--trigger",
        type=values.trigger,
        metavar="SIGNAL",
        help="output:NUMBER (RAPID: output:NAME), a pulse, or socket:HOST:PORT, a line with the pose's name; "
        "default none",
    )
    sub.add_argument("--pulse-s", type=values.seconds, metavar="X", help="length of the pulse (default 0.2)")
    sub.add_argument(
        "--measured",
        type=values.measured_signal,
        metavar="SIGNAL",
        help="wait for input:NUMBER (RAPID: input:NAME), or reply (a line on the socket), however long it takes",
    )
    sub.add_argument(
        "--stand-s", type=values.wait_s, metavar="X", help="without --measured: at rest after the trigger (default 3)"
    )
    sub.add_argument(
        "--tool-name", metavar="NAME", help="tool whose load counts: number (KRL), name (RAPID, default tool0)"
    )
