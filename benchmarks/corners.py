"""How near the corner comes to the Cramer-Rao bound, beside Open3D's segment_plane on the same scans.

    python benchmarks/corners.py [--scans 20] [--points 12000 50000 200000] [--no-open3d]

Scans are those of the tests' ray caster (tests/scan_scene.py): a jig of 60 mm edge some 700 mm away on its flange, with
link, wall and table behind, 0.02 mm * (0.5 + 0.5 / cos^2 incidence) of noise along the ray, 35 % flying pixels at depth
edges, dropouts at grazing incidence. The bound is that of three free planes, of each scan.

The peer takes planes from the cloud by RANSAC until three are perpendicular (0.1 mm, 1000 iterations, at most 8
planes), and intersects them: once on the whole scan, as this project does, and once with the favour of a crop of 60 mm
around the true apex, which leaves little but the jig.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from calib.corners import find_corner  # noqa: E402
from calib.intersection import intersect  # noqa: E402
from calib.jig import Jig  # noqa: E402
from scan_scene import SceneScan, make_scene  # noqa: E402

WRONG_MM = 1.0  # an apex farther off is not a measurement but a mistake
Found = tuple[NDArray, NDArray | None] | None


def ours(scene: SceneScan) -> Found:
    """The product's corner and its covariance."""
    corner = find_corner(scene.scan, Jig(), scan_sigma_mm=0.02).corner
    return None if corner is None else (corner.xyz_mm, corner.covariance_mm2)


def open3d_whole(scene: SceneScan) -> Found:
    """Open3D on the whole scan."""
    return open3d_planes(scene.scan.points_mm)


def open3d_cropped(scene: SceneScan) -> Found:
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


def measure(name: str, method: Callable[[SceneScan], Found], scenes: list[SceneScan]) -> str:
    """One line of the table."""
    ratios, mahalanobis, seconds, wrong, failed = [], [], [], 0, 0
    for scene in scenes:
        started = time.perf_counter()
        found = method(scene)
        seconds.append(time.perf_counter() - started)
        if found is None:
            failed += 1
            continue
        error = found[0] - scene.apex_mm
        if np.linalg.norm(error) > WRONG_MM:
            wrong += 1
            continue
        ratios.append(np.linalg.norm(error) / scene.bound_mm)
        if found[1] is not None:
            mahalanobis.append(error @ np.linalg.solve(found[1], error))
    points = int(np.median([len(s.label) for s in scenes]))
    bound = float(np.median([s.bound_mm for s in scenes]))
    ratio = f"{np.sqrt(np.mean(np.square(ratios))):10.2f}" if ratios else f"{'-':>10}"
    honest = f"{np.mean(mahalanobis):11.2f}" if mahalanobis else f"{'-':>11}"
    return f"{name:14}{points:9}{bound:11.4f}{ratio}{honest}{np.median(seconds):9.2f}{failed:8}{wrong:7}{len(scenes):7}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="corner accuracy against the Cramer-Rao bound")
    parser.add_argument("--scans", type=int, default=20)
    parser.add_argument("--points", type=int, nargs="+", default=[12_000, 50_000, 200_000])
    parser.add_argument("--no-open3d", action="store_true")
    arguments = parser.parse_args()
    lines = [
        f"{'method':14}{'points':>9}{'bound mm':>11}{'RMS/bound':>10}{'Mahal.^2':>11}{'seconds':>9}"
        f"{'failed':>8}{'wrong':>7}{'scans':>7}"
    ]
    for rays in arguments.points:
        scenes = [make_scene(np.random.default_rng([rays, seed]), rays) for seed in range(arguments.scans)]
        lines.append(measure("this project", ours, scenes))
        if not arguments.no_open3d:
            lines.append(measure("Open3D whole", open3d_whole, scenes))
            lines.append(measure("Open3D crop", open3d_cropped, scenes))
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
