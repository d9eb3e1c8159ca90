"""The noise of real scanners: how the errors of points are alike, by the distance between them.

    python benchmarks/real_noise.py sheet FOLDER      # views of one flat sheet, such as data/Plane of Shiyu-Xing/RegHEC
    python benchmarks/real_noise.py planes FILE ... [--within-mm 10]

The scans are public and read where they lie: see `real_scans.py`; also tests/test_data of davidcaron/pye57 (a room by a
terrestrial laser scanner), AnalyzeStaticScene of sick-appspace-samples (time of flight; public domain) and
tutorials/table_scene_mug_stereo_textured.pcd of PointCloudLibrary/data.

What is left about a plane is the scanner's error and the surface's own shape, and one scan cannot tell the two apart.
Several views can: `sheet` lays the views of one sheet over each other, by its outline and by a turn and a shift that
make what is left most alike. What all views agree on is the sheet; half the variance of what two views differ by is the
scanner's. A misfit of the laying adds to it, so its smooth part is an upper bound. `planes` fits the largest plane,
once plain and once with a parabola, which leaves less of the surface's shape and of the smooth errors both.
"""

from __future__ import annotations

import argparse
import os
import sys
from itertools import combinations, pairwise
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, cKDTree

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.real_scans import in_mm  # noqa: E402

LESS_THAN_MM = np.array([3.0, 6.0, 12.0, 24.0, 48.0, 96.0])  # distances' bins, the first from 1.5
PAIRS = 400_000
STARTS_MM = np.arange(-45.0, 46.0, 6.0)  # of shifts along the sheet, of which a view may show one end only


def flattened(points_mm: NDArray) -> tuple[NDArray, NDArray]:
    """Places (N, 2) on the plane through the points, and heights (N,) above it away from the scanner."""
    centre = points_mm.mean(axis=0)
    across = np.linalg.svd(points_mm - centre, full_matrices=False)[2]
    normal = across[2] * np.sign(across[2] @ centre)
    axes = np.stack([across[0], np.cross(normal, across[0])])
    return (points_mm - centre) @ axes.T, (points_mm - centre) @ normal


def left_over(places: NDArray, heights: NDArray, *, parabola: bool = False) -> NDArray:
    """(N,) heights less the plane, or the parabola, that fits them best."""
    x, y = places.T
    columns = [np.ones(len(x)), x, y, *([x * x, x * y, y * y] if parabola else [])]
    design = np.column_stack(columns)
    return heights - design @ np.linalg.lstsq(design, heights, rcond=None)[0]


def without_strays(places: NDArray, heights: NDArray, *, parabola: bool = False) -> tuple[NDArray, NDArray]:
    """Places and what is left over, without points beyond five standard deviations."""
    for _ in range(4):
        values = left_over(places, heights, parabola=parabola)
        near = np.abs(values) < 5 * 1.4826 * np.median(np.abs(values))
        places, heights = places[near], heights[near]
    return places, left_over(places, heights, parabola=parabola)


def correlation(places: NDArray, values: NDArray) -> NDArray:
    """(6,) of the values of two points, by distance in LESS_THAN_MM."""
    rng = np.random.default_rng(0)
    tree = cKDTree(places)
    some = rng.choice(len(places), min(len(places), 3000), replace=False)
    one, other = [rng.integers(0, len(places), PAIRS)], [rng.integers(0, len(places), PAIRS)]
    for reach in LESS_THAN_MM[:4]:  # random pairs are seldom near
        for i, near in zip(some, tree.query_ball_point(places[some], reach), strict=True):
            chosen = rng.choice(near, min(len(near), 40), replace=False)
            one.append(np.full(len(chosen), i))
            other.append(chosen)
    i, j = np.concatenate(one), np.concatenate(other)
    apart = np.linalg.norm(places[i] - places[j], axis=1)
    bins = np.concatenate([[1.5], LESS_THAN_MM])
    products = (values[i] - values.mean()) * (values[j] - values.mean()) / values.var()
    return np.array([
        products[inside].mean() if np.count_nonzero(inside := (apart >= low) & (apart < high)) > 300 else np.nan
        for low, high in pairwise(bins)
    ])  # fmt: skip


def upright(places: NDArray) -> NDArray:
    """The places turned and moved so that the smallest rectangle about them lies along the axes, its long side on x."""
    hull = places[ConvexHull(places).vertices]
    turns = np.radians(np.arange(0.0, 90.0, 0.25))
    rotations = np.stack([np.cos(turns), -np.sin(turns), np.sin(turns), np.cos(turns)], axis=1).reshape(-1, 2, 2)
    turned = hull @ rotations
    best = int(np.argmin(np.ptp(turned, axis=1).prod(axis=1)))
    moved = places @ rotations[best] - (turned[best].max(axis=0) + turned[best].min(axis=0)) / 2
    return moved if np.ptp(moved[:, 0]) > np.ptp(moved[:, 1]) else np.column_stack([moved[:, 1], -moved[:, 0]])


def difference(
    tree: cKDTree, one: NDArray, places: NDArray, other: NDArray
) -> tuple[NDArray, NDArray, float, float] | None:
    """Comparison of two maps laid over each other: common places, difference, correlation, rms of each.

    one, other  # (N,) (M,) heights at the tree's places and at `places`
    """
    near, index = tree.query(places, k=4)
    ok = near[:, -1] < 5.0
    if np.count_nonzero(ok) < 2000:
        return None
    weights = 1.0 / (near[ok] + 0.3)
    first = left_over(places[ok], (one[index[ok]] * weights).sum(axis=1) / weights.sum(axis=1))
    second = left_over(places[ok], other[ok])
    rms = float(np.sqrt((first.var() + second.var()) / 2))
    return places[ok], left_over(places[ok], first - second), float(np.corrcoef(first, second)[0, 1]), rms


def laid_over(
    one: tuple[NDArray, NDArray], other: tuple[NDArray, NDArray]
) -> tuple[NDArray, NDArray, float, float] | None:
    """`difference` after the turn and the shift that make it smallest."""
    tree = cKDTree(one[0])

    def moved(by: NDArray, sign: float, step: int) -> NDArray:
        cosine, sine = np.cos(by[2]), np.sin(by[2])
        return sign * other[0][::step] @ np.array([[cosine, -sine], [sine, cosine]]).T + by[:2]

    def cost(by: NDArray, sign: float, step: int = 5) -> float:
        found = difference(tree, one[1], moved(by, sign, step), other[1][::step])
        return float("inf") if found is None else float(found[1].std())

    starts = [(cost(np.array([x, 0.0, 0.0]), sign), x, sign) for sign in (1.0, -1.0) for x in STARTS_MM]
    best, x, sign = min(starts)
    if not np.isfinite(best):
        return None
    simplex = np.array([[x, 0, 0], [x + 4, 0, 0], [x, 3, 0], [x, 0, 0.02]])
    options = {"initial_simplex": simplex, "maxfev": 80, "xatol": 1e-3, "fatol": 1e-5}
    solved = minimize(cost, simplex[0], (sign,), method="Nelder-Mead", options=options)
    return difference(tree, one[1], moved(solved.x, sign, 1), other[1])


def row(name: str, rms_mm: float, places: NDArray, values: NDArray) -> str:
    """A line of the table."""
    return f"{name:34}{rms_mm:8.3f}   " + " ".join(f"{c:6.2f}" for c in correlation(places, values))


def sheet(folder: Path) -> None:
    """Print what one view shows, and what two views differ by."""
    views = []
    for path in sorted(folder.glob("*.pcd")):
        places, heights = flattened(in_mm(path))
        places, heights = without_strays(places, heights)
        print(row(f"one view, {path.stem}", heights.std(), places, heights))
        views.append((upright(places), heights))
    differences = []
    for i, j in combinations(range(len(views)), 2):
        found = laid_over(views[i], views[j])
        if found is not None and found[2] > 0.5:
            places, apart, alike, rms = found
            name = f"{i + 1} less {j + 1}: alike {alike:.2f}, rms {rms:.2f}"
            print(row(name, apart.std() / np.sqrt(2), places, apart), flush=True)
            differences.append([apart.std() / np.sqrt(2), *correlation(places, apart)])
    if differences:
        rms, *alike = np.nanmedian(differences, axis=0)
        print(f"{f'median of {len(differences)} pairs':34}{rms:8.3f}   " + " ".join(f"{c:6.2f}" for c in alike))


def largest_plane(points_mm: NDArray, within_mm: float) -> NDArray:
    """The points (N, 3) of the plane that has most of them, by Open3D."""
    import open3d

    open3d.utility.random.seed(0)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points_mm))
    return points_mm[cloud.segment_plane(within_mm, 3, 1000)[1]]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["sheet", "planes"])
    parser.add_argument("paths", type=Path, nargs="+")
    parser.add_argument("--within-mm", type=float, default=10.0)
    arguments = parser.parse_args()
    print(
        f"{'':34}{'rms mm':>8}   correlation at 1.5 to 3, then below " + ", ".join(f"{d:g}" for d in LESS_THAN_MM[1:])
    )
    for path in arguments.paths:
        if arguments.what == "sheet":
            sheet(path)
            continue
        places, heights = flattened(largest_plane(in_mm(path), arguments.within_mm))
        for parabola in (False, True):
            on, values = without_strays(places, heights, parabola=parabola)
            name = f"{path.stem[:20]}{', parabola' if parabola else ''}"
            print(row(name, values.std(), on, values), flush=True)


if __name__ == "__main__":
    main()
