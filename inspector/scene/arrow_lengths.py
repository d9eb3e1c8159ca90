"""Enlargement of drawn residuals: a factor that suits the dataset, and a limit for arrows that would fill the view."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array, BoolArray
from calib.calibration.model_versions import Version
from inspector.session.view import FACTORS, View

USUAL_SHARE = 1 / 12  # of the field: most arrows are at most so long
SEEN_SHARE = 0.02  # of the field: where even the long ones are shorter, a larger factor is taken
LONGEST_SHARE = 0.15  # of the field: the longest that an arrow is drawn by itself
LONGEST_CHOSEN_SHARE = 0.6  # and by a factor that the user has chosen
MOST = 90.0  # in 100 arrows count for the factor: a wild one does not


def field_mm(points_mm: Array) -> float:
    """Diagonal of the bounding box of the measured points (K, 3), mm."""
    return float(np.linalg.norm(np.ptp(points_mm, axis=0))) if len(points_mm) else 0.0


def fitting_arrows(view: View) -> float:
    """Default enlargement of the residuals of the versions on show.

    It is that of the nominal robot where it shows the others, too, else that of the link errors: one factor for as many
    versions as can be, so that arrows shrink as the error falls.
    """
    latest = view.version
    if latest is None or latest.calibration.dataset.points is None:
        return view.arrows
    shown = [version for version in view.versions if version.name in view.compared] or [latest]
    field = field_mm(latest.calibration.dataset.points.xyz_mm)
    longest = max(map(_long_mm, shown))
    factor = _fitting(_long_mm(view.versions[0]), field)
    if factor * longest < SEEN_SHARE * field:
        factor = max(factor, _fitting(_long_mm(view.versions[1]), field))
    return min(factor, _fitting(longest, field))


def _long_mm(version: Version) -> float:
    lengths = np.linalg.norm(version.evaluation.error_mm, axis=1)
    return float(np.percentile(lengths, MOST)) if len(lengths) else 0.0


def _fitting(error_mm: float, field: float) -> float:
    return float(max((f for f in FACTORS if f * error_mm <= USUAL_SHARE * field), default=FACTORS[0]))


def drawn_as(error_mm: Array, view: View, field: float) -> tuple[Array, BoolArray]:
    """Arrows (K, 3) for errors (K, 3), enlarged by `view.arrows`, and a mask (K,) of those that were shortened."""
    arrows = view.arrows * error_mm
    most = (LONGEST_CHOSEN_SHARE if view.arrows_chosen else LONGEST_SHARE) * field
    lengths = np.linalg.norm(arrows, axis=1)
    cut = lengths > most * (1 + 1e-9)
    return np.where(cut[:, None], arrows * (most / np.maximum(lengths, 1e-12))[:, None], arrows), cut
