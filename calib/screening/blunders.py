"""Blunders: single poses that stand out of a fit's residual, and the fit without them."""

from __future__ import annotations

import numpy as np

from calib.calibration.calibrate import fit_again
from calib.calibration.result import Calibration
from calib.dataset.repeats import without_poses
from calib.errors import FitError
from calib.screening.projected_residual import project_residual
from calib.screening.residual_tests import ResidualTests, run_residual_tests

MAX_OUTLIER_SHARE = 0.1  # share of poses that may stand out and still be called outliers
_HALF = 0.5  # of the residual, below which what is left shows that the poses are blunders, whatever else is missing


def blunders_of(calibration: Calibration, tests: ResidualTests) -> tuple[str, ...]:
    """Poses of a fit that stand out by the tests of its residual; () where they are too many to be single mistakes."""
    points = calibration.fitted_dataset.points
    assert points is not None
    outliers = tuple(pose for pose in tests.outlier_poses if pose not in calibration.outliers)
    most = max(2, MAX_OUTLIER_SHARE * len(np.unique(points.pose)))
    return outliers if len(outliers) <= most else ()


def without_blunders(calibration: Calibration) -> Calibration:
    """The same fit without the poses that stand out, as `diagnose` leaves them out; itself where there are none.

    Where what is then left is no noise, an effect may be missing that makes good poses stand out; they are left out if
    they alone made more than half of the residual.
    """
    try:
        found = blunders_of(calibration, run_residual_tests(calibration.dataset, project_residual(calibration)))
        if not found:
            return calibration
        without = fit_again(calibration, without_poses(calibration.dataset, found), calibration.options)
        much = without.sigma_mm < _HALF * calibration.sigma_mm
        clean = much or run_residual_tests(without.dataset, project_residual(without)).is_noise
        return without if clean else calibration
    except FitError:  # too few poses to tell
        return calibration
