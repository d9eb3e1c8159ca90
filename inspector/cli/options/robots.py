"""Options of the commands on robots' files and on a user's files. Nothing slow is imported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.options import BUILTIN_ROBOTS
from inspector.cli.options import values
from inspector.cli.options.declaration import argument, flag, option, several
from inspector.cli.options.shared import RobotFileOptions


@dataclass(frozen=True, kw_only=True)
class ConvertOptions(RobotFileOptions):
    """A robot from one form into another: URDF, robot.toml, YAML, tables."""

    source: Path = argument("a robot: .urdf .xacro .toml .yaml .conf .csv .xml", metavar="IN")
    out: Path = argument("the form follows the suffix: .toml .urdf .xml (MuJoCo) .yaml", metavar="OUT")
    template: Path | None = option("your own URDF of this arm: only origins are changed", metavar="ROBOT.urdf")
    force: bool = flag("replace a file that is there")


@dataclass(frozen=True, kw_only=True)
class CameraOptions:
    """Options of an import of what a camera sees."""

    images: Path | None = option("images of a board, one a pose (extra `camera`)", metavar="FOLDER")
    board: str | None = option(
        "what they show: charuco:8x6:30:22 (squares, mm of a square, mm of a marker), checkerboard:9x6:25, "
        "apriltag:6x6:40:12 (tags, mm of a tag, mm of a gap), apriltag:50 (a single one), aruco:...",
        metavar="KIND:SIZES",
    )
    board_sigma: float | None = option(
        "standard deviation of the board's size, 0.1 by a caliper over all of it (default: taken as exact)",
        metavar="PERCENT",
    )
    dictionary: str | None = option("of the markers, such as DICT_4X4_50 (default: by the images)", metavar="NAME")
    intrinsics: Path | None = option(
        "the lens: ROS camera_info.yaml, OpenCV's YAML, XML or JSON (default: found from the images)", metavar="FILE"
    )
    marker_poses: Path | None = option(
        "poses of a marker in the camera's frame that another program measured: CSV, YAML of ROS or easy_handeye, "
        "OpenCV's files",
        metavar="FILE",
    )
    flange_poses: Path | None = option(
        "poses of the flange as the controller tells them, in place of --robot and --joints: the camera's place "
        "is found, and nothing of the links",
        metavar="FILE",
    )
    length_unit: str | None = option("of those poses, where the file does not tell", choices=("mm", "cm", "m"))
    mount: str | None = option("where the camera is (default: what the poses clearly show)", choices=("flange", "room"))


@dataclass(frozen=True, kw_only=True)
class ImportOptions(CameraOptions, RobotFileOptions):
    """A dataset folder from a robot, joint values and measured points, or from a zip of them."""

    path: Path = argument("folder to make", metavar="PATH")
    source: Path | None = option(
        "what holds robot, tables and scans; each file is recognised", metavar="ZIP|FOLDER", spelled=["--from"]
    )
    robot: str | None = option(f"a robot's file, or {' or '.join(BUILTIN_ROBOTS)}", metavar="FILE|NAME")
    joints: Path | None = option(
        "joint values, a row a pose, or a recording (.bag, .mcap, log.csv ...)", metavar="FILE"
    )
    points: Path | None = option("measured points (default: in --joints); FILE#TOPIC of a bag", metavar="FILE")
    scans: Path | None = option("point clouds, a file a pose", metavar="FOLDER")
    map: Sequence[str] = several(
        "what a column means: q1_deg, -q2_rad, q3_deg+90, x_mm, pose, role, ignore ...; several times",
        metavar="COLUMN=MEANING",
    )
    sigma: float | None = option(
        "standard deviation of a measured point, each axis, in mm (default: unknown, taken from the residual)",
        metavar="MM",
        parse=values.sigma_mm,
    )
    place_sigma: float | None = option(
        "standard deviation of the known places that were visited, such as the sockets of a printed plate, each "
        "axis, in mm (default: exact)",
        metavar="MM",
        parse=values.sigma_mm,
    )
    tool: tuple[float, float, float] | None = option(
        "the measured point from the flange (a URDF's last link, else the last joint), in mm, such as "
        "--tool=0,0,88.5 (default: as the robot's file has it)",
        metavar="X,Y,Z",
        parse=values.tool_mm,
    )
    skip_bad_rows: bool = flag("leave out rows that cannot be read, at most half of a table, and say which")
    dry_run: bool = flag("say what would be made, and write nothing")
    diagnose: bool = flag("go on to the first diagnosis at once")
