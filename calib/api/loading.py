"""Datasets and options of a fit from what a caller gives: a path for the dataset, keywords for the options."""

from __future__ import annotations

from pathlib import Path

from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import as_dataset
from calib.measurement.measured_dataset import measured
from calib.options import FitFields, FitOptions, fit_options


def options_with(
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


def load_with_options(
    dataset: Dataset | str | Path, options: FitOptions | None, keywords: FitFields
) -> tuple[Dataset, FitOptions]:
    """The same with measured points, as of `measured`."""
    dataset, asked = options_with(dataset, options, keywords)
    return measured(dataset, orientation=asked.residual == "pose"), asked
