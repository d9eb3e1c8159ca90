"""Errors of the jig's orientation over the Cramer-Rao bound, and whether its covariance is honest.

    python benchmarks/orientation.py [--scans 20] [--points 12000 50000 200000] [--cases NAME ...]

Scans are those of the product's simulator (`calib.simulation.scanner`): a jig 60 mm along its edges some 700 mm away,
tilted by up to 22 degrees, with flange, arm, wall and table, noise along the ray of
0.02 mm (0.5 + 0.5 / cos^2 incidence), flying pixels and dropouts. The bound of each scan is that of three planes whose
offsets are free and whose normals stand as the jig's angles say, every point of a face weighted by its true noise; it
does not know of a smooth error ("waves"). Columns:

    bound       median over the scans, microrad (all three axes together)
    RMS/bound   root mean square over the scans of error over bound: 1 is the best there is
    NEES        mean squared error in units of the reported covariance: 3 is honest
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy and Open3D are loaded

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from calib.corners.orientation import candidates  # noqa: E402
from calib.corners.search import find_corner  # noqa: E402
from calib.frames import make_transform  # noqa: E402
from calib.jig import Jig, jig_normals  # noqa: E402
from calib.simulation.scanner import ScanModel, SimulatedScan, simulate_scan  # noqa: E402

CASES = {
    "square": (Jig(), ScanModel()),
    "concave": (Jig(convex=False), ScanModel()),
    "angles 88, 91, 90.5": (Jig(face_angles_deg=(88.0, 91.0, 90.5)), ScanModel()),
    "the same, certified": (Jig(face_angles_deg=(88.0, 91.0, 90.5), certified=True), ScanModel()),
    "waves 0.02/15 mm": (Jig(), ScanModel(correlated_sigma_mm=0.02)),
}


def scan_of(jig: Jig, model: ScanModel, rng: np.random.Generator) -> SimulatedScan:
    """A scan of the jig, tilted by up to 22 degrees from the line of sight and turned anyhow about it."""
    tilt, azimuth, spin = rng.uniform(0, np.radians(22)), *rng.uniform(0, 2 * np.pi, 2)
    turn = Rotation.from_rotvec(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
    place = np.array([*rng.uniform(-20, 20, 2), rng.uniform(680, 720)])
    scanner_T_jig = make_transform((turn * Rotation.from_euler("z", spin)).as_matrix(), place)
    return simulate_scan(scanner_T_jig, jig, rng=rng, model=model)


def bound_covariance(seen: SimulatedScan) -> NDArray:
    """(3, 3) rad^2: least covariance of a small turn, by the points' true noise; each plane's height is free."""
    information = np.zeros((3, 3))
    for face, normal in enumerate(seen.normals, start=1):
        on = seen.label == face
        points = seen.scan.points_mm[on]
        cosine = np.abs(points @ normal) / np.linalg.norm(points, axis=1)
        weight = 1.0 / (seen.noise_sigma_mm[on] * cosine) ** 2
        centred = points - weight @ points / weight.sum()
        rows = np.cross(centred, normal)  # a turn w lifts the plane at p by (w x p) . n = w . (p x n)
        information += rows.T @ (weight[:, None] * rows)
    return np.linalg.inv(information)


def true_rotation(seen: SimulatedScan, jig: Jig) -> NDArray:
    """scanner_R_jig (3, 3) of the frame that `calib.corners.orientation` defines."""
    return np.asarray(seen.normals.T @ np.linalg.inv(jig_normals(jig.face_angles_deg)))


def lines(names: list[str], points: list[int], scans: int) -> Iterator[str]:
    """The table."""
    yield f"{'case':22}{'points':>9}{'scans':>7}{'bound urad':>12}{'RMS/bound':>11}{'NEES':>8}{'+-':>6}{'failed':>8}"
    for name in names:
        jig, model = CASES[name]
        for count in points:
            ratio, nees, bounds = [], [], []
            for seed in range(scans):
                rng = np.random.default_rng([seed, count, *name.encode()])
                seen = scan_of(jig, ScanModel(count, correlated_sigma_mm=model.correlated_sigma_mm), rng)
                corner = find_corner(seen.scan, jig, scan_sigma_mm=0.02).corner
                if corner is None:
                    continue
                truth = true_rotation(seen, jig)
                errors = [Rotation.from_matrix(truth @ o.scanner_R_jig.T).as_rotvec() for o in candidates(corner, jig)]
                best = int(np.argmin([np.linalg.norm(error) for error in errors]))
                error, found = errors[best], candidates(corner, jig)[best]
                bounds.append(np.sqrt(np.trace(bound_covariance(seen))))
                ratio.append(np.linalg.norm(error) / bounds[-1])
                nees.append(error @ np.linalg.solve(found.covariance_rad2, error))
            rms = np.sqrt(np.mean(np.square(ratio)))
            yield (
                f"{name:22}{count:9}{len(ratio):7}{1e6 * np.median(bounds):12.2f}{rms:11.2f}"
                f"{np.mean(nees):8.2f}{np.std(nees) / np.sqrt(len(nees)):6.2f}{scans - len(ratio):8}"
            )


def main() -> None:
    """Print the table, a line as soon as it is known."""
    parser = argparse.ArgumentParser(description="the jig's orientation against the Cramer-Rao bound")
    parser.add_argument("--scans", type=int, default=20, help="scans a case and size")
    parser.add_argument("--points", type=int, nargs="*", default=[12_000, 50_000, 200_000])
    parser.add_argument("--cases", nargs="*", default=list(CASES), choices=list(CASES), metavar="NAME")
    arguments = parser.parse_args()
    for line in lines(arguments.cases, arguments.points, arguments.scans):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
