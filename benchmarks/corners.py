"""Corner errors over the Cramer-Rao bound, in easy and difficult scenes, beside Open3D on the same scans.

    python benchmarks/corners.py [--scans 5] [--points 12000 50000] [--peer-points 50000 200000 1000000]
                                 [--peer-scans 4] [--cases NAME ...] [--no-open3d]

Scans are those of the tests' ray caster (tests/support/scan_scene.py, cases in tests/support/scan_cases.py): a jig of
60 mm edge some 700 mm away on its flange, with link, wall and table behind, 0.02 mm * (0.5 + 0.5 / cos^2 incidence) of
noise along the ray, 35 % flying pixels at depth edges, dropouts at grazing incidence. The bound is that of three free
planes, of each scan, and white noise; a smooth error ("waves") is not in it. Columns of the first table:

    RMS/bound   root mean square over the scans of error over bound: 1 is the best there is
    Mahal.^2    mean squared error in units of the reported covariance: 3 is honest
    wrong       a corner more than 10 bounds and more than 5 of its own sigmas off
    seconds     median CPU time of one corner

The peer takes planes from the cloud by RANSAC until three are perpendicular (0.1 mm, 1000 iterations, at most 8
planes), and intersects them: once on the whole scan, as this project does, and once with the favour of a crop of 60 mm
around the true apex, which leaves little but the jig. Time ratios are of CPU times on one thread, so that a busy
machine does not decide; errors are RMS over the bound.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy and Open3D are loaded

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from calib.corners.intersection import intersect  # noqa: E402
from calib.corners.search import find_corner  # noqa: E402
from calib.statistics import rms  # noqa: E402
from tests.support.scan_cases import CASES, Case  # noqa: E402
from tests.support.scan_scene import SceneScan  # noqa: E402

Found = tuple[NDArray, NDArray | None] | None


def ours(scene: SceneScan, case: Case) -> Found:
    """The product's corner and its covariance."""
    corner = find_corner(scene.scan, case.jig, scan_sigma_mm=case.told_sigma_mm).corner
    return None if corner is None else (corner.xyz_mm, corner.covariance_mm2)


def open3d_whole(scene: SceneScan, case: Case) -> Found:
    """Open3D on the whole scan."""
    return open3d_planes(scene.scan.points_mm)


def open3d_cropped(scene: SceneScan, case: Case) -> Found:
    """Open3D on what lies around the true apex."""
    points = scene.scan.points_mm
    return open3d_planes(points[np.all(np.abs(points - scene.apex_mm) < 60, axis=1)])


def open3d_planes(points_mm: NDArray) -> Found:
    """The first three perpendicular planes that RANSAC takes out of the points (N, 3)."""
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points_mm))
    open3d.utility.random.seed(0)
    planes: list[NDArray] = []
    while len(planes) < 8 and len(cloud.points) > 50:
        plane, inliers = cloud.segment_plane(0.1, 3, 1000)
        planes.append(np.asarray(plane))
        cloud = cloud.select_by_index(inliers, invert=True)
        for triple in combinations(planes, 3):
            chosen = np.array(triple)
            dots = np.abs(chosen[:, :3] @ chosen[:, :3].T)[np.triu_indices(3, 1)]
            if dots.max() < np.sin(np.radians(2)):
                return intersect(chosen[:, :3], -chosen[:, 3]), None
    return None


@dataclass(frozen=True)
class Measured:
    """Results of one method on some scans."""

    ratios: NDArray  # (K,) error over bound of the corners found
    mahalanobis: NDArray  # (K,) squared, NaN without a covariance
    failed: int
    wrong: int
    cpu_s: float  # median

    def rms(self) -> float:
        """Root mean square of the ratios."""
        return rms(self.ratios) if len(self.ratios) else float("nan")


def measure(method: Callable[[SceneScan, Case], Found], scenes: list[SceneScan], case: Case) -> Measured:
    """Run one method on all scans."""
    ratios, mahalanobis, cpu, failed = [], [], [], 0
    for scene in scenes:
        started = time.process_time()
        found = method(scene, case)
        cpu.append(time.process_time() - started)
        if found is None:
            failed += 1
            continue
        error = found[0] - scene.apex_mm
        ratios.append(np.linalg.norm(error) / scene.bound_mm)
        mahalanobis.append(np.nan if found[1] is None else error @ np.linalg.solve(found[1], error))
    far = np.array(ratios) > 10
    wrong = int(np.sum(far & ~(np.array(mahalanobis) <= 25)))
    return Measured(np.array(ratios), np.array(mahalanobis), failed, wrong, float(np.median(cpu)))


def case_table(names: list[str], points: list[int], scans: int) -> Iterator[str]:
    """Lines of the first table."""
    yield (
        f"{'case':20}{'points':>9}{'bound mm':>10}{'RMS/bound':>11}{'Mahal.^2':>10}{'failed':>8}{'wrong':>7}"
        f"{'scans':>7}{'seconds':>9}"
    )
    squared: dict[bool, list[float]] = {False: [], True: []}
    for rays in points:
        for name in names:
            case = CASES[name]
            scenes = [case.scene(name, seed, rays) for seed in range(scans)]
            found = measure(ours, scenes, case)
            squared["waves" in name] += found.mahalanobis.tolist()
            count = int(np.median([len(s.label) for s in scenes]))
            bound = float(np.median([s.bound_mm for s in scenes]))
            mean = float(np.mean(found.mahalanobis)) if len(found.mahalanobis) else float("nan")
            yield (
                f"{name:20}{count:9}{bound:10.4f}{found.rms():11.2f}{mean:10.2f}{found.failed:8}{found.wrong:7}"
                f"{scans:7}{found.cpu_s:9.2f}"
            )
    for wavy, values in squared.items():
        if values:
            kind = "a smooth error" if wavy else "white noise"
            spread = np.std(values) / np.sqrt(len(values))
            yield f"squared Mahalanobis error, {kind}: {np.mean(values):.2f} +- {spread:.2f} ({len(values)} corners)"


def peer_table(points: list[int], scans: int) -> Iterator[str]:
    """Lines of the second table: plain scans, this project and Open3D one after the other."""
    yield (
        f"{'plain scans':20}{'points':>9}{'RMS/bound':>11}{'failed':>8}{'seconds':>9}{'error of peer':>15}"
        f"{'times faster':>14}"
    )
    case = CASES["plain"]
    for rays in points:
        scenes = [case.scene("plain", seed, rays) for seed in range(scans)]
        mine = measure(ours, scenes, case)
        count = int(np.median([len(s.label) for s in scenes]))
        yield f"{'this project':20}{count:9}{mine.rms():11.2f}{mine.failed:8}{mine.cpu_s:9.2f}"
        for name, method in (("Open3D whole", open3d_whole), ("Open3D crop", open3d_cropped)):
            peer = measure(method, scenes, case)
            yield (
                f"{name:20}{count:9}{peer.rms():11.2f}{peer.failed:8}{peer.cpu_s:9.2f}"
                f"{mine.rms() / peer.rms():15.2f}{peer.cpu_s / mine.cpu_s:14.1f}"
            )


def main() -> None:
    """Print both tables, a line as soon as it is known."""
    parser = argparse.ArgumentParser(description="corner accuracy against the Cramer-Rao bound")
    parser.add_argument("--scans", type=int, default=5, help="scans a case and size")
    parser.add_argument("--points", type=int, nargs="*", default=[12_000, 50_000])
    parser.add_argument("--cases", nargs="*", default=list(CASES), choices=list(CASES), metavar="NAME")
    parser.add_argument("--peer-points", type=int, nargs="*", default=[50_000, 200_000, 1_000_000])
    parser.add_argument("--peer-scans", type=int, default=4)
    parser.add_argument("--no-open3d", action="store_true")
    arguments = parser.parse_args()
    for line in case_table(arguments.cases, arguments.points, arguments.scans):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()
    if not arguments.no_open3d:
        sys.stdout.write("\n")
        for line in peer_table(arguments.peer_points, arguments.peer_scans):
            sys.stdout.write(line + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
