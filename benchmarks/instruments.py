"""How exact an arm becomes by ways of measuring that an owner can print, borrow or buy, judged at new poses.

    python benchmarks/instruments.py [--arms 6]

Each arm has six joints and links off by 0.3 mm and 0.02 deg (tests/support/scenarios/shop.py, whose kinematics share no
code with the product). Every way's files are imported as an owner's are, calibrated, and the calibrated arm is held
against the true one at 300 new poses, after the best placement of its base (3D RMSE): anywhere above the floor, and
with the tool less than 0.3 m above it, where the sockets lie.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calib import calibrate, load_dataset
from calib.array_types import Array
from calib.statistics import rms_length
from inspector.cli.parser import main
from tests.support.scenarios.scenarios import camera_files
from tests.support.scenarios.shop import (
    LIMITS_DEG,
    MARKER_M,
    Arm,
    Shop,
    above_table,
    in_sockets,
    marker_session,
    session,
)


def _sheet(shop: Shop, folder: Path) -> tuple[Arm, list[str], str]:
    shop.write(folder)
    return shop.arm, ["--from", str(folder)], "position"


def _sockets(seed: int, folder: Path, sigma_mm: float = 0.1, places: int = 4) -> tuple[Arm, list[str], str]:
    """Visits of a printed plate in whose sockets a ball sits to 0.05 mm, both declared."""
    arm, files, residual = _sheet(in_sockets(seed, sigma_mm=sigma_mm, places=places, seat_mm=SEAT_MM), folder)
    return arm, [*files, "--sigma", str(SEAT_MM), "--place-sigma", str(sigma_mm)], residual


def _camera(seed: int, folder: Path) -> tuple[Arm, list[str], str]:
    shop, seen = marker_session(seed, links=1.0)
    camera_files(shop, seen, folder)
    names = ("--robot", "arm.urdf", "--joints", "joints.csv", "--marker-poses", "marker.csv")
    files = [name if name.startswith("--") else str(folder / name) for name in names]
    return shop.arm, files, "pose"


ON_THE_BENCH_MM = 300.0
SEAT_MM = 0.05

WAYS: dict[str, Callable[[int, Path], tuple[Arm, list[str], str]]] = {
    "ball in 4 printed sockets (0.1 mm), 4 places, 96 visits": _sockets,
    "the same, 2 places, 48 visits": lambda s, f: _sockets(s, f, places=2),
    "the same 4 places, plate measured by caliper (0.02 mm)": lambda s, f: _sockets(s, f, sigma_mm=0.02),
    "camera and board, 40 poses (0.2 mm, 0.03 deg)": _camera,
    "scanner and jig, 40 poses (0.05 mm)": lambda s, f: _sheet(session(s, poses=40, sigma_mm=0.05), f),
    "laser tracker, 40 poses (0.03 mm)": lambda s, f: _sheet(session(s, poses=40), f),
    "laser tracker, 100 poses (0.03 mm)": lambda s, f: _sheet(session(s, poses=100), f),
    "ruler, 40 poses (1 mm)": lambda s, f: _sheet(session(s, poses=40, sigma_mm=1.0), f),
}


def after_best_placement_mm(found_mm: Array, true_mm: Array) -> float:
    """3D RMSE of points after the rigid motion that brings them closest."""
    one, other = found_mm - found_mm.mean(axis=0), true_mm - true_mm.mean(axis=0)
    u, _, vt = np.linalg.svd(one.T @ other)
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return rms_length(one @ turn - other)


def errors_mm(way: Callable[[int, Path], tuple[Arm, list[str], str]], seed: int) -> Array:
    """Errors, mm, as delivered and as calibrated at new poses everywhere, then the same near the bench."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        arm, files, residual = way(seed, folder / "files")
        with redirect_stdout(StringIO()):
            if main(["import", str(folder / "cell"), *files]):
                raise SystemExit(f"import failed: {files}")
        fitted = calibrate(load_dataset(folder / "cell"), residual=residual)
    point_m = MARKER_M if residual == "pose" else arm.tool_m
    rng = np.random.default_rng(10_000 + seed)

    def places_mm(one: Arm, q_rad: Sequence[Array]) -> Array:
        return np.array([1e3 * (one.frames(q)[-1] @ np.array([*point_m, 1.0]))[:3] for q in q_rad])

    out = []
    for is_wanted in (lambda place_mm: True, lambda place_mm: place_mm[2] < ON_THE_BENCH_MM):
        poses: list[Array] = []
        while len(poses) < 300:
            q = above_table(arm, np.radians(LIMITS_DEG), rng)
            poses += [q] if is_wanted(places_mm(arm, [q])[0]) else []
        true_mm = places_mm(arm, poses)
        out += [
            after_best_placement_mm(places_mm(Arm(), poses), true_mm),
            after_best_placement_mm(fitted.predict(np.array(poses)), true_mm),
        ]
    return np.array(out)


def run() -> None:
    """Print a row for each way of measuring."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", type=int, default=6)
    arms = parser.parse_args().arms
    for name, way in WAYS.items():
        errors = np.sqrt(np.mean([errors_mm(way, seed) ** 2 for seed in range(arms)], axis=0))
        everywhere, near = (f"{errors[k]:.2f} -> {errors[k + 1]:.3f} mm" for k in (0, 2))
        print(f"{name:58s} everywhere {everywhere}   below 0.3 m {near}", flush=True)


if __name__ == "__main__":
    run()
