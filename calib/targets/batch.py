"""Searches of many scans for all targets: each loaded from its file, one after the other or on many processes."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path

from calib.blas_threads import one_blas_thread
from calib.corners.batch import CornerBatch, corners_of, declared_noise, searched_scan
from calib.corners.correlated_noise.declared import NOTHING_DECLARED, DeclaredNoise
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset
from calib.progress import OnProgress
from calib.target_shapes import DeclaredTarget
from calib.targets.protocol.user_file import UserFinder, load_finder
from calib.targets.search import UserFunction, find_targets_in


def find_targets(
    dataset: Dataset,
    *,
    finder: UserFunction | UserFinder | None = None,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
    in_flight: int = 64,
    intermediate: bool = True,
) -> CornerBatch:
    """All targets of a dataset in every pose's scan, by pose id; with a single jig the result of `find_corners`.

    `finder(scan, wanted)` is a function of the caller's, for targets of shape "own", or for all where there is none of
    that shape (`calib.targets.protocol`); with processes it has to be one that can be pickled. Where it is None, the
    dataset's `finder_file` is used, if any. The other arguments are those of `find_corners`.
    """
    search = partial(
        search_targets_file,
        targets=dataset.all_targets,
        scan_sigma_mm=dataset.scanner.scan_sigma_mm,
        finder=finder or finder_of(dataset),
        declared=declared_noise(dataset.scanner),
        intermediate=intermediate,
    )
    return corners_of(dataset, on_progress=on_progress, executor=executor, in_flight=in_flight, search=search)


def finder_of(dataset: Dataset) -> UserFinder | None:
    """Finder of the user's own file that was given for a dataset. Raises CalibError where the file is no finder."""
    return None if dataset.finder_file is None else load_finder(dataset.finder_file)


@one_blas_thread()
def search_targets_file(
    path: Path,
    targets: Sequence[DeclaredTarget],
    scan_sigma_mm: float | None = None,
    finder: UserFunction | UserFinder | None = None,
    *,
    declared: DeclaredNoise = NOTHING_DECLARED,
    intermediate: bool = True,
) -> CornerSearch:
    """Search for targets in a scan file; a file that cannot be read gives a failed search with `unreadable` set."""
    find = partial(find_targets_in, targets=targets, scan_sigma_mm=scan_sigma_mm, finder=finder, declared=declared)
    return searched_scan(path, find, intermediate=intermediate)
