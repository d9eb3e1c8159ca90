"""Dataset with measured points, made from a dataset or its folder, as every fit requires."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import as_dataset
from calib.options import FitFields, FitOptions, fit_options


def asked_of(
    dataset: Dataset | str | Path, options: FitOptions | None, keywords: FitFields
) -> tuple[Dataset, FitOptions]:
    """The dataset, read where a path is given, and a fit's options; the dataset's usual residual unless one is named.

    Raises FitError on an option that is not possible, before anything is read; DatasetError.
    """
    asked = fit_options(options, keywords)
    dataset = as_dataset(dataset)
    if options is None and "residual" not in keywords:
        asked = asked.with_residual(dataset.usual_residual)
    return dataset, asked


def measured_as_asked(
    dataset: Dataset | str | Path, options: FitOptions | None, keywords: FitFields
) -> tuple[Dataset, FitOptions]:
    """The same with measured points, as of `measured`."""
    dataset, asked = asked_of(dataset, options, keywords)
    return measured(dataset, orientation=asked.residual == "pose"), asked


def measured(dataset: Dataset | str | Path, *, orientation: bool = False) -> Dataset:
    """A dataset with measured points: read where a path is given, the targets searched for where it holds scans only.

    Scans without a corner are left out, each with a warning in the dataset. `orientation`: see `with_corners`.

    Raises DatasetError; ScanError or CornerError where no scan shows a target.
    """
    dataset = as_dataset(dataset)
    if dataset.points is not None or dataset.scan_folder is None:
        return dataset
    # 60 modules, of the way from a scan to its corner, which a fit of measured points does without
    from calib.measurement.measured_points import failed_searches, require_corners, with_corners
    from calib.targets.assignment import assign_targets
    from calib.targets.batch import find_targets

    searches = find_targets(dataset, intermediate=False)
    require_corners(dataset, searches)
    failed = failed_searches(searches).items()
    warnings = [f"{pose_id} has no corner and is left out: {reason}" for pose_id, reason in failed]
    warnings += assign_targets(dataset, searches).lines()
    return with_corners(replace(dataset, warnings=(*dataset.warnings, *warnings)), searches, orientation=orientation)
