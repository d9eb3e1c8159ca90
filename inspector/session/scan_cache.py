"""Cache of the scans of the dataset on show: the selected scan in full, only the position of all other scans."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.scans.scan import Scan, load_scan
from calib.served_process import within_limits


class ScanCache:
    """Loader of scans that keeps the selected one in memory."""

    def __init__(self) -> None:
        self._dataset: Dataset | None = None
        self._kept: tuple[int, Scan] | None = None
        # (3,) middle of each scan that was worked on, by pose, mm; nan where it has no points
        self.medians: dict[int, Array] = {}

    def open(self, dataset: Dataset) -> None:
        """Forget the scans of the previous dataset."""
        self._dataset, self._kept, self.medians = dataset, None, {}

    def load(self, pose: int, *, keep: bool) -> Scan | None:
        """Scan of a pose, read in a bounded process; None where there is none. Raises CalibError."""
        if self._kept is not None and self._kept[0] == pose:
            return self._kept[1]
        path = None if self._dataset is None else self._dataset.scan_path(pose)
        if path is None:
            return None
        scan = within_limits(path.name, load_scan, path)
        if keep:
            self._kept = (pose, scan)
        return scan

    def worked_on(self, pose: int, scan: Scan | None, *, keep: bool) -> None:
        """Store a scan's position, or that the scan cannot be read."""
        if keep and scan is not None:
            self._kept = (pose, scan)
        empty = scan is None or not len(scan.points_mm)
        self.medians[pose] = np.full(3, np.nan) if empty else np.median(scan.points_mm, axis=0)  # type: ignore[union-attr]

    def next(self, first: int, tried: set[int]) -> int | None:
        """Next scan to search, from the scan of pose `first` on."""
        if self._dataset is None:
            return None
        for k in range(len(self._dataset.poses)):
            i = (first + k) % len(self._dataset.poses)
            if i not in tried and i not in self.medians and self._dataset.scan_path(i) is not None:
                return i
        return None
