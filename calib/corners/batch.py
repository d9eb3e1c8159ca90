"""The corners of many scans: each loaded from its file and searched, one after the other or on many processes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd

from calib.blas_threads import one_blas_thread
from calib.corners.noise.told import NOTHING_TOLD, ToldNoise
from calib.corners.refinement import RefinementOptions
from calib.corners.search import CornerOptions, CornerSearch, failed_search, find_corner
from calib.dataset.dataset import Dataset, Scanner
from calib.errors import CornerError, DatasetError, ScanError
from calib.jig import Jig
from calib.parallel import map_as_completed
from calib.planes.filters import SampleSets
from calib.presented import Presented
from calib.progress import OnProgress, counted
from calib.scans.scan import PointCount, load_scan


class CornerBatch(dict[str, CornerSearch], Presented):
    """The search of each scan of a dataset, by pose id, in the dataset's order."""

    def __init__(self, dataset: Dataset, searches: Mapping[str, CornerSearch] = MappingProxyType({})) -> None:
        super().__init__(searches)
        self.dataset = dataset

    def __reduce__(self) -> tuple[type[CornerBatch], tuple[Dataset, dict[str, CornerSearch]]]:
        return CornerBatch, (self.dataset, dict(self))

    def to_frame(self) -> pd.DataFrame:
        """A row a scan: pose, x_mm, y_mm, z_mm in the scanner's frame, sigma_mm, rms_mm of the faces, failure."""
        rows = []
        for pose_id, search in self.items():
            corner = search.corner
            xyz = (np.nan,) * 3 if corner is None else corner.xyz_mm
            faces = () if corner is None else corner.faces
            rows.append(
                {
                    "pose": pose_id,
                    **{f"{axis}_mm": float(value) for axis, value in zip("xyz", xyz, strict=True)},
                    "sigma_mm": np.nan if corner is None else corner.sigma_mm(),
                    "rms_mm": max((face.rms_mm for face in faces), default=np.nan),
                    "failure": search.failure,
                }
            )
        return pd.DataFrame(rows)


def find_corners(
    dataset: Dataset,
    *,
    progress: bool = False,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
    in_flight: int = 64,
    intermediate: bool = True,
    search: Callable[[Path], CornerSearch] | None = None,
) -> CornerBatch:
    """The corner of every pose's scan, by pose id, in the dataset's order; none of poses that are left out.

    `progress` shows a bar, in a notebook's cell or at the terminal, and `on_progress(done, total, pose_id)` is called
    after each scan. With an `executor` (threads, processes, Dask's
    `Client.get_executor()`: any `concurrent.futures.Executor`) the scans are processed by it, `in_flight` with it at a
    time, which should be twice its workers or more; the result is the same to the bit, as each search multiplies on
    one BLAS thread wherever it runs. Each job loads its own scan, so no more scans are in memory than jobs run at a
    time. A scan that cannot be read becomes a failed search with `unreadable` set. Without `intermediate` the
    searches come back without the arrays that are only shown (some 2 MB a scan of 200,000 points): with the corner,
    the counts and the reason. `search` is what a job does with a scan's file, where it is to look for other targets.

    Raises DatasetError where the dataset has no scans; CornerError where a process of the executor died.
    """
    wanted = [i for i, pose_id in enumerate(dataset.poses.ids) if pose_id not in dataset.left_out]
    ids = [dataset.poses.ids[i] for i in wanted]
    paths = [dataset.scan_path(i) for i in wanted]
    scans = [path for path in paths if path is not None]
    if len(scans) < len(ids) or not scans:
        raise DatasetError(f"dataset {dataset.name!r} has no scans to find corners in; name them with scans = ...")
    search = search or partial(
        search_file,
        jig=dataset.jig,
        scan_sigma_mm=dataset.scanner.scan_sigma_mm,
        told=told_noise(dataset.scanner),
        intermediate=intermediate,
    )
    found: dict[int, CornerSearch] = {}
    try:
        with counted("corners", "scan", asked=progress, then=on_progress) as tell:
            for pose, result in map_as_completed(search, scans, executor, in_flight):
                found[pose] = result
                if tell is not None:
                    tell(len(found), len(ids), ids[pose])
    except BrokenExecutor:
        raise CornerError(
            f"dataset {dataset.name!r}: a process died after {len(found)} of {len(ids)} scans, perhaps for want of "
            "memory; search with fewer processes"
        ) from None
    return CornerBatch(dataset, {pose_id: found[pose] for pose, pose_id in enumerate(ids)})


def told_noise(scanner: Scanner) -> ToldNoise:
    """What a dataset tells of its scanner's smooth error."""
    return ToldNoise(
        scanner.correlated_sigma_mm or 0.0,
        scanner.correlation_length_mm or 0.0,
        scanner.registration_sigma_mm or 0.0,
    )


@one_blas_thread()
def search_file(
    path: Path,
    jig: Jig,
    scan_sigma_mm: float | None = None,
    *,
    told: ToldNoise = NOTHING_TOLD,
    intermediate: bool = True,
) -> CornerSearch:
    """`find_corner` in a scan file; one that cannot be read becomes a failed search with `unreadable` set."""
    try:
        scan = load_scan(path)
    except ScanError as error:
        return failed_search(path.stem, str(error), unreadable=True)
    options = CornerOptions(refinement=RefinementOptions(told=told))
    search = find_corner(scan, jig, scan_sigma_mm=scan_sigma_mm, options=options)
    search = replace(search, count=PointCount(len(scan.points_mm), scan.dropped))
    return search if intermediate else brief(search)


def brief(search: CornerSearch) -> CornerSearch:
    """The search without its arrays of points: the corner, the counts and the reason stay."""
    none, no_bits = np.zeros((0, 3)), np.zeros(0, dtype=np.uint8)
    corner = search.corner
    if corner is not None:
        one, two, three = (replace(face, inlier_bits=no_bits) for face in corner.faces)
        corner = replace(corner, faces=(one, two, three))
    sets = SampleSets(np.zeros((0, 4, 3)), none, none, search.sets.rejected_by)
    return replace(search, voxel_points_mm=none, voxel_normals=none, sets=sets, corner=corner)
