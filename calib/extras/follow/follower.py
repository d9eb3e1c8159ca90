"""Following of a dataset folder: each look searches the scans that came to rest, and brings the campaign up to date.

A file that is being written grows, or is renamed into place. It is at rest when its size and time were the same at two
looks, `SETTLED_S` apart at least; a file that changes later counts as a new arrival. Nothing depends on events of the
file system, which network drives do not send.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.corners.batch import of_one_jig
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import ArrivingDataset, load_arriving_dataset
from calib.errors import CalibError, DatasetError
from calib.extras.follow.campaign import Campaign, PoseJudgement, with_arrivals
from calib.scans.scan import scan_file
from calib.targets.search import find_targets

SETTLED_S = 0.4
"""Time for which a file must not change before it is read as whole."""
PATIENCE_S = 3.0
"""Time for which a scan that cannot be read, or a table with a fault or without rows that it had, may be one that is
still being written."""
_LACKS_ROWS = "rows that were there are missing"

Version = tuple[int, int]  # size and time of change of a file


@dataclass(frozen=True)
class News:
    """What a look at the folder brought: judgements that are new or changed, and what is wrong with the tables."""

    judged: tuple[PoseJudgement, ...] = ()
    fault: str = ""  # of a table, told once; the campaign stays as it was


class CampaignFollower:
    """Follower of one folder; `campaign` is None until dataset.toml, the robot and a pose are there."""

    def __init__(self, folder: Path, executor: Executor | None = None) -> None:
        self.folder = folder
        self.executor = executor
        self.campaign: Campaign | None = None
        self.searches: dict[str, CornerSearch] = {}
        self._now_s = 0.0
        self._files: dict[Path, tuple[Version, float]] = {}  # with the time since when they are so
        self._read: ArrivingDataset | None = None
        self._taken: ArrivingDataset | None = None  # that the campaign was brought up to date with
        self._tables: Mapping[Path, tuple[Version, bool]] = {}  # as they were read, and whether they were at rest
        self._versions: dict[str, Version] = {}  # of the scan that was searched, by pose
        self._doubt: tuple[str, float] | None = None  # what is wrong with the tables, and since when
        self._told = ""  # fault that has lasted
        self._waiting: set[str] = set()  # poses whose scan cannot be read yet

    def look(self, now_s: float) -> News:
        """Take what has arrived since the last look, at a monotonic time in seconds.

        Raises DatasetError where the folder cannot be read; of a table's fault that lasts, `News` tells.
        """
        self._now_s = now_s
        scans = None if self._read is None else self._read.dataset.scan_folder
        found = _files_in(self.folder) | ({} if scans is None else _files_in(self.folder / scans))
        before = self._files
        self._files = {
            path: before[path] if path in before and before[path][0] == version else (version, now_s)
            for path, version in found.items()
        }
        fault = self._read_tables()
        read = self._read
        if fault or read is None:
            return News(fault=fault)
        dataset = read.dataset
        if dataset.scan_folder is not None and scans is None:
            return self.look(now_s)  # now that the scan folder's name is known
        searched = dataset.points is None and self._search_new(dataset)
        if not searched and read is self._taken:
            return News()
        self._taken = read
        searches = of_one_jig(self.searches, dataset.jig).searches
        self.campaign, judged = with_arrivals(self.campaign or Campaign(dataset), read, searches)
        return News(judged)

    @property
    def is_at_rest(self) -> bool:
        """Whether all that the folder holds was taken, or is held up by a fault that was told."""
        is_open = self._doubt is not None and not self.fault
        return not self._growing and not is_open and not self._waiting

    @property
    def fault(self) -> str:
        """Fault of a table that has lasted; "" where there is none."""
        return self._told if self._doubt is not None else ""

    @property
    def _growing(self) -> tuple[str, ...]:
        """Names of the files that are not at rest."""
        return tuple(path.name for path, (_, since_s) in self._files.items() if self._now_s - since_s < SETTLED_S)

    def _rested(self, path: Path, least_s: float = SETTLED_S) -> Version | None:
        """Version of a file that has been at rest for some time; None while it is missing or being written."""
        version, since_s = self._files.get(scan_file(path), (None, 0.0))
        return None if self._now_s - since_s < least_s else version

    def _read_tables(self) -> str:
        """Read the tables where they changed; a fault's words once it has lasted, else ""."""
        growing = self._growing
        tables = {
            path: (version, path.name in growing)
            for path, (version, _) in self._files.items()
            if path.parent == self.folder and path.suffix.lower() in (".toml", ".csv")
        }
        if tables == self._tables and self._doubt is None:
            return ""
        read = self._read
        try:
            if self.executor is None:
                read = load_arriving_dataset(self.folder, growing)
            else:
                read = self.executor.submit(load_arriving_dataset, self.folder, growing).result()
            # A writer that writes the whole table anew empties it first: what is gone may be back at the next look.
            words = _LACKS_ROWS if self._read is not None and _lacks(read, self._read) else ""
        except CalibError as error:
            words = str(error)
        if words:
            same = self._doubt is not None and self._doubt[0] == words
            self._doubt = self._doubt if same else (words, self._now_s)
            assert self._doubt is not None
            if self._now_s - self._doubt[1] < PATIENCE_S:
                return ""
            if words != _LACKS_ROWS:
                told, self._told = self._told, words
                return "" if told == words else words
        self._doubt, self._told, self._read, self._tables = None, "", read, tables
        return ""

    def _search_new(self, dataset: Dataset) -> bool:
        """Search the scans that have come to rest since the last look; whether there were any."""
        paths = {pose_id: path for i, pose_id in enumerate(dataset.poses.ids) if (path := dataset.scan_path(i))}
        rested = {pose_id: self._rested(path) for pose_id, path in paths.items()}
        new = {i: version for i, version in rested.items() if version is not None and self._versions.get(i) != version}
        if not new:
            return False
        others = tuple(pose_id for pose_id in dataset.poses.ids if pose_id not in new)
        found = find_targets(replace(dataset, left_out=others), executor=self.executor, intermediate=False)
        for pose_id, search in found.items():
            if search.unreadable and self._rested(paths[pose_id], PATIENCE_S) is None:
                self._waiting.add(pose_id)  # perhaps a writer that pauses: looked at again
                continue
            self._waiting.discard(pose_id)
            self.searches[pose_id] = search
            self._versions[pose_id] = new[pose_id]
        return any(pose_id in self._versions for pose_id in new)


def _files_in(folder: Path) -> dict[Path, Version]:
    """Files in a folder; none where it does not exist. Raises DatasetError where it cannot be read."""
    found = {}
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                try:
                    if entry.is_file():
                        status = entry.stat()
                        found[folder / entry.name] = status.st_size, status.st_mtime_ns
                except OSError:  # gone since, as a writer's temporary file
                    continue
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise DatasetError(f"{folder}: {error.strerror or error}; check that the folder can be read") from None
    return found


def _lacks(read: ArrivingDataset, before: ArrivingDataset) -> bool:
    """Whether poses, or measurements of poses, are missing that were there at the reading before."""
    poses = {*before.dataset.poses.ids} <= {*read.dataset.poses.ids}
    return not poses or not _measured(before) <= _measured(read)


def _measured(arriving: ArrivingDataset) -> set[str]:
    """Names of the rows of points.csv, whether they have a point, and whether a pose."""
    points, ids = arriving.dataset.points, arriving.dataset.poses.ids
    with_point = set() if points is None else {ids[i] for i in np.unique(points.pose)}
    return with_point | set(arriving.unseen) | set(arriving.unknown)
