"""The corners of many scans: each loaded from its file and searched, one after the other or on many processes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from calib.blas_threads import one_blas_thread
from calib.corners.correlated_noise.declared import NOTHING_DECLARED, DeclaredNoise
from calib.corners.face_bows import FaceBows, with_common_bows
from calib.corners.intersection import Corner
from calib.corners.jig_angles import JigAngles, with_common_angles
from calib.corners.search import CornerOptions, CornerSearch, failed_search, find_corner
from calib.dataset.dataset import Dataset, Scanner
from calib.errors import CornerError, DatasetError, ScanError
from calib.jig import Jig
from calib.lazy_modules import pd
from calib.parallel import map_as_completed
from calib.planes.filters import SampleSets
from calib.presented import Presented
from calib.progress import OnProgress
from calib.scans.scan import PointCount, Scan, load_scan


class CornerBatch(dict[str, CornerSearch], Presented):
    """Corner searches of a dataset's scans, by pose id, in the dataset's order."""

    def __init__(
        self,
        dataset: Dataset,
        searches: Mapping[str, CornerSearch] = MappingProxyType({}),
        jig_angles: JigAngles | None = None,
        face_bows: FaceBows | None = None,
    ) -> None:
        super().__init__(searches)
        self.dataset = dataset
        self.jig_angles, self.face_bows = jig_angles, face_bows

    def __reduce__(self) -> tuple[type[CornerBatch], tuple[Any, ...]]:
        return CornerBatch, (self.dataset, dict(self), self.jig_angles, self.face_bows)

    def to_frame(self) -> pd.DataFrame:
        """Table with a row for each scan: corner in the scanner's frame, its sigma, rms of the faces, failure.

        Columns: pose, x_mm, y_mm, z_mm, sigma_mm, rms_mm, failure.
        """
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

    def _brief(self) -> str:
        found = sum(search.corner is not None for search in self.values())
        return f"{self.dataset.name}: {found} of {len(self)} corners found"


def corners_of(
    dataset: Dataset,
    *,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
    in_flight: int = 64,
    intermediate: bool = True,
    search: Callable[[Path], CornerSearch] | None = None,
) -> CornerBatch:
    """Corners of all poses' scans of a dataset: see `calib.find_corners`."""
    rows = [i for i, pose_id in enumerate(dataset.poses.ids) if pose_id not in dataset.left_out]
    ids = [dataset.poses.ids[i] for i in rows]
    paths = [dataset.scan_path(i) for i in rows]
    scans = [path for path in paths if path is not None]
    if len(scans) < len(ids) or not scans:
        raise DatasetError(f"dataset {dataset.name!r} has no scans to find corners in; name them with scans = ...")
    search = search or partial(
        search_file,
        jig=dataset.jig,
        scan_sigma_mm=dataset.scanner.scan_sigma_mm,
        declared=declared_noise(dataset.scanner),
        intermediate=intermediate,
    )
    searches: dict[int, CornerSearch] = {}
    try:
        for pose, result in map_as_completed(search, scans, executor, in_flight):
            searches[pose] = result
            if on_progress is not None:
                on_progress(len(searches), len(ids), ids[pose])
    except BrokenExecutor:
        raise CornerError(
            f"dataset {dataset.name!r}: a process died after {len(searches)} of {len(ids)} scans, perhaps for want of "
            "memory; search with fewer processes"
        ) from None
    return CornerBatch(dataset, *of_one_jig({pose_id: searches[pose] for pose, pose_id in enumerate(ids)}, dataset.jig))


class JigShape(NamedTuple):
    """Searches of one jig's scans, with what all of them tell of its faces; None where they tell nothing."""

    searches: dict[str, CornerSearch]
    angles: JigAngles | None
    bows: FaceBows | None


def of_one_jig(searches: Mapping[str, CornerSearch], jig: Jig) -> JigShape:
    """Searches for the corner of one jig, with the bows of its faces and the angles between them that all scans tell.

    Searches for several targets stay as they are.
    """
    corners = {name: s.corner for name, s in searches.items() if s.corner is not None and type(s) is CornerSearch}
    bowed, bows = with_common_bows(corners, jig)
    held, angles = with_common_angles(bowed, jig)
    return JigShape({name: replace(s, corner=held.get(name, s.corner)) for name, s in searches.items()}, angles, bows)


def declared_noise(scanner: Scanner) -> DeclaredNoise:
    """Correlated error of the scanner as dataset.toml declares it."""
    return DeclaredNoise(
        scanner.correlated_sigma_mm or 0.0, scanner.correlation_length_mm or 0.0, scanner.registration_sigma_mm or 0.0
    )


@one_blas_thread()
def search_file(
    path: Path,
    jig: Jig,
    scan_sigma_mm: float | None = None,
    *,
    declared: DeclaredNoise = NOTHING_DECLARED,
    intermediate: bool = True,
) -> CornerSearch:
    """Corner search in a scan file; a file that cannot be read gives a failed search with `unreadable` set."""
    options = CornerOptions(declared=declared)
    find = partial(find_corner, jig=jig, scan_sigma_mm=scan_sigma_mm, options=options)
    return searched_scan(path, find, intermediate=intermediate)


def searched_scan(path: Path, find: Callable[[Scan], CornerSearch], *, intermediate: bool) -> CornerSearch:
    """Search of a scan file by `find`; a file that cannot be read gives a failed search with `unreadable` set."""
    try:
        scan = load_scan(path)
    except ScanError as error:
        return failed_search(path.stem, str(error), unreadable=True)
    search = replace(find(scan), count=PointCount(len(scan.points_mm), scan.dropped))
    return search if intermediate else _brief(search)


def _brief(search: CornerSearch) -> CornerSearch:
    """Corner search without its arrays of points: the corner, the counts and the reason stay."""
    none = np.zeros((0, 3))
    corner = None if search.corner is None else _without_bits(search.corner)
    sets = SampleSets(np.zeros((0, 4, 3)), none, none, search.sets.rejected_by)
    return replace(search, voxel_points_mm=none, voxel_normals=none, sets=sets, corner=corner)


def _without_bits(corner: Corner) -> Corner:
    """Corner whose faces do not say which points are theirs, nor those of the corners that it was made from."""
    no_bits = np.zeros(0, dtype=np.uint8)
    one, two, three = (replace(face, inlier_bits=no_bits) for face in corner.faces)
    free, flat = (None if made_from is None else _without_bits(made_from) for made_from in (corner.free, corner.flat))
    return replace(corner, faces=(one, two, three), free=free, flat=flat)
