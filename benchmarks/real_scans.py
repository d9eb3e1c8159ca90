"""Real scans of boxes, spheres and things without a corner: repeatability, radii by views, and what must be refused.

    python benchmarks/real_scans.py boxes FOLDER [--boxes 12] [--splits 2]
    python benchmarks/real_scans.py halves FOLDER --edge-mm 19 57 57 [--splits 2]
    python benchmarks/real_scans.py layers FOLDER
    python benchmarks/real_scans.py spheres FOLDER [--splits 4]
    python benchmarks/real_scans.py negatives FOLDER [FOLDER ...] [--edge-mm 57] [--scans 40]

The scans are read where they lie; none is part of this project. They are, on GitHub:

- PointCloudLibrary/data (BSD), folder segmentation/mOSD: the Modified Object Segmentation Database (Richtsfeld;
  Alexandrov), 111 scenes of a Kinect from a metre away, a label a point, 2 MB each. learn0 to learn24 and test0 to
  test23 are boxes: what `boxes` reads. The others have no box: learn33 to 44 and test31 to 42 are cylinders.
- Shiyu-Xing/RegHEC (MIT), folder data: 13 objects seen from 9 places each by a structured-light scanner on an arm, of
  0.2 MB. data/Sphere is what `spheres` reads; in all others is no corner of a jig of 57 mm, in data/Rubik neither: its
  middle layer is turned. But an outer layer is a box of 19 by 57 by 57 mm, with grooves: for `halves`.

`boxes`: each labelled box of which three faces are seen gets its edges from generous RANSAC planes (they are nowhere
told), then its points are split at random into halves; a corner is found in each half, by this project as for a target
of these three edges and by Open3D's RANSAC. The distance of the two over sqrt(2) is the repeatability of one. It says
how much of the error is noise of single points; what the camera bends, both halves share, so that the reported sigma,
which counts that too, may well be larger. A cardboard box's angles are 90 deg within one or so.
`halves` does the same with whole scans of one known target. `layers` finds the corners of both outer layers of the
cube: their distance is the same in every view, whatever the arm did (two thirds of the cube's edge along it, and some
millimetre across, as the layers are turned a little); beside it Open3D's, of the same points.

`spheres`: the centre in two halves beside its sigma, the radius by views, which is one sphere's, beside that of a plain
least-squares sphere. `negatives`: corners, which should be none, with the reasons counted and the time.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator
from itertools import combinations
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from calib.corners.intersection import Corner, intersect  # noqa: E402
from calib.corners.search import find_corner  # noqa: E402
from calib.jig import Jig  # noqa: E402
from calib.measurement.measured_points import counted_reasons  # noqa: E402
from calib.scans.scan import Scan, load_scan  # noqa: E402
from calib.statistics import rms  # noqa: E402
from calib.target_shapes import Sphere  # noqa: E402
from calib.targets.spheres.sphere_finder import find_spheres  # noqa: E402

FIRST_OBJECT = 20  # labels below are the table's
SQUARE_DEG = 8.0  # a Kinect bends planes
FACE_POINTS = 150  # of each face, in the whole scan
BESIDE_MM = 10.0  # points of a box farther out than that are another's
PEER_MM = (1.0, 1.5, 2.0, 3.0, 5.0)  # RANSAC's threshold
METRES_BELOW = 20.0  # a scan that is less wide is in metres


def in_mm(path: Path) -> NDArray:
    """(N, 3) mm of a scan in metres or millimetres."""
    points = load_scan(path).points_mm
    return points * (1000.0 if np.ptp(points, axis=0).max() < METRES_BELOW else 1.0)


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


def edges_of_box(points_mm: NDArray) -> tuple[float, float, float] | None:
    """The three edges of a box of which three faces are seen about one corner; None for anything else."""
    found = ransac_corner(points_mm, 4.0)
    if found is None:
        return None
    apex, normals = found
    edges = np.linalg.inv(normals)  # columns: along each two planes' common line
    edges /= np.linalg.norm(edges, axis=0)
    edges *= np.sign(edges[2])  # a convex corner's edges lead away from the camera
    along = (points_mm - apex) @ np.linalg.inv(edges).T
    near = (along > -BESIDE_MM).all(axis=1)
    if min(np.count_nonzero(near & (np.abs(along[:, k]) < 4.0)) for k in range(3)) < FACE_POINTS:
        return None
    first, last = np.quantile(along, [0.015, 0.985], axis=0)
    if first.min() < -BESIDE_MM or last.min() < 3 * BESIDE_MM:
        return None
    a, b, c = np.round(np.sort(last))
    return float(a), float(b), float(c)


def peer(threshold_mm: float) -> Callable[[NDArray], NDArray | None]:
    """Points (N, 3) -> corner or None, by Open3D."""

    def corner(points_mm: NDArray) -> NDArray | None:
        found = ransac_corner(points_mm, threshold_mm)
        return None if found is None else found[0]

    return corner


def boxes(folder: Path, most: int, splits: int) -> None:
    """Print how well two halves of one scan of a box agree."""
    paths = [folder.rglob(f"{name}{i}.pcd") for name, n in (("learn", 25), ("test", 24)) for i in range(n)]
    found = ((points, edges) for some in paths for path in some for points in objects(path)
             if (edges := edges_of_box(points)) is not None)  # fmt: skip
    compare([box for box, _ in zip(found, range(most), strict=False)], splits)


def halves(folder: Path, edges_mm: list[float], splits: int) -> None:
    """Print how well whole scans of one target agree."""
    edges = edges_of(edges_mm)
    compare([(in_mm(path), edges) for path in sorted(folder.glob("*.pcd"))], splits)


def layers(folder: Path) -> None:
    """Print the distance of two corners of one object in each view."""
    layer_mm, width_mm = 19.0, 57.0
    jig = Jig(edge_mm=(layer_mm, width_mm, width_mm))
    by_name: dict[str, list[float]] = {"this project": [], **{f"Open3D {t:g} mm": [] for t in PEER_MM}}
    for path in sorted(folder.glob("*.pcd")):
        points = in_mm(path)
        first = find_corner(Scan("layer", points), jig).corner
        for axis in range(3) if first is not None else ():
            along = edge_along(first, axis)
            height = (points - first.xyz_mm) @ along
            crops = [points[(height > low) & (height < high)] for low, high in ((-4, 23), (23, np.inf))]
            second = find_corner(Scan("layer", crops[1]), jig).corner if len(crops[1]) > 800 else None
            apart = 0.0 if second is None else float(np.linalg.norm(second.xyz_mm - first.xyz_mm))
            if second is None or not 36.0 < apart < 41.0:
                continue
            if max(abs(edge_along(second, k) @ along) for k in range(3)) < 0.99:
                continue
            sigma = np.hypot(first.sigma_mm(), second.sigma_mm())
            print(f"{path.stem}: {apart:.3f} mm apart; reported sigma {sigma:.2f} mm", flush=True)
            by_name["this project"].append(apart)
            for threshold in PEER_MM:
                pair = [peer(threshold)(crop) for crop in crops]
                if pair[0] is not None and pair[1] is not None:
                    by_name[f"Open3D {threshold:g} mm"].append(float(np.linalg.norm(pair[0] - pair[1])))
    for name, values in by_name.items():
        middle, scatter = (np.mean(values), np.std(values, ddof=1)) if len(values) > 1 else (np.nan, np.nan)
        print(f"{name:14} {len(values)} views, {middle:.2f} mm, standard deviation {scatter:.3f}")


def edge_along(corner: Corner, axis: int) -> NDArray:
    """(3,) unit, from the apex along the edge that leaves face `axis`."""
    normals = np.array([face.normal for face in corner.faces])
    along = np.cross(normals[(axis + 1) % 3], normals[(axis + 2) % 3])
    return along * -np.sign(along @ normals[axis]) / np.linalg.norm(along)


def edges_of(edges_mm: list[float]) -> tuple[float, float, float]:
    """Three edges, from one given for all or from three."""
    a, b, c = edges_mm * 3 if len(edges_mm) == 1 else edges_mm
    return a, b, c


def compare(crops: list[tuple[NDArray, tuple[float, float, float]]], splits: int) -> None:
    """Print the table for these points (N, 3) and edges."""
    if not crops:
        sys.exit("no box with three faces there; see --help for the scans that this wants")
    peers = {f"Open3D {t:g} mm": peer(t) for t in PEER_MM}
    apart = {name: np.full((len(crops), splits), np.nan) for name in ["this project", *peers]}
    told, seconds, refused = [], [], {}
    for i, (points, edges) in enumerate(crops):
        for k in range(splits):
            half = np.random.default_rng([i, k]).permutation(len(points)) % 2 == 0
            start = time.perf_counter()
            ours = [find_corner(Scan("box", points[side]), Jig(edge_mm=edges)) for side in (half, ~half)]
            seconds.append((time.perf_counter() - start) / 2)
            refused |= {f"{i}.{k}.{n}": s.failure for n, s in enumerate(ours) if s.corner is None}
            corners = [search.corner for search in ours if search.corner is not None]
            told += [corner.sigma_mm() for corner in corners]
            pairs = {"this project": [corner.xyz_mm for corner in corners]}
            pairs |= {name: [c for side in (half, ~half) if (c := method(points[side])) is not None]
                      for name, method in peers.items()}  # fmt: skip
            for name, pair in pairs.items():
                if len(pair) == 2:
                    apart[name][i, k] = np.linalg.norm(pair[0] - pair[1]) / np.sqrt(2)
    print(f"{len(crops)} boxes, {splits} splits, {int(np.median([len(p) for p, _ in crops])) // 2} points a half")
    print(f"{'method':14}{'both found':>11}{'median mm':>11}{'RMS mm':>9}   ours / it where both found, median")
    for name, values in apart.items():
        got = values[np.isfinite(values)]
        both = np.isfinite(values) & np.isfinite(apart["this project"])
        ratio = np.median(apart["this project"][both]) / np.median(values[both]) if both.any() else np.nan
        middle, size = (np.median(got), rms(got)) if len(got) else (np.nan, np.nan)
        print(f"{name:14}{len(got) / values.size:11.0%}{middle:11.3f}{size:9.3f}   {ratio:.2f} ({both.sum()})")
    print(f"reported sigma of a half's corner, median: {np.median(told) if told else np.nan:.3f} mm")
    print(f"{len(refused)} of {2 * splits * len(crops)} halves refused; {took(seconds)} a half")
    if refused:
        print(counted_reasons(refused))


def spheres(folder: Path, splits: int) -> None:
    """Print the centres of halves and the radii of views of one sphere."""
    views = [in_mm(path) for path in sorted(folder.glob("*.pcd"))]
    if not views:
        sys.exit(f"{folder}: no .pcd; see --help for the scans that this wants")
    whole = [find_spheres(Scan("sphere", points), Sphere())[0] for points in views]
    radii = np.array([found.radius_mm for found in whole])
    plain = np.array([plain_radius(points) for points in views])
    points_each = int(np.median([len(points) for points in views]))
    rms = [found.rms_mm for found in whole]
    print(f"{len(views)} views, {points_each} points each; rms about the sphere {min(rms):.3f} to {max(rms):.3f} mm")
    print(f"radius by views: {radii.mean():.3f} mm, standard deviation {radii.std(ddof=1):.3f} mm; ", end="")
    print(f"by plain least squares of all points {plain.std(ddof=1):.3f}")
    apart, told = [], []
    for i, points in enumerate(views):
        for k in range(splits):
            half = np.random.default_rng([i, k]).permutation(len(points)) % 2 == 0
            one, other = (find_spheres(Scan("half", points[side]), Sphere())[0] for side in (half, ~half))
            apart.append(np.linalg.norm(one.xyz_mm - other.xyz_mm) / np.sqrt(2))
            told.append(one.sigma_mm())
    print(
        f"centre by halves: RMS {np.sqrt(np.mean(np.square(apart))):.4f} mm; reported sigma, which counts smooth ",
        end="",
    )
    print(f"errors that halves share: {np.median(told):.4f} mm")


def plain_radius(points_mm: NDArray) -> float:
    """Radius of the algebraic least-squares sphere through all points (N, 3)."""
    rows = np.column_stack([2 * points_mm, np.ones(len(points_mm))])
    solution = np.linalg.lstsq(rows, (points_mm**2).sum(axis=1), rcond=None)[0]
    return float(np.sqrt(solution[3] + solution[:3] @ solution[:3]))


def took(seconds: list[float]) -> str:
    """The middle and the longest time, in words."""
    return f"{np.median(seconds):.1f} s, at most {max(seconds):.1f} s,"


def negatives(folders: list[Path], edges_mm: list[float], most: int) -> None:
    """Print corners where there are none."""
    jig = Jig(edge_mm=edges_mm[0] if len(edges_mm) == 1 else edges_of(edges_mm))
    for folder in folders:
        paths = sorted(p for p in folder.rglob("*") if p.suffix in (".pcd", ".ply", ".e57"))[:most]
        seconds, found, refused = [], [], {}
        for path in paths:
            start = time.perf_counter()
            search = find_corner(Scan(path.stem, in_mm(path)), jig)
            seconds.append(time.perf_counter() - start)
            if search.corner is None:
                refused[path.stem] = search.failure
            else:
                found.append(path.stem)
        if paths:
            print(f"{folder.name}: {len(found)} corners in {len(paths)} scans {found}; {took(seconds)} a scan")
            print(f"  {counted_reasons(refused)}" if refused else "", flush=True)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["boxes", "halves", "layers", "spheres", "negatives"])
    parser.add_argument("folder", type=Path, nargs="+")
    parser.add_argument("--boxes", type=int, default=12)
    parser.add_argument("--splits", type=int, default=2)
    parser.add_argument("--scans", type=int, default=40)
    parser.add_argument("--edge-mm", type=float, nargs="+", default=[57.0], help="one, or three")
    arguments = parser.parse_args()
    if len(arguments.edge_mm) not in (1, 3) or min(arguments.edge_mm) <= 0:
        parser.error("--edge-mm: give one length above 0, or three")
    if arguments.what == "boxes":
        boxes(arguments.folder[0], arguments.boxes, arguments.splits)
    elif arguments.what == "halves":
        halves(arguments.folder[0], arguments.edge_mm, arguments.splits)
    elif arguments.what == "layers":
        layers(arguments.folder[0])
    elif arguments.what == "spheres":
        spheres(arguments.folder[0], arguments.splits)
    else:
        negatives(arguments.folder, arguments.edge_mm, arguments.scans)


if __name__ == "__main__":
    main()
