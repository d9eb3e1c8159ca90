"""Conversion of corners found in scans to measured points, on which a robot is fitted."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calib.corners.intersection import Corner
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset, Orientations, Points, points_from_corners
from calib.errors import CornerError, ScanError
from calib.measurement.face_labels import FaceLabels, label_corners
from calib.targets.assignment import Assignment, assign_targets
from calib.targets.search import ScanSearch

_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w])")


def with_corners(
    dataset: Dataset, searches: Mapping[str, CornerSearch], *, orientation: bool | FaceLabels = False
) -> Dataset:
    """The dataset with the corners that were found, by pose id, as its points; poses without a corner have none.

    From searches for other targets or for several, each identified target becomes a point.

    With `orientation` the points are full poses, except where the jig's faces cannot be labelled. Labelling takes a
    while: a caller that has the labels already (`label_faces`) hands them over.
    """
    if any(isinstance(search, ScanSearch) for search in searches.values()):
        return dataset.with_points(points_of_targets(dataset, assign_targets(dataset, searches)))
    corners = found_corners(searches)
    points = points_from_corners(
        dataset,
        {pose_id: corner.xyz_mm for pose_id, corner in corners.items()},
        {pose_id: corner.covariance_mm2 for pose_id, corner in corners.items()},
    )
    if orientation:
        labels = label_corners(dataset, corners) if orientation is True else orientation
        ids = [dataset.poses.ids[i] for i in points.pose]
        points = replace(points, orientations=_orientations(labels, ids))
    return dataset.with_points(points)


def points_of_targets(dataset: Dataset, assigned: Assignment) -> Points:
    """Places of all targets as measured points, pose by pose."""
    rows = [
        (i, name, place)
        for i, pose_id in enumerate(dataset.poses.ids)
        for name, place in assigned.points.get(pose_id, {}).items()
    ]
    return Points(
        pose=np.array([i for i, _, _ in rows], dtype=np.int64),
        xyz_mm=np.array([place.xyz_mm for _, _, place in rows]).reshape(-1, 3),
        target=np.array([name for _, name, _ in rows], dtype=np.str_),
        covariance_mm2=np.array([place.covariance_mm2 for _, _, place in rows]).reshape(-1, 3, 3),
    )


def label_faces(dataset: Dataset, searches: Mapping[str, CornerSearch]) -> FaceLabels:
    """Labels of the jig's faces in the corners that were found, and so the jig's orientations.

    Raises CornerError for face angles that no jig can have.
    """
    return label_corners(dataset, found_corners(searches))


def _orientations(labels: FaceLabels, ids: Sequence[str]) -> Orientations:
    """Orientations of the poses in order; NaN, with finite covariances, where the faces are not labelled."""
    known = [labels.orientations.get(pose_id) for pose_id in ids]
    unknown = np.full((3, 3), np.nan)
    return Orientations(
        np.array([unknown if o is None else o.scanner_R_jig for o in known]).reshape(-1, 3, 3),
        np.array([np.eye(3) if o is None else o.covariance_rad2 for o in known]).reshape(-1, 3, 3),
        np.array([np.zeros((3, 3)) if o is None else o.cross_mm_rad for o in known]).reshape(-1, 3, 3),
        labels.labelling,
        labels.lack,
    )


def found_corners(searches: Mapping[str, CornerSearch]) -> dict[str, Corner]:
    """Corners that were found, by pose id."""
    return {pose_id: search.corner for pose_id, search in searches.items() if search.corner is not None}


def failed_searches(searches: Mapping[str, CornerSearch]) -> dict[str, str]:
    """Reasons by pose id why a scan has no corner, or none of its targets."""
    return {pose_id: search.failure for pose_id, search in searches.items() if search.failure}


def require_corners(dataset: Dataset, searches: Mapping[str, CornerSearch]) -> None:
    """Raise if no scan has a corner: ScanError where no file could be read, else CornerError.

    A scan that cannot be read among others that can is a failed search like any other (`failed_searches`).
    """
    failed = failed_searches(searches)
    if len(failed) < len(searches):
        return
    unreadable = [search.failure for search in searches.values() if search.unreadable]
    others = len(unreadable) - 1
    more_unreadable = f"; {others} further scan{'' if others == 1 else 's'} cannot be read" if others > 0 else ""
    if unreadable and len(unreadable) == len(searches):
        raise ScanError(f"{unreadable[0]}{more_unreadable}")
    reasons = {pose_id: reason for pose_id, reason in failed.items() if not searches[pose_id].unreadable}
    also = f"; of those that cannot be read the first is {unreadable[0]}" if unreadable else ""
    raise CornerError(
        f"dataset {dataset.name}: no corner in any of {len(failed)} scans: {counted_reasons(reasons)}{also}"
    )


def counted_reasons(reasons: Mapping[str, str]) -> str:
    """Reasons why poses have no corner, the most frequent first, each with its count and the range of its numbers.

    Such as: 41 of 54: two faces only, at 84 to 90 deg to each other ...; 13 of 54: ... The remedy is given for the most
    frequent one.
    """
    alike: dict[str, list[str]] = {}
    for pose_id, reason in reasons.items():
        alike.setdefault(_NUMBER.sub("#", reason.partition("; ")[0]), []).append(pose_id)
    clauses: list[str] = []
    for poses in sorted(alike.values(), key=len, reverse=True):
        parts = [reasons[pose_id].partition("; ") for pose_id in poses]
        numbers = zip(*(_NUMBER.findall(what) for what, _, _ in parts), strict=True)
        ranges = [_range(column) for column in numbers]
        pieces = _NUMBER.split(parts[0][0])
        text = pieces[0] + "".join(f"{number}{word}" for number, word in zip(ranges, pieces[1:], strict=True))
        remedy = f" ({parts[0][2]})" if parts[0][2] and not clauses else ""
        clauses.append(f"{len(poses)} of {len(reasons)}: {text}{remedy}")
    return "; ".join(clauses)


def _range(numbers: Sequence[str]) -> str:
    """Least and largest of some numbers as text; a single number where they are equal."""
    least, largest = min(numbers, key=float), max(numbers, key=float)
    return least if float(least) == float(largest) else f"{least} to {largest}"
