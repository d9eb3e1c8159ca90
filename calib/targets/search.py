"""Search of scans for all targets by the finder of each kind, with the places found and reasons for failures."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from calib.blas_threads import one_blas_thread
from calib.corners.batch import CornerBatch, corners_of, declared_noise, searched_scan
from calib.corners.correlated_noise.declared import NOTHING_DECLARED, DeclaredNoise
from calib.corners.search import CornerOptions, CornerSearch, failed_search, find_corner
from calib.dataset.dataset import Dataset
from calib.errors import TargetError
from calib.jig import Jig
from calib.progress import OnProgress
from calib.scans.scan import Scan
from calib.target_shapes import DeclaredTarget, OwnShape, Socket, Sphere, Spheres
from calib.targets.protocol.finder import FoundPoint, TargetFinder, UserFinder, Wanted, checked_answer, load_finder
from calib.targets.spheres.constellation import find_constellation
from calib.targets.spheres.socket import find_socket
from calib.targets.spheres.sphere_finder import find_spheres
from calib.targets.trihedral import find_jigs

_FINDERS: dict[type, TargetFinder] = {
    Sphere: find_spheres,
    Spheres: find_constellation,
    Socket: find_socket,
}
"""The finder of each shape but the jig's and a user's own."""

UserFunction = Callable[[Scan, Wanted], Any]


@dataclass(frozen=True)
class TargetSearch:
    """Result of a finder for the targets of one shape in one scan."""

    names: tuple[str, ...]  # of the targets
    places: tuple[FoundPoint, ...]  # where such targets are; all poses together decide which is which
    failure: str  # "" or why there is none


@dataclass(frozen=True)
class ScanSearch(CornerSearch):
    """Search of a scan for several targets: the corner of the first jig, if any, and all places found."""

    found: tuple[TargetSearch, ...] = ()

    @property
    def places(self) -> tuple[FoundPoint, ...]:
        """Places of all targets."""
        return tuple(place for search in self.found for place in search.places)

    def state(self) -> str:
        """ "found", or "found, 2 missing" with the number of kinds of target that were not found."""
        missing = sum(bool(one.failure) for one in self.found)
        return f"found, {missing} missing" if missing else "found"


def wanted_of(targets: Sequence[DeclaredTarget], scan_sigma_mm: float | None) -> list[Wanted]:
    """Requests to finders, one for all targets of equal shape, which are identified later."""
    requests: list[Wanted] = []
    for target in targets:
        same = next((k for k, w in enumerate(requests) if w.shape == target.shape), None)
        if same is None or isinstance(target.shape, OwnShape):
            requests.append(Wanted(target.shape, target.names, scan_sigma_mm))
        else:
            requests[same] = replace(requests[same], names=(*requests[same].names, *target.names))
    return requests


def find_targets_in(
    scan: Scan,
    targets: Sequence[DeclaredTarget],
    *,
    scan_sigma_mm: float | None = None,
    finder: UserFunction | UserFinder | None = None,
    declared: DeclaredNoise = NOTHING_DECLARED,
) -> CornerSearch:
    """All targets found in one scan; where the only target is a jig, the result of `find_corner`.

    `finder` is called for targets of shape "own"; where there is none, in place of the built-in finders. Never raises
    on a scan: reasons are kept.
    """
    started = time.perf_counter()
    own = any(isinstance(target.shape, OwnShape) for target in targets)
    wanted = [replace(one, declared=declared) for one in wanted_of(targets, scan_sigma_mm)]
    if finder is None and len(targets) == 1 and isinstance(targets[0].shape, Jig):
        options = CornerOptions(declared=declared)
        return find_corner(scan, targets[0].shape, scan_sigma_mm=scan_sigma_mm, options=options)
    corner_search: CornerSearch | None = None
    jig_shapes = sum(isinstance(w.shape, Jig) for w in wanted)
    searches = []
    for one in wanted:
        try:
            if finder is not None and (not own or isinstance(one.shape, OwnShape)):
                places = _call_finder(finder, scan, one)
            elif isinstance(one.shape, OwnShape):
                raise TargetError("no finder of your own is given for this target; give one with --finder FILE.py")
            elif isinstance(one.shape, Jig):
                first, places = find_jigs(scan, one, jig_shapes)
                corner_search = corner_search or first
            else:
                places = _FINDERS[type(one.shape)](scan, one)
        except TargetError as error:
            searches.append(TargetSearch(one.names, (), str(error)))
        else:
            searches.append(TargetSearch(one.names, tuple(places), ""))
    base = corner_search or failed_search(scan.name, "")
    none = not any(search.places for search in searches)
    failure = "; ".join(_failure_text(search) for search in searches) if none else ""
    values = {f.name: getattr(base, f.name) for f in fields(CornerSearch)}
    values |= {"failure": failure, "seconds": time.perf_counter() - started}
    return ScanSearch(**values, found=tuple(searches))


def _failure_text(search: TargetSearch) -> str:
    """Reason of a failed search, after the targets' names where there are several."""
    return search.failure if len(search.names) == 1 else f"{', '.join(search.names)}: {search.failure}"


def _call_finder(finder: UserFunction | UserFinder, scan: Scan, wanted: Wanted) -> Sequence[FoundPoint]:
    """Places that a user's finder returns, checked. Raises TargetError."""
    if isinstance(finder, UserFinder):
        return finder(scan, wanted)
    return checked_answer(finder, scan, wanted, getattr(finder, "__name__", "finder"))


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
