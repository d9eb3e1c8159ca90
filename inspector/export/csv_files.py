"""Contents of CSV files of results; callers write the files."""

from __future__ import annotations

import re

from calib.calibration.residual_table import residual_table
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.files.points_csv import points_frame
from calib.identifiability.redundancy import Redundancy
from calib.text_files.csv_text import frame_csv

NAME_LIMIT = 60  # characters of a dataset's name in a file's


def corners_csv(dataset: Dataset) -> str:
    """The measured points in the form of points.csv."""
    assert dataset.points is not None
    return frame_csv(points_frame(dataset.poses, dataset.points))


def residuals_csv(calibration: Calibration) -> str:
    """Residuals of the fit as CSV, one row for each pose (`calib.calibration.residual_table`)."""
    return frame_csv(residual_table(calibration))


def redundancy_csv(redundancy: Redundancy) -> str:
    """Pearson's r of all parameter pairs as CSV; empty where a parameter has no influence."""
    return frame_csv(redundancy.to_frame().rename_axis("parameter").reset_index())


def file_name(dataset: str, what: str) -> str:
    """File name that every system accepts, made of a dataset's name: "cell_residuals.csv"."""
    safe = re.sub(r"[^A-Za-z0-9-]+", "_", dataset).strip("_")[:NAME_LIMIT]
    return f"{safe or 'dataset'}_{what}"
