"""Following of a dataset folder: each look searches the scans that came to rest, and brings the campaign up to date."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.corners.batch import of_one_jig
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import ArrivingDataset, load_arriving_dataset
from calib.errors import DatasetError
from calib.extras.follow.arrivals import FolderState
from calib.extras.follow.campaign import Campaign, with_arrivals
from calib.extras.follow.judgement import PoseJudgement
from calib.options import FitOptions
from calib.scans.scan import scan_file
from calib.targets.batch import find_targets

PATIENCE_S = 3.0
"""Time for which a scan that cannot be read, or a table with a fault or without rows that it had, may be one that is
still being written."""

Version = tuple[int, int]


@dataclass(frozen=True)
class News:
    """What a look at the folder brought: judgements that are new or changed, and what is wrong with the tables."""

    judged: tuple[PoseJudgement, ...] = ()
    fault: str = ""  # of a table, told once; the campaign stays as it was
    unknown: tuple[str, ...] = ()  # names that poses.csv does not have (yet), told once each


class CampaignFollower:
    """Follower of one folder; `campaign` is None until dataset.toml, the robot and a pose are there."""

    def __init__(self, folder: Path, options: FitOptions = FitOptions(), executor: Executor | None = None) -> None:
        self.folder = folder
        self.options = options
        self.executor = executor
        self.campaign: Campaign | None = None
        self.searches: dict[str, CornerSearch] = {}
        self._state = FolderState()
        self._read: ArrivingDataset | None = None
        self._taken: ArrivingDataset | None = None  # what the campaign was brought up to date with
        self._tables: Mapping[Path, tuple[Version, bool]] = {}  # as they were read, and whether they were settled
        self._versions: dict[str, Version] = {}  # of the scan that was searched, by pose
        self._fault: tuple[str, float] | None = None  # and since when
        self._told = ""
        self._waiting: set[str] = set()  # poses whose scan cannot be read yet
        self._unknown: tuple[str, ...] = ()
        self._gone_since: float | None = None  # since when rows that were read are missing from the tables

    def look(self, now_s: float) -> News:
        """Take what has arrived since the last look, at a monotonic time in seconds.

        Raises DatasetError where the folder cannot be read; of a table's fault that lasts, `News` tells.
        """
        scans = None if self._read is None else self._read.dataset.scan_folder
        folders = (self.folder,) if scans is None else (self.folder, self.folder / scans)
        self._state = self._state.looked_again(folders, now_s)
        fault = self._read_tables(now_s)
        if fault or self._read is None:
            return News(fault=fault)
        if self._read.dataset.scan_folder is not None and scans is None:
            return self.look(now_s)  # now that the scan folder's name is known
        dataset = self._read.dataset
        unknown, before_unknown = self._names_unknown(self._read), self._unknown
        self._unknown = unknown
        strange = tuple(name for name in unknown if name not in before_unknown)
        if self.campaign is not None and self.campaign.unknown != unknown:
            self.campaign = replace(self.campaign, unknown=unknown)
        searched = dataset.points is None and self._search_new(dataset)
        before = self.campaign
        if before is not None and not searched and _content(self._read) == _content(self._taken):
            return News(unknown=strange)
        self._taken = self._read
        searches = of_one_jig(self.searches, dataset.jig).searches
        self.campaign, judged = with_arrivals(
            before or Campaign(dataset, unknown=unknown), self._read, searches, self.options
        )
        return News(judged, unknown=strange)

    @property
    def is_at_rest(self) -> bool:
        """Whether all that the folder holds was taken, or is held up by a fault that was told."""
        held_up = self._waiting or self._gone_since is not None
        return self._state.is_at_rest and (self._fault is None or bool(self.fault)) and not held_up

    @property
    def fault(self) -> str:
        """Fault of a table that has lasted; "" where there is none."""
        return self._told if self._fault is not None else ""

    def _read_tables(self, now_s: float) -> str:
        """Read the tables where they changed; a fault's words once it has lasted, else ""."""
        growing = self._state.growing()
        tables = {
            path: (state.version, path.name in growing)
            for path, state in self._state.files.items()
            if path.parent == self.folder and path.suffix.lower() in (".toml", ".csv")
        }
        if tables == self._tables and self._fault is None:
            return ""
        try:
            read = load_arriving_dataset(self.folder, growing)
        except DatasetError as error:
            words = str(error)
            since = self._fault[1] if self._fault is not None and self._fault[0] == words else now_s
            self._fault = (words, since)
            if now_s - since < PATIENCE_S or words == self._told:
                return ""
            self._told = words
            return words
        self._fault, self._told = None, ""
        if _lacks(read, self._read):
            # A writer that writes the whole table anew empties it first: what is gone may be back at the next look.
            self._gone_since = now_s if self._gone_since is None else self._gone_since
            if now_s - self._gone_since < PATIENCE_S:
                return ""
        self._read, self._tables, self._gone_since = read, tables, None
        return ""

    def _names_unknown(self, arriving: ArrivingDataset) -> tuple[str, ...]:
        """Names in points.csv, and settled files of scans, that poses.csv does not have."""
        dataset, found = arriving.dataset, list(arriving.unknown)
        if dataset.points is not None or dataset.scan_folder is None:
            return tuple(found)
        paths = map(dataset.scan_path, range(len(dataset.poses)))
        named = {scan_file(path) for path in paths if path is not None}
        kinds = {path.suffix.lower() for path in named}
        for path in sorted(self._state.files):
            if path.parent != self.folder / dataset.scan_folder or path in named or path.suffix.lower() not in kinds:
                continue
            if not path.name.startswith(".") and self._state.settled(path) is not None:
                found.append(f"{dataset.scan_folder}/{path.name}")
        return tuple(found)

    def _search_new(self, dataset: Dataset) -> bool:
        """Search the scans that have come to rest since the last look; whether there were any."""
        new: dict[str, Version] = {}
        for i, pose_id in enumerate(dataset.poses.ids):
            path = dataset.scan_path(i)
            version = None if path is None else self._state.settled(path)
            if version is not None and self._versions.get(pose_id) != version:
                new[pose_id] = version
        if not new:
            return False
        others = tuple(pose_id for pose_id in dataset.poses.ids if pose_id not in new)
        found = find_targets(
            replace(dataset, left_out=others), executor=self.executor if len(new) > 1 else None, intermediate=False
        )
        for pose_id, search in found.items():
            path = dataset.scan_path(dataset.poses.index(pose_id))
            assert path is not None
            if search.unreadable and self._state.rested_s(path) < PATIENCE_S:
                self._waiting.add(pose_id)  # perhaps a writer that pauses: looked at again
                continue
            self._waiting.discard(pose_id)
            self.searches[pose_id] = search
            self._versions[pose_id] = new[pose_id]
        return any(pose_id in self._versions for pose_id in new)


def _lacks(read: ArrivingDataset, before: ArrivingDataset | None) -> bool:
    """Whether poses, or measurements of poses, are missing that were there at the reading before."""
    if before is None:
        return False
    if not set(before.dataset.poses.ids) <= set(read.dataset.poses.ids):
        return True
    return not _measured(before) <= _measured(read)


def _measured(arriving: ArrivingDataset) -> set[str]:
    """Names of the rows of points.csv, whether they have a point, and whether a pose."""
    points, ids = arriving.dataset.points, arriving.dataset.poses.ids
    with_point = set() if points is None else {ids[i] for i in np.unique(points.pose)}
    return with_point | set(arriving.unseen) | set(arriving.unknown)


def _content(arriving: ArrivingDataset | None) -> tuple[object, ...]:
    """What makes a reading of a folder another one: the tables, as far as their lines were read."""
    if arriving is None:
        return ()
    points = arriving.dataset.points
    rows = None if points is None else len(points)
    return arriving.dataset.read_files, arriving.dataset.poses.ids, rows, arriving.unseen
