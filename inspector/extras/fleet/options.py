"""Options of `fleet` and `pool`. Nothing slow is imported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.options import NEW_ARM_POSES
from inspector.cli.options import values
from inspector.cli.options.declaration import argument, option, several
from inspector.cli.options.shared import Output, WithResidual


@dataclass(frozen=True, kw_only=True)
class PoolOptions(WithResidual, Output):
    """What arms of a type share, from which a new one begins with few poses."""

    path: Path = argument("dataset folder of the first arm")
    others: Sequence[Path] = argument("datasets of further arms of the same type", metavar="OTHER", repeated=True)
    out: Path | None = option("write what they share, for calibrate --type", metavar="FILE.json")
    poses: int = option(
        f"poses of an arm that is left out, to begin from the others (default {NEW_ARM_POSES})",
        NEW_ARM_POSES,
        metavar="N",
        parse=values.pose_count,
    )
    effect: Sequence[str] = several("an effect that the arms have, all joints", metavar="NAME")


@dataclass(frozen=True, kw_only=True)
class FleetOptions(Output):
    """Hundreds of datasets: a table and a page of how good each arm is and which causes arms share."""

    path: Path = argument("folder with datasets, however deep")
    out: Path = option(
        "write the table, .csv or .parquet; page and results lie beside it (default fleet.csv)",
        Path("fleet.csv"),
        metavar="TABLE",
    )
    workers: int | None = option("default: one for each core", metavar="N", parse=values.process_count)
    scheduler: str | None = option("a Dask cluster that runs already, such as tcp://host:8786", metavar="ADDRESS")
    timeout: float = option(
        "seconds that one dataset may take (default 1800)", 1800.0, metavar="S", parse=values.seconds
    )


@dataclass(frozen=True, kw_only=True)
class TypeOptions:
    """The type of arm from which a fit begins."""

    type: Path | None = option("begin from what other arms of the type share (of pool --out)", metavar="FILE.json")
