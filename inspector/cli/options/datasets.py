"""Options of the page, of the commands on datasets that fit nothing, and of those on robots' and users' files.

Nothing slow is imported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.options import BUILTIN_ROBOTS
from inspector.cli.options import values
from inspector.cli.options.declaration import argument, flag, option, several
from inspector.cli.options.shared import (
    A_DATASET,
    DATASETS,
    Output,
    RobotFileOptions,
    WithFinder,
    WithLeaveOut,
    WithResidual,
)


@dataclass(frozen=True, kw_only=True)
class ServeOptions:
    """The web app."""

    path: Path = argument(DATASETS)
    host: str = option("address to bind (default: this machine only)", "127.0.0.1")
    port: int = option("default 8080; 0 takes a free one", 8080, parse=values.port)
    session: Path | None = option("open a saved session again", metavar="FILE.json")
    data: Path | None = option("let pages import datasets to this folder, and list those in it", metavar="DIR")
    effects_file: Path | None = option("effects of your own, read again when it changes", metavar="FILE.py")


@dataclass(frozen=True, kw_only=True)
class CornersOptions(WithFinder, Output):
    """Find the jig's corner in every scan."""

    path: Path = argument(A_DATASET)
    out: Path | None = option("write the corners as points.csv")
    orientation: bool = flag("with the jig's orientation in --out")
    processes: int | None = option("default: one for each core", metavar="N", parse=values.process_count)


@dataclass(frozen=True, kw_only=True)
class RedundancyOptions(WithResidual, WithLeaveOut, Output):
    """Which parameters cannot be told apart (Pearson's r), and the rank of the model."""

    path: Path = argument(A_DATASET)
    out: Path | None = option("write Pearson's r of all pairs", metavar="FILE.csv")


@dataclass(frozen=True, kw_only=True)
class EffectsOptions(Output):
    """The catalogue of effects."""


@dataclass(frozen=True, kw_only=True)
class SampleOptions(Output):
    """A sample dataset to try things on."""

    name: str | None = argument("the sample to write; without it they are listed", required=False)
    out: Path | None = option("where to (default: a folder of its name)", metavar="FOLDER")


@dataclass(frozen=True, kw_only=True)
class SimulateOptions(Output):
    """Make a dataset with known truth."""

    path: Path = argument("folder to make")
    robot: str = option(f"{', '.join(BUILTIN_ROBOTS)}, or a robot.toml", required=True)
    poses: int = option("default 64", 64, parse=values.simulated_pose_count)
    effect: Sequence[str] = several("may be given several times", metavar="NAME")
    scans: bool = flag("cast scans of the jig instead of points")
    mount: str = option(
        "where the scanner is; on the flange it sees a jig that stands in the room (default room)",
        "room",
        choices=("room", "flange"),
    )
    seed: int = option("default 0", 0, parse=values.seed)
    noise_mm: float = option("of a measured point, each axis (default 0.05)", 0.05)


@dataclass(frozen=True, kw_only=True)
class ConvertOptions(RobotFileOptions):
    """A robot from one form into another: URDF, robot.toml, YAML, tables."""

    source: Path = argument("a robot: .urdf .xacro .toml .yaml .conf .csv .xml", metavar="IN")
    out: Path = argument("the form follows the suffix: .toml .urdf .yaml")
    template: Path | None = option("your own URDF of this arm: only origins are changed", metavar="ROBOT.urdf")
    force: bool = flag("replace a file that is there")


@dataclass(frozen=True, kw_only=True)
class WhereOptions(RobotFileOptions):
    """Where an arm's frames are at joint values, in every form, and how two told poses differ."""

    robot: str = argument("a robot's file, dataset or name; or a table of poses", metavar="ROBOT|FILE")
    poses: Path | None = argument(
        "a table of joint values, or of poses to compare with: x, y, z and an attitude", metavar="FILE", required=False
    )
    joints: str | None = option("in degrees and mm, such as --joints=0,-90,90,0,90,0, or a table", metavar="Q|FILE")
    frame: str | None = option("the frame to tell in full (default: the tip)", metavar="NAME")


@dataclass(frozen=True, kw_only=True)
class ImportOptions(RobotFileOptions):
    """A dataset folder from a robot, joint values and measured points, or from a zip of them."""

    path: Path = argument("folder to make")
    source: Path | None = option(
        "what holds robot, tables and scans; each file is recognised", metavar="ZIP|FOLDER", spelled=["--from"]
    )
    robot: str | None = option(f"a robot's file, or {' or '.join(BUILTIN_ROBOTS)}", metavar="FILE|NAME")
    joints: Path | None = option("joint values, a row a pose, or a recording (.bag, .mcap, log.csv ...)")
    points: Path | None = option("measured points (default: in --joints); FILE#TOPIC of a bag")
    flange_poses: Path | None = option(
        "poses of the flange as the controller tells them, in place of --robot and --joints: with --points, or alone "
        "at one tip that was visited, the tool point is found, with what a camera saw the camera's place"
    )
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
        "the measured point from the flange (a URDF's last link, robot.toml's [flange], else the last joint), in mm, "
        "such as --tool=0,0,88.5 (default: as the robot's file has it)",
        metavar="X,Y,Z",
        parse=values.tool_mm,
    )
    tool_mass: float | None = option(
        "mass of the tool, in kg, its centre half way to the measured point (default: none told)",
        metavar="KG",
        parse=values.length_or_mass,
    )
    edge: float | None = option(
        "length of the jig's edges from its corner, in mm (default: as the planes in --scans have it)",
        metavar="MM",
        parse=values.length_or_mass,
    )
    skip_bad_rows: bool = flag("leave out rows that cannot be read, at most half of a table, and say which")
    dry_run: bool = flag("say what would be made, and write nothing")
    diagnose: bool = flag("go on to the first diagnosis at once")
