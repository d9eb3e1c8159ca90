"""How many points each scan of a dataset holds, and how many of its rows have no value."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from calib.dataset import Dataset
from calib.errors import ScanError
from calib.parallel import as_they_come
from calib.scan import load_scan


@dataclass(frozen=True)
class PointCount:
    """One scan's points."""

    points: int  # with a value
    dropped: int  # rows without one, left out on loading

    @property
    def share_dropped(self) -> float:
        return self.dropped / (self.points + self.dropped)


def count_points(dataset: Dataset, executor: Executor | None = None) -> dict[str, PointCount]:
    """The points of every scan that can be read, by pose id, in the dataset's order."""
    paths = [dataset.scan_path(i) for i in range(len(dataset.poses))]
    ids = [pose_id for pose_id, path in zip(dataset.poses.ids, paths, strict=True) if path is not None]
    scans = [path for path in paths if path is not None]
    counts = dict(as_they_come(_count, scans, executor, 64))
    return {pose_id: found for i, pose_id in enumerate(ids) if (found := counts[i]) is not None}


def _count(path: Path) -> PointCount | None:
    try:
        scan = load_scan(path)
    except ScanError:  # the search for its corner tells why
        return None
    return PointCount(len(scan.points_mm), scan.dropped)
