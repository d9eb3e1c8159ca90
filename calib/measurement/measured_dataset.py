"""Dataset with measured points, as every fit requires."""

from __future__ import annotations

from dataclasses import replace

from calib.dataset.dataset import Dataset


def measured(dataset: Dataset, *, orientation: bool = False) -> Dataset:
    """A dataset with measured points: the targets are searched for where it holds scans only.

    Scans without a corner are left out, each with a warning in the dataset. `orientation`: see `with_corners`.

    Raises DatasetError; ScanError or CornerError where no scan shows a target.
    """
    if dataset.points is not None or dataset.scan_folder is None:
        return dataset
    # 60 modules, of the way from a scan to its corner, which a fit of measured points does without
    from calib.measurement.measured_points import failed_searches, require_corners, with_corners
    from calib.targets.assignment import assign_targets
    from calib.targets.search import find_targets

    searches = find_targets(dataset, intermediate=False)
    require_corners(dataset, searches)
    failed = failed_searches(searches).items()
    warnings = [f"{pose_id} has no corner and is left out: {reason}" for pose_id, reason in failed]
    warnings += assign_targets(dataset, searches).lines()
    return with_corners(replace(dataset, warnings=(*dataset.warnings, *warnings)), searches, orientation=orientation)
