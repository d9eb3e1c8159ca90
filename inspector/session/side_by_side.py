"""Results compared with the calibration on show: another dataset's, or later measurements."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calib.array_types import Array
from calib.calibration.calibrate import fit_measured
from calib.calibration.pose_errors import PoseErrors, pose_errors_of
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.errors import CalibError, printable
from calib.measurement.measured_points import with_corners
from calib.options import FitOptions
from calib.screening.blunders import without_blunders
from calib.served_process import BoundedExecutor, within_limits
from calib.targets.search import find_targets
from calib.validation.comparison import Comparison, comparison_of
from inspector.session.session import Session


@dataclass(frozen=True)
class Beside:
    """Errors of N poses of one calibration, with the inputs against which they are plotted."""

    name: str
    calibration: Calibration
    pose_ids: tuple[str, ...]
    error_mm: Array  # (N,) 3D
    inputs: dict[str, Array]  # (N,) each

    @classmethod
    def of(cls, name: str, calibration: Calibration, errors: PoseErrors | None = None) -> Beside:
        """Errors of a calibration at its measured poses."""
        errors = errors or pose_errors_of(calibration)
        return cls(name, calibration, errors.pose_ids, errors.error_length_mm, errors.inputs)


def measured_dataset(folder: Path, *, orientation: bool = False) -> Dataset:
    """Dataset of a folder that is not open, its scans searched where it has no points. Raises CalibError."""
    dataset = within_limits(printable(folder.name), load_dataset, folder)
    if dataset.points is None:
        with BoundedExecutor(1) as executor:
            found = find_targets(dataset, executor=executor, intermediate=False)
        dataset = with_corners(dataset, found, orientation=orientation)
    return dataset


def beside_of_folder(name: str, folder: Path, residual: str) -> Beside:
    """Errors of a dataset that is not open, with its link errors fitted.

    Poses that stand out are left out. Raises CalibError where it cannot be read or fitted.
    """
    dataset = measured_dataset(folder, orientation=residual == "pose")
    return Beside.of(name, without_blunders(fit_measured(dataset, FitOptions(residual=residual))))


def beside_of_session(name: str, session: Session) -> Beside:
    """Errors of the model that a session shows. Raises CalibError where it has none yet."""
    if session.calibration is None:
        raise CalibError(f"dataset {name}: it is not calibrated yet")
    return Beside.of(name, session.calibration, session.pose_errors)


def compared(shown: Beside, beside: Beside) -> Comparison:
    """Comparison of the calibration on show with another. Raises FitError as `compare`."""
    one, other = map(without_blunders, (beside.calibration, shown.calibration))
    return comparison_of(one, other, (beside.name, shown.name))
