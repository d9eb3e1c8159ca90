"""Corners in the scans of a second, independent simulator: what is found, refused and wrong, kind by kind.

    python benchmarks/other_scanner.py [--scans 5] [--first 0] [--kinds NAME ...] [--tell]

Scans are those of tests/support/mesh_scene.py, kinds in tests/support/mesh_cases.py: triangle meshes of jigs with
chamfers, holes, stickers and base plates, in any attitude that shows three faces below 80 degrees, among robot,
brackets, cables and workshop; structured light with shadows, laser lines, time of flight, fused meshes; heavy tails,
steps of the depth, missing patches. In the kinds without three faces of a jig nothing is right but to refuse.

    points      median of the scans
    fair        scans with 40 points on each face and a third of each in view; columns after it count these alone
    found       corners; the rest of the fair ones was refused with a reason
    wrong       more than 5 of its own sigmas and more than 0.1 mm off, or a corner where there is no jig; of all scans
    RMS/bound   root mean square over the corners of error over the Cramer-Rao bound of three free planes
    middle      median of error over bound, which no single scan spoils
    Mahal.^2    mean squared error in units of the reported covariance: 3 is honest
    seconds     median and largest CPU time of one search

With --tell every scan is printed that was refused or wrong, or has a squared Mahalanobis error past 20.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy and Open3D are loaded

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from calib.corners.search import CornerSearch, find_corner  # noqa: E402
from calib.statistics import rms  # noqa: E402
from tests.support.mesh_cases import KINDS  # noqa: E402
from tests.support.mesh_scene import MeshScan  # noqa: E402


@dataclass(frozen=True)
class Outcome:
    """A corner search with the truth of its scan."""

    seed: int
    made: MeshScan
    search: CornerSearch
    cpu_s: float

    @property
    def found(self) -> bool:
        """Whether there is a corner."""
        return self.search.corner is not None

    @property
    def error_mm(self) -> float:
        """Distance from the true apex."""
        assert self.search.corner is not None
        return float(np.linalg.norm(self.search.corner.xyz_mm - self.made.apex_mm))

    @property
    def mahalanobis2(self) -> float:
        """Squared error in units of the covariance."""
        assert self.search.corner is not None
        error = self.search.corner.xyz_mm - self.made.apex_mm
        return float(error @ np.linalg.solve(self.search.corner.covariance_mm2, error))

    @property
    def wrong(self) -> bool:
        """A corner that nobody should believe."""
        if not self.found:
            return False
        return not self.made.has_jig or (self.mahalanobis2 > 25 and self.error_mm > 0.1)

    @property
    def odd(self) -> bool:
        """Worth a look: wrong, refused though fair, or far outside its own covariance."""
        return self.wrong or (self.mahalanobis2 > 20 if self.found else self.made.fair)

    def line(self, name: str) -> str:
        """Description of a scan and of what the search made of it."""
        made, said = self.made, self.search.failure
        if self.found:
            said = f"{'WRONG' if self.wrong else 'corner'} {self.error_mm:.4f} mm off, {self.mahalanobis2:.1f} squared"
            said += f", {self.error_mm / made.bound_mm:.1f} bounds" if made.has_jig else ""
        there = f"faces of {made.points_a_face.tolist()}, {made.seen.round(2).tolist()} in view"
        if not made.has_jig:
            there = "no jig"
        elif not made.fair:
            there += " (not fair)"
        degrees = made.incidence_deg.round().astype(int).tolist()
        return (
            f"    {name!r} seed {self.seed}: edge {made.edge_mm:.0f} at {degrees} deg, {len(made.label)} points, "
            f"{there}: {said}"
        )


def outcome(name: str, seed: int) -> Outcome:
    """Make one scan and search it."""
    made, jig, told = KINDS[name].scan(name, seed)
    started = time.process_time()
    search = find_corner(made.scan, jig, scan_sigma_mm=told)
    return Outcome(seed, made, search, time.process_time() - started)


def row(name: str, outcomes: list[Outcome]) -> str:
    """Line of the table for one kind of scan."""
    fair = [o for o in outcomes if o.made.fair]
    found = [o for o in fair if o.found]
    ratios = np.array([o.error_mm / o.made.bound_mm for o in found])
    squares = np.array([o.mahalanobis2 for o in found])
    seconds = [o.cpu_s for o in outcomes]
    size, middle, mean = (rms(ratios), np.median(ratios), squares.mean()) if found else (np.nan,) * 3
    return (
        f"{name:22}{np.median([len(o.made.label) for o in outcomes]):9.0f}{len(outcomes):7}{len(fair):6}{len(found):7}"
        f"{len(fair) - len(found):8}{sum(o.wrong for o in outcomes):7}{size:11.2f}{middle:8.2f}{mean:10.2f}"
        f"{np.median(seconds):9.2f}{max(seconds):7.1f}"
    )


def main() -> None:
    """Print the table, a line as soon as it is known."""
    parser = argparse.ArgumentParser(description="corners in scans of a second simulator")
    parser.add_argument("--scans", type=int, default=5, help="scans a kind")
    parser.add_argument("--first", type=int, default=0, help="seed of the first scan")
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=list(KINDS), metavar="NAME")
    parser.add_argument("--tell", action="store_true", help="print every scan that was refused or is odd")
    arguments = parser.parse_args()
    print(
        f"{'kind':22}{'points':>9}{'scans':>7}{'fair':>6}{'found':>7}{'failed':>8}{'wrong':>7}{'RMS/bound':>11}{'middle':>8}"
        f"{'Mahal.^2':>10}{'seconds':>9}{'most':>7}"
    )
    for name in arguments.kinds:
        outcomes = [outcome(name, seed) for seed in range(arguments.first, arguments.first + arguments.scans)]
        print(row(name, outcomes), flush=True)
        if arguments.tell:
            told = [o for o in outcomes if o.odd]
            print("".join(o.line(name) + "\n" for o in told), end="", flush=True)


if __name__ == "__main__":
    main()
