"""Options of the page, and of the commands on datasets that fit nothing. Nothing slow is imported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.options import BUILTIN_ROBOTS
from inspector.cli.options import values
from inspector.cli.options.declaration import argument, flag, option, several
from inspector.cli.options.shared import A_DATASET, DATASETS, Output, WithFinder, WithLeaveOut, WithResidual


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
