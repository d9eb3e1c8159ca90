"""From corners to measured points: the step between looking at scans and fitting a robot."""

from __future__ import annotations

from collections.abc import Mapping

from calib.corners import CornerSearch
from calib.dataset import Dataset, points_from_corners
from calib.errors import CornerError, ScanError
from calib.intersection import Corner


def with_corners(dataset: Dataset, searches: Mapping[str, CornerSearch]) -> Dataset:
    """The dataset with the corners that were found, by pose id, as its points; poses without a corner have none."""
    found = found_corners(searches)
    return dataset.with_points(
        points_from_corners(
            dataset,
            {pose_id: corner.xyz_mm for pose_id, corner in found.items()},
            {pose_id: corner.covariance_mm2 for pose_id, corner in found.items()},
        )
    )


def found_corners(searches: Mapping[str, CornerSearch]) -> dict[str, Corner]:
    """The corners that were found, by pose id."""
    return {pose_id: search.corner for pose_id, search in searches.items() if search.corner is not None}


def failed_searches(searches: Mapping[str, CornerSearch]) -> dict[str, str]:
    """Why which pose has no corner."""
    return {pose_id: search.failure for pose_id, search in searches.items() if search.corner is None}


def require_corners(dataset: Dataset, searches: Mapping[str, CornerSearch]) -> None:
    """Raise ScanError where a file could not be read, CornerError where not one scan has a corner."""
    for search in searches.values():
        if search.unreadable:
            raise ScanError(search.failure)
    failed = failed_searches(searches)
    if len(failed) == len(searches):
        first, reason = next(iter(failed.items()))
        raise CornerError(
            f"dataset {dataset.name}: no corner in any of {len(failed)} scans; the first, {first}: {reason}"
        )
