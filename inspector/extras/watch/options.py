"""Options of `watch`. Nothing slow is imported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from inspector.cli.options import values
from inspector.cli.options.declaration import argument, option
from inspector.cli.options.shared import Output, WithAdding, WithLeaveOut


@dataclass(frozen=True, kw_only=True)
class WatchOptions(WithAdding, WithLeaveOut, Output):
    """What changed in a cell since a calibration, by a few check poses."""

    path: Path = argument("dataset folder of the earlier calibration")
    new: Sequence[Path] = argument(
        "folder of check poses, three poses or more; three folders or more show drifts, too",
        repeated=True,
    )
    tolerance_mm: float | None = option(
        "tell when the 3D error at the check poses reaches this, from three checks on",
        metavar="MM",
        parse=values.rmse_mm,
    )
