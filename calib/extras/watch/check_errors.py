"""Errors of check poses, and the limit below which they stay where nothing changed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, IndexArray
from calib.brief import Brief
from calib.dataset.dataset import Poses
from calib.extras.watch.iso9283 import Visits
from calib.extras.watch.prediction_spread import ErrorCovariance
from calib.statistics import chi2_ppf, rms_length

LIMIT_SHARE = 0.9973  # share of unchanged cells that stay below the limit: three sigmas of a control chart


@dataclass(frozen=True)
class CheckErrors(Brief):
    """Errors of check poses, measured minus predicted points (M), with their expected covariance.

    The scanner is where it was or, if it moved, fitted to these points.
    """

    poses: Poses  # (N,)
    pose: IndexArray  # (M,) index into poses
    target: tuple[str, ...]  # (M,)
    measured_mm: Array  # (M, 3) scanner frame
    off_mm: Array  # (M, 3) scanner frame
    covariance: ErrorCovariance  # covariance of off_mm where nothing changed
    scanner_R_base: Array  # (3, 3)

    @property
    def rmse_mm(self) -> float:
        """RMS of the 3D errors, mm."""
        return rms_length(self.off_mm)

    @property
    def likely_mm(self) -> float:
        """Expected RMS of the 3D errors where nothing changed, mm: by noise and the earlier fit's uncertainty."""
        return float(np.sqrt(self.covariance.trace_mm2 / len(self.off_mm)))

    @property
    def limit_mm(self) -> float:
        """Limit below which the RMS of the 3D errors stays in 99.73 % of unchanged cells, mm.

        Its square is a weighted sum of chi-square variables, approximated by one of the same mean and variance
        (Satterthwaite 1946).
        """
        mean, squares = self.covariance.trace_mm2, self.covariance.sum_of_squares_mm4
        dof = mean**2 / squares
        return float(np.sqrt(squares / mean * chi2_ppf(LIMIT_SHARE, dof) / len(self.off_mm)))

    @property
    def pose_ids(self) -> tuple[str, ...]:
        """Pose id (M,) of each point."""
        return tuple(self.poses.ids[int(i)] for i in self.pose)

    def visits(self, session: str) -> Visits:
        """Points of one session with errors in the base frame, as input for the figures of ISO 9283."""
        return Visits(session, self.pose_ids, self.poses.q[self.pose], self.target, self.off_mm @ self.scanner_R_base)
