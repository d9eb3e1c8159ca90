"""Corners with the angles and bows that all scans of a jig tell, beside free planes and two kinds of ICP to CAD.

    python benchmarks/jig_angles.py [--scans 24] [--points 14000]

Scans are those of the tests' ray caster (tests/support/scan_scene.py), of a square jig and of one whose angles are off
by 0.03 and 0.1 degrees, with white noise and with an error that is smooth over 22 mm besides; then of a square jig
whose faces are bowed by 0.05 mm. All methods see the same scans. Columns, each the median and the RMS of the errors in
mm, and the mean squared error over the covariance (3 is honest):

    free    three planes by themselves
    one     the jig's angles as far as each scan agrees with them: `find_corner`
    set     the angles, and the bows, that all scans tell: `find_corners`
    GICP    to points on the faces of the square CAD model, from a start within 4 mm and some 4 degrees, of a crop about
            the jig: by small_gicp where it is installed, else not shown
    ICP     the same by Open3D: point to plane, with Tukey's weights
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import dataclass
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is loaded

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from calib.corners.batch import of_one_jig  # noqa: E402
from calib.corners.intersection import Corner  # noqa: E402
from calib.corners.jig_angles import with_common_angles  # noqa: E402
from calib.corners.search import find_corner  # noqa: E402
from calib.jig import Jig, jig_normals  # noqa: E402
from calib.statistics import rms  # noqa: E402
from tests.support.scan_scene import SceneScan, jig_rotation, make_scene  # noqa: E402

EDGE_MM = 60.0
OFF = np.array([0.8, -1.0, 0.5])  # of the three angles, in units of the largest
CASES = {
    f"{off} deg off, {'smooth' if waves else 'white'}": (off, waves, (0.0, 0.0, 0.0))
    for off in (0.0, 0.03, 0.1)
    for waves in (0.0, 0.03)
} | {
    f"{name}, {'smooth' if waves else 'white'}": (0.0, waves, bows_mm)
    for name, bows_mm in {"raised": (0.05,) * 3, "sunk": (-0.05,) * 3, "various": (0.05, -0.03, 0.02)}.items()
    for waves in (0.0, 0.03)
}
STEPS_MM = (6.0, 2.0, 0.5, 0.2)  # distances of corresponding points, of one run of GICP after the other


def scene(seed: int, points: int, off_deg: float, waves_mm: float, bows_mm: tuple[float, float, float]) -> SceneScan:
    """Scan of a jig in any attitude whose angles are off by up to so much, and whose faces are bowed."""
    rng = np.random.default_rng([seed, points])
    square = jig_rotation(rng.uniform(0, 22), rng.uniform(0, 360), rng.uniform(0, 120))
    one, two, three = (90 + off_deg * OFF).tolist()
    edges = np.linalg.inv(jig_normals((one, two, three)))  # columns, each in two of the faces
    rotation = square @ (edges / np.linalg.norm(edges, axis=0))
    return make_scene(
        rng, points, rotation=rotation, waves_mm=waves_mm, wave_length_mm=22.0, wave_kernel="measured", bows_mm=bows_mm
    )


@dataclass(frozen=True)
class Registration:
    """What an ICP is given: points on the CAD model about its apex, and those of the scan about the true one."""

    cad: NDArray
    cad_normals: NDArray
    points: NDArray
    start: NDArray  # (4, 4) from scan to model

    @staticmethod
    def of(made: SceneScan, seed: int) -> Registration:
        """Crop about the jig, and a start within 4 mm and some 4 degrees."""
        rng = np.random.default_rng(seed)
        steps = (np.arange(120) + 0.5) / 120
        along = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        along = EDGE_MM * along[along.sum(axis=1) < 1]
        left, _, right = np.linalg.svd(-np.linalg.inv(made.normals))
        edges = (left @ right).T  # of the square jig nearest to the true one
        way = rng.standard_normal(3)
        start = np.eye(4)
        start[:3, :3] = Rotation.from_rotvec(np.radians(2) * rng.standard_normal(3)).as_matrix()
        start[:3, 3] = way / np.linalg.norm(way) * rng.uniform(0, 4)
        points = made.scan.points_mm - made.apex_mm
        return Registration(
            np.vstack([along @ np.delete(edges, face, axis=0) for face in range(3)]),
            np.repeat(edges, len(along), axis=0),
            points[np.linalg.norm(points, axis=1) < 1.02 * EDGE_MM],
            start,
        )


def by_small_gicp(case: Registration) -> NDArray | None:
    """Error (3,) of the apex by small_gicp; None where it is not installed."""
    try:
        import small_gicp
    except ImportError:
        return None
    model, tree = small_gicp.preprocess_points(case.cad, downsampling_resolution=0.3, num_neighbors=20)
    cloud, _ = small_gicp.preprocess_points(case.points, downsampling_resolution=0.3, num_neighbors=20)
    found = case.start
    for step_mm in STEPS_MM:
        found = small_gicp.align(
            model,
            cloud,
            tree,
            init_T_target_source=found,
            registration_type="GICP",
            max_correspondence_distance=step_mm,
        ).T_target_source
    return np.asarray(np.linalg.inv(found)[:3, 3])


def by_open3d(case: Registration) -> NDArray:
    """Error (3,) of the apex by Open3D's ICP of points to planes."""
    import open3d

    lib = open3d.pipelines.registration
    model, cloud = (open3d.geometry.PointCloud(open3d.utility.Vector3dVector(p)) for p in (case.cad, case.points))
    model.normals = open3d.utility.Vector3dVector(case.cad_normals)
    found = case.start
    for step_mm in STEPS_MM:
        method = lib.TransformationEstimationPointToPlane(lib.TukeyLoss(k=max(step_mm / 2, 0.2)))
        found = lib.registration_icp(cloud, model, step_mm, found, method).transformation
    return np.asarray(np.linalg.inv(found)[:3, 3])


def cell(errors_mm: list[NDArray], corners: list[Corner] | None = None) -> str:
    """Median and RMS of errors (3,), and their mean square over the covariance of corners."""
    if not errors_mm:
        return f"{'-':>24}"
    sizes = np.linalg.norm(errors_mm, axis=1)
    squared = "" if corners is None else np.mean(
        [e @ np.linalg.solve(c.covariance_mm2, e) for e, c in zip(errors_mm, corners, strict=True)]
    )  # fmt: skip
    shown = f"{squared:6.2f}" if squared != "" else ""
    return f"{np.median(sizes):9.4f}{rms(sizes):9.4f}{shown:>6}"


def row(name: str, scans: int, points: int) -> str:
    """Line of the table for one case, and what the scans tell of the angles."""
    made = {str(seed): scene(seed, points, *CASES[name]) for seed in range(scans)}
    searches = {key: find_corner(one.scan, Jig(), scan_sigma_mm=0.02) for key, one in made.items()}
    found = {key: search.corner for key, search in searches.items() if search.corner is not None}
    told, angles, bows = of_one_jig(searches, Jig())
    common = {key: search.corner for key, search in told.items() if search.corner is not None}
    kinds = ({key: corner.free or corner for key, corner in found.items()}, found, common)
    cells = [cell([c.xyz_mm - made[key].apex_mm for key, c in kind.items()], list(kind.values())) for kind in kinds]
    cases = [Registration.of(one, int(key)) for key, one in made.items()]
    gicp = cell([error for error in map(by_small_gicp, cases) if error is not None])
    icp = cell([by_open3d(case) for case in cases])
    doubts = [c.quality.doubts() for c in with_common_angles(found, Jig(certified=True))[0].values()]
    warned = sum(any("contradict the certified" in doubt for doubt in told) for told in doubts)
    jig = f"{len(found)} of {scans}; {angles!r}; {bows!r}; certified: {warned} warned"
    return f"{name:24}{''.join(cells)}{gicp}{icp}  {jig}"


def main() -> None:
    """Print the table, a line as soon as it is known."""
    parser = argparse.ArgumentParser(description="corners with the angles that all scans tell")
    parser.add_argument("--scans", type=int, default=24)
    parser.add_argument("--points", type=int, default=14_000)
    asked = parser.parse_args()
    sys.stdout.write(f"{'':24}" + "".join(f"{name:>24}" for name in ("free", "one", "set", "GICP", "ICP")) + "\n")
    for name in CASES:
        sys.stdout.write(row(name, asked.scans, asked.points) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
