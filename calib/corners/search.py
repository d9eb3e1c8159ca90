"""Search of a scan for the corner of the jig (Jang 2025, section 2, then refinement on all inliers)."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from calib.array_types import Array, IndexArray
from calib.blas_threads import one_blas_thread
from calib.corners.correlated_noise.declared import NOTHING_DECLARED, DeclaredNoise
from calib.corners.face_selection import TriedPairs, face_triples, why_no_triple
from calib.corners.intersection import Corner
from calib.corners.plane_triples import Planes, SelectionTolerances
from calib.corners.refinement import refine
from calib.corners.unit_check import MOST_EDGES, extent_of, failure_with_unit, some_finite
from calib.errors import CornerError
from calib.jig import Jig
from calib.planes.clustering import ClusterTolerances, PlaneGroup, cluster, off_planes
from calib.planes.filters import FilterTolerances, SampleSets, apply_filters, draw_sample_sets, walk_for
from calib.planes.normals import NEIGHBOURS, Neighbourhoods, estimate_normals, with_fewer_neighbours
from calib.planes.point_selection import thin_to_voxels
from calib.presented import Presented
from calib.scans.scan import PointCount, Scan, load_scan, seeded_generator

MIN_POINTS = 60  # below this even a perfect scan leaves no face enough points
MOST_TRIPLES = 4  # of planes, that are refined in one search pass
# Share of loose points, beyond which the finer passes go without them: stray points hide a jig of few points.
_MOST_LOOSE = 0.3
_WALL_STEP = 4
_POINTS_A_SET = 8  # thinned points a sample set; a wide scene needs more sets for some to fall on the jig

# (voxels along the jig's edge, neighbours of a normal, factor on the number of sample sets) of the search passes, until
# one finds the jig. The first, coarse one finds most jigs in a third of the time of a fine one. Few neighbours fit into
# a narrow or sparsely seen face, many give normals in noise; many sets meet a jig that is a small part of the scan.
_COARSE = (20, 12, 0.4)
_FINE_VOXELS = 28
_FINE = ((9, 4), (NEIGHBOURS, 12))


@dataclass(frozen=True)
class CornerOptions:
    """Options of the search. Lengths that are not here follow from the jig's edge and the noise."""

    sample_sets: int = 5000
    local_sets: bool = True  # False: four points from the whole scan, as in the paper
    declared: DeclaredNoise = NOTHING_DECLARED  # of the scanner's smooth error


@dataclass(frozen=True)
class CornerSearch(Presented):
    """Every intermediate product of one search for a corner, successful or not, for inspection."""

    scan: str
    voxel_points_mm: Array  # (V, 3) the points that the sample sets were drawn from
    voxel_normals: Array  # (V, 3) toward the scanner
    sets: SampleSets
    groups: tuple[PlaneGroup, ...]  # the one with the most sets first; a voted third face is the last, without sets
    chosen: tuple[int, ...]  # indices of the three chosen groups, () where none were
    corner: Corner | None
    failure: str  # "" or the reason, with numbers and a way out
    seconds: float
    unreadable: bool = False  # the scan's file could not be read at all
    count: PointCount | None = None  # of the scan's file, where it was read from one
    search_passes: int = 1  # through the scan, a coarse one, then finer ones with other neighbours or more sample sets

    def filter_counts(self) -> dict[str, int]:
        """Numbers of sample sets drawn, rejected by each filter, and passed."""
        passed, first, second, third = np.bincount(self.sets.rejected_by, minlength=4).tolist()
        return {
            "drawn": len(self.sets), "filter1": first, "filter2": second, "filter3": third, "passed": passed,
        }  # fmt: skip

    def _brief(self) -> str:
        if self.corner is None:
            return f"{self.scan}: no corner: {self.failure}"
        x, y, z = self.corner.xyz_mm
        return f"{self.scan}: corner ({x:.4f}, {y:.4f}, {z:.4f}) mm, sigma {self.corner.sigma_mm():.4f} mm"


@one_blas_thread()
def find_corner(
    scan: Scan | str | Path,
    jig: Jig = Jig(),
    *,
    scan_sigma_mm: float | None = None,
    rng: np.random.Generator | None = None,
    options: CornerOptions | None = None,
) -> CornerSearch:
    """The jig's apex in one scan, with its covariance and every intermediate product of the search.

    Never raises on a scan: where there is no corner, the search's `failure` says why, and whether the scan is in
    another unit than the millimetre. No scan is scaled.

    Args:
        scan: a scan, or its file (then raises ScanError where it cannot be read).
        jig: three faces at right angles with edges of 60 mm, where it is not given.
        scan_sigma_mm: noise of a scan point along its ray; the larger of it and the noise found in the scan counts.
        rng: draws the sample sets; seeded by the scan's points where None, so that a scan always gives one corner.
        options: of the search.

    >>> import calib
    >>> calib.find_corner("sample_data/rb5_jang/scans/p01.ply")
    CornerSearch(p01: corner (96.2940, -86.7838, 561.5935) mm, sigma 0.0234 mm)
    """
    scan = scan if isinstance(scan, Scan) else load_scan(scan)
    points_mm, name = scan.points_mm, scan.name
    options = options or CornerOptions()
    started = time.perf_counter()

    def search_in(points_mm: Array) -> CornerSearch:
        draws = rng or seeded_generator(points_mm)
        return _search(Scan(name, points_mm), jig, scan_sigma_mm, draws, options)

    search = search_in(points_mm)
    if search.corner is None and len(points_mm) >= MIN_POINTS:
        failure = failure_with_unit(
            search.failure, points_mm, jig, lambda points_mm: search_in(points_mm).corner is not None
        )
        search = replace(search, failure=failure)
    return replace(search, seconds=time.perf_counter() - started)


def _search(
    scan: Scan, jig: Jig, scan_sigma_mm: float | None, rng: np.random.Generator, options: CornerOptions
) -> CornerSearch:
    """Result of the first search pass that finds the jig in a scan in millimetres, else of the best failed one."""
    searches: list[CornerSearch] = []
    planes: list[Planes] = []
    walls: list[PlaneGroup] = []
    tried = TriedPairs()
    try:
        for around, times in _pass_inputs(scan.points_mm, jig, planes):
            more = replace(options, sample_sets=round(times * options.sample_sets))
            search, found = _search_pass(scan, around, jig, scan_sigma_mm, rng, more, walls, tried)
            searches.append(search)
            planes.append(found)
            if search.corner is not None:
                break
            walls += found.walls()
    except CornerError as error:
        return failed_search(scan.name, str(error))
    # Of failed passes the first is reported, unless a later one came as far as three planes.
    best = max(range(len(searches)), key=lambda k: (searches[k].corner is not None, len(searches[k].chosen)))
    reported = replace(searches[best], search_passes=len(searches))
    if reported.corner is None and not reported.failure:
        return replace(reported, failure=why_no_triple(planes[best]))
    return reported


def _pass_inputs(points_mm: Array, jig: Jig, found: list[Planes]) -> Iterator[tuple[Neighbourhoods, float]]:
    """Thinned points of each search pass, and its factor on the number of sample sets; `found`: earlier passes' planes.

    Raises CornerError as `_thinned` does.
    """
    voxels, neighbours, times = _COARSE
    yield estimate_normals(points_mm.take(_thinned(points_mm, jig, voxels), axis=0), neighbours), times
    points_mm = points_mm.take(_thinned(points_mm, jig, _FINE_VOXELS), axis=0)
    kept = off_planes(found[0].walls(), points_mm, found[0].tolerances.height_mm)
    # Of walls some points will do, for what is seen through a face and where it spills over.
    kept[np.flatnonzero(~kept)[::_WALL_STEP]] = True
    around = estimate_normals(points_mm[kept])
    loose = around.loose()
    if len(loose) * _MOST_LOOSE < loose.sum() < len(loose) - NEIGHBOURS:
        around = estimate_normals(around.points_mm[~loose])
    for neighbours, times in _FINE:
        yield with_fewer_neighbours(around, neighbours), times


def _search_pass(
    scan: Scan,
    around: Neighbourhoods,
    jig: Jig,
    scan_sigma_mm: float | None,
    rng: np.random.Generator,
    options: CornerOptions,
    walls: Sequence[PlaneGroup],
    tried: TriedPairs,
) -> tuple[CornerSearch, Planes]:
    """One pass over the scan's thinned points: sample sets, plane groups, the three faces and their refinement.

    No sets are drawn around the points of known walls; fewer are drawn then, as many per point as without walls. Where
    all triples fail in the refinement the likeliest is reported; where there is no triple no reason is given yet.
    """
    tolerances = _Tolerances.of(around, jig, max(scan_sigma_mm or 0.0, around.noise_mm()))
    allowed = tolerances.selection
    free = off_planes(walls, around.points_mm, allowed.height_mm, around.normals, allowed.member_normal_rad)
    off_walls = np.flatnonzero(free if np.count_nonzero(free) >= MIN_POINTS else np.ones_like(free))
    count = max(options.sample_sets, len(around.points_mm) // _POINTS_A_SET)
    drawn = draw_sample_sets(
        around.neighbours,
        round(count * len(off_walls) / len(around.points_mm)),
        rng,
        long_walk=walk_for(2 * tolerances.filters.distance_mm[0], float(np.median(around.radius_mm))),
        local=options.local_sets,
        around=off_walls,
    )
    sets = apply_filters(around.points_mm[drawn], around.normals[drawn], tolerances.filters)
    groups = cluster(sets, tolerances.clusters)
    search = CornerSearch(scan.name, around.points_mm, around.normals, sets, groups, (), None, "", 0.0)
    planes = Planes(groups, around, jig, tolerances.selection)
    failed: list[CornerSearch] = []
    for triple in islice(face_triples(scan.points_mm, planes, tried), MOST_TRIPLES):
        search = replace(search, groups=triple.groups, chosen=triple.chosen)
        try:
            corner = refine(
                scan.points_mm,
                triple.groups,
                triple.chosen,
                jig,
                triple.outline,
                tolerances.clusters.sigma_mm,
                options.declared,
                scan_sigma_mm,
            )
        except CornerError as error:
            failed.append(replace(search, failure=str(error)))
        else:
            notes = (*corner.quality.notes, *triple.note_on_mirroring())
            return replace(search, corner=replace(corner, quality=replace(corner.quality, notes=notes))), planes
    return (failed or [search])[0], planes


@dataclass(frozen=True)
class _Tolerances:
    """Tolerances of the stages, from the jig's edge and the scan's noise; the factors were found by experiment."""

    filters: FilterTolerances
    clusters: ClusterTolerances
    selection: SelectionTolerances

    @staticmethod
    def of(around: Neighbourhoods, jig: Jig, sigma_mm: float) -> _Tolerances:
        """Tolerances for a scan with noise `sigma_mm` along the normals."""
        edge_mm = jig.shortest_mm
        normals_rad = float(np.clip(5 * np.median(around.normal_sigma_rad), np.radians(8), np.radians(25)))
        height_mm = max(min(15 * sigma_mm, max(5 * sigma_mm, edge_mm / 24)), edge_mm / 120)
        out_of_square_rad = np.radians(jig.out_of_square_deg())
        return _Tolerances(
            FilterTolerances(
                distance_mm=(max(edge_mm / 40, min(12 * sigma_mm, edge_mm / 15)), edge_mm / 3),
                point_normals_rad=normals_rad,
                triangle_normals_rad=max(np.radians(3), 0.6 * normals_rad),
            ),
            ClusterTolerances(
                parallel_rad=np.radians(4), in_plane_rad=np.radians(4), height_mm=height_mm, sigma_mm=sigma_mm
            ),
            SelectionTolerances(
                perpendicular_rad=np.radians(1.5) + out_of_square_rad + 12 * sigma_mm / edge_mm,
                member_normal_rad=max(normals_rad, np.radians(15)),
                height_mm=height_mm,
            ),
        )


def _thinned(points_mm: Array, jig: Jig, voxels: int) -> IndexArray:
    """Indices of one point per voxel. Raises CornerError where the scan is too sparse, small or large for the jig."""
    finite = len(some_finite(points_mm))
    if finite < MIN_POINTS:
        raise CornerError(
            f"the scan holds {finite} points, a corner needs at least {MIN_POINTS}; scan the pose again, finer"
        )
    extent, edge = extent_of(points_mm), jig.shortest_mm
    if extent < edge / 10:
        raise CornerError(f"the scan spans {extent:.3g} mm only, the jig has {jig.edges_text()}; scan the pose again")
    if extent > MOST_EDGES * jig.longest_mm:
        raise CornerError(
            f"the scan spans {extent:.4g} mm, {extent / jig.longest_mm:.0f} times the jig's edge of "
            f"{jig.longest_mm:g} mm; "
            "check that the scan and edge_mm in dataset.toml are both in millimetres"
        )
    thinned = thin_to_voxels(points_mm, edge / voxels)
    if len(thinned) < NEIGHBOURS:
        raise CornerError(
            f"the scan's points lie in {len(thinned)} spots of {edge / voxels:.2g} mm, a corner needs "
            f"{NEIGHBOURS} at the very least; scan the pose again"
        )
    return thinned


def failed_search(name: str, failure: str, *, unreadable: bool = False) -> CornerSearch:
    """Search that ended before the first sample set."""
    none = np.zeros((0, 3))
    sets = SampleSets(np.zeros((0, 4, 3)), none, none, np.zeros(0, np.uint8))
    return CornerSearch(name, none, none, sets, (), (), None, failure, 0.0, unreadable)
