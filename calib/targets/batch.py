"""The targets of many scans: each loaded from its file and searched, one after the other or on many processes."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path

from calib.blas_threads import one_blas_thread
from calib.corners.batch import CornerBatch, brief, find_corners, told_noise
from calib.corners.noise.told import NOTHING_TOLD, ToldNoise
from calib.corners.search import CornerSearch, failed_search
from calib.dataset.dataset import Dataset
from calib.errors import ScanError
from calib.progress import OnProgress
from calib.scans.scan import PointCount, load_scan
from calib.target_shapes import Target
from calib.targets.protocol.user_file import UserFinder, load_finder
from calib.targets.search import UserFunction, find_targets_in


def find_targets(
    dataset: Dataset,
    *,
    finder: UserFunction | UserFinder | None = None,
    progress: bool = False,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
    in_flight: int = 64,
    intermediate: bool = True,
) -> CornerBatch:
    """All targets of a dataset in every pose's scan, by pose id; of a dataset with one jig this is `find_corners`.

    `finder(scan, wanted)` is a function of the caller's, for targets of shape "own", or for all where there is none of
    that shape (`calib.targets.protocol`); with processes it has to be one that can be pickled. Where it is None, the
    dataset's `finder_file` is used, if any. The rest is as of `find_corners`.
    """
    search = partial(
        search_targets_file,
        targets=dataset.all_targets,
        scan_sigma_mm=dataset.scanner.scan_sigma_mm,
        finder=finder or finder_of(dataset),
        told=told_noise(dataset.scanner),
        intermediate=intermediate,
    )
    return find_corners(
        dataset,
        progress=progress,
        on_progress=on_progress,
        executor=executor,
        in_flight=in_flight,
        search=search,
    )


def finder_of(dataset: Dataset) -> UserFinder | None:
    """The finder of the user's own file that was given for a dataset. Raises CalibError where the file is no finder."""
    return None if dataset.finder_file is None else load_finder(dataset.finder_file)


@one_blas_thread()
def search_targets_file(
    path: Path,
    targets: Sequence[Target],
    scan_sigma_mm: float | None = None,
    finder: UserFunction | UserFinder | None = None,
    *,
    told: ToldNoise = NOTHING_TOLD,
    intermediate: bool = True,
) -> CornerSearch:
    """`find_targets_in` a scan file; one that cannot be read becomes a failed search with `unreadable` set."""
    try:
        scan = load_scan(path)
    except ScanError as error:
        return failed_search(path.stem, str(error), unreadable=True)
    search = find_targets_in(scan, targets, scan_sigma_mm=scan_sigma_mm, finder=finder, told=told)
    search = replace(search, count=PointCount(len(scan.points_mm), scan.dropped))
    return search if intermediate else brief(search)
