"""Arguments common to several commands, and arguments of the commands on robots. Nothing slow is imported."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from calib.options import BUILTIN_ROBOTS, RESIDUAL_KINDS
from inspector.cli.arguments import values


def add_json(sub: ArgumentParser) -> None:
    """Add the option --json."""
    sub.add_argument("--json", action="store_true", help="one JSON object on stdout, nothing else")


def add_fit(sub: ArgumentParser) -> None:
    """Add the options of a fit (`calib.options.FitOptions`)."""
    add_residual(sub)
    add_effects(sub)
    sub.add_argument("--no-prior", action="store_true", help="do not hold parameters within their tolerance")
    sub.add_argument(
        "--tolerance",
        action="append",
        default=[],
        type=values.named_number,
        metavar="NAME=VALUE",
        help="tolerance of one parameter, mm or rad (default 1 mm, 0.0087 rad); may be given several times",
    )
    sub.add_argument(
        "--hold",
        action="append",
        default=[],
        metavar="NAME",
        help="keep a parameter at its nominal: d5, theta1 or θ1; links: all of the arm",
    )
    add_leave_out(sub)
    add_finder(sub)
    sub.add_argument("--robust", action="store_true", help="leave poses out that stand out of all others")


def add_adding(sub: ArgumentParser) -> None:
    """Add the option --add."""
    sub.add_argument(
        "--add",
        action="append",
        default=[],
        metavar="NAME",
        help="add an effect as the ranking proposes it: only the joints that show it, as the page's button does",
    )


def add_learned_out(sub: ArgumentParser) -> None:
    """Add the option --learned-out."""
    sub.add_argument(
        "--learned-out",
        type=Path,
        metavar="FILE.py",
        help="write the curves of smooth_joint_error as an effects file of your own",
    )


def add_model_out(sub: ArgumentParser) -> None:
    """Add the option --model-out."""
    sub.add_argument(
        "--model-out", type=Path, metavar="FILE.json", help="write the full model, which correct and validate take"
    )


def add_leave_out(sub: ArgumentParser) -> None:
    """Add the option --leave-out."""
    sub.add_argument(
        "--leave-out",
        action="append",
        default=[],
        metavar="POSE",
        help="take no notice of what was measured at a pose; may be given several times",
    )


def add_model(sub: ArgumentParser, help: str) -> None:
    """Add the option --model."""
    sub.add_argument("--model", type=Path, metavar="FILE.json", help=f"{help} (of calibrate --model-out)")


def add_effects(sub: ArgumentParser) -> None:
    """Add the options --effect and --effects-file."""
    sub.add_argument(
        "--effect", action="append", default=[], metavar="NAME", help="put a whole effect into the model, all joints"
    )
    sub.add_argument("--effects-file", type=Path, metavar="FILE.py", help="effects of your own")


def add_finder(sub: ArgumentParser) -> None:
    """Add the option --finder."""
    sub.add_argument(
        "--finder", type=Path, metavar="FILE.py", help="find(scan, wanted) of your own, for targets in the scans"
    )


def add_residual(sub: ArgumentParser) -> None:
    """Add the option --residual."""
    sub.add_argument(
        "--residual",
        choices=RESIDUAL_KINDS,
        default=None,
        help="what is fitted: places with the scanner's place unknown (position, the default), distances to the "
        "reference pose, distances of pairs of poses, or full poses (the default where a camera saw a board)",
    )


def convert_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of `convert`: IN, OUT, and options that select the arm in the files."""
    sub.add_argument("source", type=Path, metavar="IN", help="a robot: .urdf .xacro .toml .yaml .conf .csv .xml")
    sub.add_argument(
        "out", type=Path, metavar="OUT", help="the form follows the suffix: .toml .urdf .xml (MuJoCo) .yaml"
    )
    links_arguments(sub)
    sub.add_argument(
        "--template", type=Path, metavar="ROBOT.urdf", help="your own URDF of this arm: only origins are changed"
    )
    sub.add_argument("--force", action="store_true", help="replace a file that is there")
    sub.add_argument("--json", action="store_true", help="one JSON object on stdout, nothing else")


def import_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of `import`: robot, tables, and the meaning of their columns."""
    sub.add_argument(
        "--from",
        dest="source",
        type=Path,
        metavar="ZIP|FOLDER",
        help="what holds robot, tables and scans; each file is recognised",
    )
    sub.add_argument("--robot", metavar="FILE|NAME", help=f"a robot's file, or {' or '.join(BUILTIN_ROBOTS)}")
    links_arguments(sub)
    sub.add_argument(
        "--joints",
        type=Path,
        metavar="FILE",
        help="joint values, a row a pose, or a recording (.bag, .mcap, log.csv ...)",
    )
    sub.add_argument(
        "--points", type=Path, metavar="FILE", help="measured points (default: in --joints); FILE#TOPIC of a bag"
    )
    sub.add_argument("--scans", type=Path, metavar="FOLDER", help="point clouds, a file a pose")
    sub.add_argument(
        "--map",
        action="append",
        default=[],
        metavar="COLUMN=MEANING",
        help="what a column means: q1_deg, -q2_rad, q3_deg+90, x_mm, pose, role, ignore ...; several times",
    )
    sub.add_argument(
        "--sigma",
        type=values.sigma_mm,
        metavar="MM",
        help="standard deviation of a measured point, each axis, in mm (default: unknown, taken from the residual)",
    )
    sub.add_argument(
        "--place-sigma",
        type=values.sigma_mm,
        metavar="MM",
        help="standard deviation of the known places that were visited, such as the sockets of a printed plate, each "
        "axis, in mm (default: exact)",
    )
    sub.add_argument(
        "--tool",
        type=values.tool_mm,
        metavar="X,Y,Z",
        help="the measured point from the flange (a URDF's last link, else the last joint), in mm, such as "
        "--tool=0,0,88.5 (default: as the robot's file has it)",
    )
    camera_arguments(sub)
    sub.add_argument(
        "--skip-bad-rows",
        action="store_true",
        help="leave out rows that cannot be read, at most half of a table, and say which",
    )
    sub.add_argument("--dry-run", action="store_true", help="say what would be made, and write nothing")
    sub.add_argument("--diagnose", action="store_true", help="go on to the first diagnosis at once")
    add_json(sub)


def camera_arguments(sub: ArgumentParser) -> None:
    """Add the options of an import of what a camera sees."""
    sub.add_argument("--images", type=Path, metavar="FOLDER", help="images of a board, one a pose (extra `camera`)")
    sub.add_argument(
        "--board",
        metavar="KIND:SIZES",
        help="what they show: charuco:8x6:30:22 (squares, mm of a square, mm of a marker), checkerboard:9x6:25, "
        "apriltag:6x6:40:12 (tags, mm of a tag, mm of a gap), apriltag:50 (a single one), aruco:...",
    )
    sub.add_argument(
        "--board-sigma",
        type=float,
        metavar="PERCENT",
        help="standard deviation of the board's size, 0.1 by a caliper over all of it (default: taken as exact)",
    )
    sub.add_argument(
        "--dictionary", metavar="NAME", help="of the markers, such as DICT_4X4_50 (default: by the images)"
    )
    sub.add_argument(
        "--intrinsics",
        type=Path,
        metavar="FILE",
        help="the lens: ROS camera_info.yaml, OpenCV's YAML, XML or JSON (default: found from the images)",
    )
    sub.add_argument(
        "--marker-poses",
        type=Path,
        metavar="FILE",
        help="poses of a marker in the camera's frame that another program measured: CSV, YAML of ROS or easy_handeye, "
        "OpenCV's files",
    )
    sub.add_argument(
        "--flange-poses",
        type=Path,
        metavar="FILE",
        help="poses of the flange as the controller tells them, in place of --robot and --joints: the camera's place "
        "is found, and nothing of the links",
    )
    sub.add_argument("--length-unit", choices=("mm", "cm", "m"), help="of those poses, where the file does not tell")
    sub.add_argument(
        "--mount", choices=("flange", "room"), help="where the camera is (default: what the poses clearly show)"
    )


def links_arguments(sub: ArgumentParser) -> None:
    """Add the options that select the arm's end links in a URDF."""
    sub.add_argument("--tip", metavar="LINK", help="the last link (default: the only one that is a tip)")
    sub.add_argument("--base", metavar="LINK", help="the first link (default: the root)")
    sub.add_argument(
        "--convention", choices=("standard", "modified"), help="of a table of theta, d, a, alpha (modified: Craig's)"
    )
    sub.add_argument("--model", metavar="NAME", help="which arm a UR calibration.conf is of, such as ur10e")
    sub.add_argument(
        "--xacro-arg",
        action="append",
        default=[],
        type=values.xacro_argument,
        metavar="NAME:=VALUE",
        help="an argument of a .xacro; may be given several times",
    )
    sub.add_argument(
        "--package",
        "--xacro-package",
        dest="package",
        action="append",
        default=[],
        type=values.named_folder,
        metavar="NAME=FOLDER",
        help="folder of a ROS package: what $(find NAME) is in a .xacro, and where package://NAME/... of meshes lies; "
        "several times",
    )
