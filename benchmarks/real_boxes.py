"""Corners of real boxes: how well two halves of one scan agree, by this project and by Open3D's RANSAC planes.

    python benchmarks/real_boxes.py FOLDER_OF_PCD_FILES [--edge-mm 70 | --edge-mm 70 110 160] [--files 49] [--splits 4]

The scans are those of the Modified Object Segmentation Database (Richtsfeld; Alexandrov): segmentation/mOSD of the
repository PointCloudLibrary/data on GitHub, `learn/learn0.pcd` to 24 and `test/test0.pcd` to 23, boxes on a table, seen
by a Kinect from a metre away, with a label a point. They are read where they lie; none is part of this project.

Each labelled object gets a first corner by generous RANSAC planes, and around it what a jig of one --edge-mm would show
is cut out, or what a box of three would, the same points for both methods. They are split at random into halves, a
corner is found in each, and their distance over sqrt(2) is the repeatability of one. It says how much of the error is
noise of single points; what the Kinect bends, both halves share. Where this project refuses, the reasons are counted.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from itertools import combinations
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from calib.corners.intersection import intersect  # noqa: E402
from calib.corners.search import find_corner  # noqa: E402
from calib.jig import Jig  # noqa: E402
from calib.measurement.measured_points import counted_reasons  # noqa: E402
from calib.scans.scan import Scan  # noqa: E402

FIRST_OBJECT = 20  # labels below are the table's
SQUARE_DEG = 8.0  # a Kinect bends planes
BESIDE_MM = 8.0  # of a face, towards the outside, that is cut out with it
PEER_MM = (1.0, 1.5, 2.0, 3.0, 5.0)  # RANSAC's threshold
Method = Callable[[NDArray], NDArray | None]


def objects(path: Path) -> Iterator[NDArray]:
    """The points (N, 3) of each labelled object, mm. Open3D's tensor reader keeps the labels."""
    import open3d

    cloud = open3d.t.io.read_point_cloud(str(path))
    points = cloud.point["positions"].numpy().astype(float) * 1000
    label = cloud.point["label"].numpy().ravel().astype(int)
    seen = np.isfinite(points).all(axis=1) & (points[:, 2] > 0)
    for number in np.unique(label[seen & (label >= FIRST_OBJECT)]):
        yield points[seen & (label == number)]


def ransac_corner(points_mm: NDArray, threshold_mm: float) -> tuple[NDArray, NDArray] | None:
    """The corner of the first three planes that are square to each other, and their normals."""
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points_mm))
    open3d.utility.random.seed(0)
    planes: list[NDArray] = []
    while len(planes) < 6 and len(cloud.points) > 50:
        plane, inliers = cloud.segment_plane(threshold_mm, 3, 1000)
        planes.append(np.asarray(plane))
        cloud = cloud.select_by_index(inliers, invert=True)
        for triple in combinations(planes, 3):
            chosen = np.array(triple)
            dots = np.abs(chosen[:, :3] @ chosen[:, :3].T)[np.triu_indices(3, 1)]
            if dots.max() < np.sin(np.radians(SQUARE_DEG)):
                return intersect(chosen[:, :3], -chosen[:, 3]), chosen[:, :3]
    return None


def jig_like(points_mm: NDArray, jig: Jig) -> NDArray | None:
    """What a jig would show around a convex corner of the object, or None where there is none.

    Of a jig with three edges it is not known which edge is which, nor whether its faces are triangles: a box of the
    longest one is taken.
    """
    found = ransac_corner(points_mm, 4.0)
    if found is None:
        return None
    apex, normals = found
    edges = np.linalg.inv(normals)  # columns: along each two planes' common line
    edges /= np.linalg.norm(edges, axis=0)
    edges *= np.sign(edges[2])  # a convex corner's edges lead away from the camera
    along = (points_mm - apex) @ np.linalg.inv(edges).T
    inside = (along > -BESIDE_MM).all(axis=1)
    if isinstance(jig.edge_mm, tuple):
        inside &= (along < max(jig.edge_mm) + BESIDE_MM).all(axis=1)
    else:
        inside &= along.sum(axis=1) < jig.edge_mm
    each = [np.count_nonzero(inside & (np.abs(along[:, k]) < 4.0)) for k in range(3)]
    return points_mm[inside] if min(each) > 150 else None


def methods(jig: Jig, refused: list[str]) -> dict[str, Method]:
    """By name: points (N, 3) -> corner or None. This project's reasons for None go to `refused`."""

    def ours(points_mm: NDArray) -> NDArray | None:
        search = find_corner(Scan("box", points_mm), jig)
        if search.corner is None:
            refused.append(search.failure)
            return None
        return search.corner.xyz_mm

    def peer(threshold_mm: float) -> Method:
        def corner(points_mm: NDArray) -> NDArray | None:
            found = ransac_corner(points_mm, threshold_mm)
            return None if found is None else found[0]

        return corner

    return {"this project": ours} | {f"Open3D {t:g} mm": peer(t) for t in PEER_MM}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="half-split repeatability of the corners of real boxes")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--edge-mm", type=float, nargs="+", default=[70.0], help="one, or three of a box")
    parser.add_argument("--files", type=int, default=49)
    parser.add_argument("--splits", type=int, default=4)
    arguments = parser.parse_args()
    if len(arguments.edge_mm) not in (1, 3) or min(arguments.edge_mm) <= 0:
        parser.error("--edge-mm: give one length above 0, or three")
    jig = Jig(edge_mm=arguments.edge_mm[0] if len(arguments.edge_mm) == 1 else tuple(arguments.edge_mm))
    paths = sorted(arguments.folder.rglob("*.pcd"))[: arguments.files]
    crops = [crop for path in paths for o in objects(path) if (crop := jig_like(o, jig)) is not None]
    if not crops:
        sys.exit(f"{arguments.folder}: no box with three faces in {len(paths)} .pcd files; see --help")
    refused: list[str] = []
    by_name = methods(jig, refused)
    apart = {name: np.full((len(crops), arguments.splits), np.nan) for name in by_name}
    for i, crop in enumerate(crops):
        for k in range(arguments.splits):
            half = np.random.default_rng([i, k]).permutation(len(crop)) % 2 == 0
            for name, method in by_name.items():
                one, other = method(crop[half]), method(crop[~half])
                if one is not None and other is not None:
                    apart[name][i, k] = np.linalg.norm(one - other) / np.sqrt(2)
    mine = next(iter(apart))
    points = int(np.median([len(crop) for crop in crops]))
    print(
        f"{len(crops)} boxes in {len(paths)} scans, {points} points each at the median, {arguments.splits} splits"
    )
    print(
        f"{'method':14}{'found':>8}{'median mm':>11}{'RMS mm':>9}{'90 % mm':>9}   on what both found: ours / it, median"
    )
    for name, values in apart.items():
        got = values[np.isfinite(values)]
        both = np.isfinite(values) & np.isfinite(apart[mine])
        ratio = np.median(apart[mine][both]) / np.median(values[both]) if both.any() else np.nan
        print(
            f"{name:14}{len(got) / values.size:8.0%}{np.median(got) if len(got) else np.nan:11.3f}"
            f"{np.sqrt(np.mean(got**2)) if len(got) else np.nan:9.3f}"
            f"{np.quantile(got, 0.9) if len(got) else np.nan:9.3f}   {ratio:.2f} ({both.sum()})"
        )
    halves = 2 * len(crops) * arguments.splits
    print(f"of {halves} halves this project refused {len(refused)}")
    if refused:
        print(counted_reasons({str(k): reason for k, reason in enumerate(refused)}))


if __name__ == "__main__":
    main()
