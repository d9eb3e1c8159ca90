"""Poses called measurable beside MuJoCo's rays and distances: `python benchmarks/measurable_poses.py [--places N]`.

The scanner stands in its usual place and in N drawn ones, so that arm, table and post are often in between. *hidden*:
poses called measurable at which a ray to a face meets something, or bodies meet. *too strict*: of poses that are
refused for arm or boxes, those in which MuJoCo finds nothing.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calib.dataset.dataset import Surroundings
from calib.workcell.candidates import candidate_poses, likely_poses
from calib.workcell.known_cell import workcell_of_robot
from calib.workcell.measurable import BOX, BOX_HIDES, FLOOR, HIDDEN, SELF, measurable
from calib.workcell.order import order_poses, way_lengths
from tests.support.checked_cells import ARMS, BOXES, in_mujoco, is_fine, looking_from

IN_THE_WAY = (SELF, HIDDEN, BOX, BOX_HIDES, FLOOR)
CANDIDATES = 800


def main() -> None:
    """Print one line for each arm."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--places", type=int, default=25, help="drawn places of the scanner, each arm")
    places = parser.parse_args().places
    print(f"{'arm':<8} {CANDIDATES} poses  order 60: before  after   measurable  hidden   refused  too strict")
    for name, robot in ARMS.items():
        rng = np.random.default_rng(5)
        cell = workcell_of_robot(robot, surroundings=Surroundings(-400.0, BOXES))
        start = time.perf_counter()
        q = candidate_poses(cell, CANDIDATES, rng=rng)
        seconds = time.perf_counter() - start
        some = q[:60]
        there, pairs = in_mujoco(cell)
        called = hidden = refused = strict = 0
        for placed in [cell, *(looking_from(cell, rng) for _ in range(places))]:
            assert placed.base_T_scanner is not None
            eye_mm = placed.base_T_scanner[:3, 3]
            likely = likely_poses(placed, rng)
            judged = measurable(placed, likely)
            for row in np.flatnonzero(judged.ok)[:40]:
                called += 1
                hidden += not is_fine(there, pairs, likely[row], eye_mm)
            for row in np.flatnonzero(np.isin(judged.reason, IN_THE_WAY))[:40]:
                refused += 1
                strict += is_fine(there, pairs, likely[row], eye_mm)
        ways = [way_lengths(robot, q[:-1], q[1:]).trace() for q in (some, some[order_poses(cell, some)])]
        before, after = map(float, ways)
        print(
            f"{name:<8} {seconds:7.2f} s  {before:14.0f} rad {after:4.0f} rad {called:10d} {hidden:7d} "
            f"{refused:9d} {100 * strict / max(refused, 1):9.1f} %"
        )


if __name__ == "__main__":
    main()
