"""The command `watch`: what changed in a cell since a calibration."""

from __future__ import annotations

from collections.abc import Sequence

from calib.dataset.dataset import Dataset
from calib.errors import CalibError
from calib.extras.watch.present.changes import watch_document, watch_summary
from calib.extras.watch.series import watched_cell
from calib.present import to_dict
from calib.rendering import numbers
from inspector.cli.calibrate_command import fitted
from inspector.cli.dataset_commands import load, measured, show
from inspector.extras.watch.options import WatchOptions


def run_watch(options: WatchOptions) -> int:
    """Report changes since a calibration; exit code 1 where there are any, as an alarm for scheduled runs."""
    first, *later = _without([load(path) for path in (options.path, *options.new)], options.leave_out)
    base = fitted(options, measured(first))[-1].calibration
    cell = watched_cell(base, list(map(measured, later)), tolerance_mm=options.tolerance_mm)
    show(options, to_dict(watch_document(cell)), "\n".join(watch_summary(cell)))
    return 0 if cell.is_unchanged else 1


def _without(datasets: Sequence[Dataset], pose_ids: Sequence[str]) -> list[Dataset]:
    """The datasets, each without those of the poses that it has. Raises CalibError for a pose that none has."""
    for pose_id in pose_ids:
        if not any(pose_id in dataset.poses.ids for dataset in datasets):
            names = numbers.listing([dataset.name for dataset in datasets])
            raise CalibError(f"--leave-out {pose_id}: found no pose of this name in {names}; poses.csv names them")
    return [dataset.leave_out([one for one in pose_ids if one in dataset.poses.ids]) for dataset in datasets]
