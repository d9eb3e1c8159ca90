"""Options of `follow`. Nothing slow is imported."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from inspector.cli.options import values
from inspector.cli.options.declaration import argument, flag, option
from inspector.cli.options.shared import Output


@dataclass(frozen=True, kw_only=True)
class FollowOptions(Output):
    """A campaign while it is measured: each pose judged as it arrives, the error predicted, the next pose named."""

    path: Path = argument("dataset folder that is being filled: points.csv grows, or scans arrive")
    tolerance_mm: float | None = option(
        "enough is where the predicted error is within this", metavar="X", parse=values.rmse_mm
    )
    once: bool = flag("end when all that is there was judged, do not wait for more")
    json: bool = flag("a JSON object for each pose, a line each, on stdout")
