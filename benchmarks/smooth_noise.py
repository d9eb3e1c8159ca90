"""Is a corner's covariance honest where the scanner's error is smooth? Squared errors in its units: 3 is honest.

    python benchmarks/smooth_noise.py [--scans 10] [--points 12000] [--tables NAME ...] [--kernels NAME ...]
                                      [--sizes 0.02] [--lengths 2 5 10 15 22 30 45 60]

Scans are those of the tests' ray caster (tests/support/scan_scene.py): a jig of 60 mm edge some 700 mm away on its
flange, with link, wall and table behind, 0.02 mm * (0.5 + 0.5 / cos^2 incidence) of white noise along the ray, 35 %
flying pixels at depth edges; and those of the second simulator (tests/support/mesh_cases.py). Both share no code with
calib. Tables:

    waves    an error along the ray that is smooth across the view, of three kernels (tests/support/smooth_fields.py):
             exp(-r^2 / 2 l^2), exp(-r / l), and half of each as a structured-light scanner's plane showed it
    alone    the same with nothing beside the jig in view, and with the size and length told of the scanner
    faces    unevenness of each face by itself, which no wall behind shows
    wall     white noise, and the wall behind bent by itself
    scanners the second simulator: mixed pixels, stickers on a face, joined views; "told": their registration is
    views    raw points of views that were joined, whole, thinned at random, and thinned to one point per cell

A cell has the mean and the median of error . C^-1 . error over the scans; a chi-squared of three degrees of freedom has
3 and 2.4. Each row ends with the median of the corner's error and of its sigma, in mm; in the tables waves and alone a
second line has the RMS of the error over the Cramer-Rao bound of a fit that knows the kernel.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is loaded

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from calib.corners.correlated_noise.declared import NOTHING_DECLARED, DeclaredNoise  # noqa: E402
from calib.corners.search import CornerOptions, find_corner  # noqa: E402
from calib.jig import Jig  # noqa: E402
from calib.scans.scan import Scan  # noqa: E402
from tests.support.joined_views import joined, one_per_cell  # noqa: E402
from tests.support.mesh_cases import KINDS  # noqa: E402
from tests.support.scan_scene import make_scene, smooth_bound_mm  # noqa: E402
from tests.support.smooth_fields import KERNELS  # noqa: E402

WHITE_MM = 0.02
FIRST_SEED = 3000
TABLES = ("waves", "alone", "faces", "wall", "scanners", "views")
MESH_KINDS = ("light", "flight", "flight, edge 60", "sticker 0.1", "sticker 0.3", "fused", "fused, views off")
REGISTRATION_MM = 0.03  # of each view of "fused, views off"
# squared error in units of the covariance; error, sigma and the bound in mm (nan where it is not known)
Outcome = tuple[float, float, float, float]


def judged(
    scan: Scan,
    jig: Jig,
    apex_mm: NDArray,
    scan_sigma_mm: float | None,
    declared: DeclaredNoise,
    bound_mm: float = np.nan,
) -> Outcome | None:
    """Error of one scan's corner in units of its covariance; None where there is no corner."""
    options = CornerOptions(declared=declared)
    corner = find_corner(scan, jig, scan_sigma_mm=scan_sigma_mm, options=options).corner
    if corner is None:
        return None
    error = corner.xyz_mm - apex_mm
    squared = float(error @ np.linalg.solve(corner.covariance_mm2, error))
    return squared, float(np.linalg.norm(error)), corner.sigma_mm(), bound_mm


def of_scenes(
    scans: int, points: int, declared: DeclaredNoise = NOTHING_DECLARED, **scene: float | str | bool
) -> list[Outcome]:
    """Judged corners of the ray caster's scans."""
    found = []
    for seed in range(FIRST_SEED, FIRST_SEED + scans):
        made = make_scene(np.random.default_rng(seed), points, sigma_mm=WHITE_MM, **scene)  # type: ignore[arg-type]
        waves = float(scene.get("waves_mm", 0.0)), float(scene.get("wave_length_mm", 15.0))
        bound_mm = smooth_bound_mm(made, WHITE_MM, *waves, str(scene.get("wave_kernel", "gaussian")))
        found.append(judged(made.scan, Jig(), made.apex_mm, WHITE_MM, declared, bound_mm))
    return [outcome for outcome in found if outcome is not None]


def of_kind(name: str, scans: int, declared: DeclaredNoise = NOTHING_DECLARED) -> list[Outcome]:
    """Judged corners of the second simulator's fair scans of one kind."""
    found = []
    for seed in range(scans):
        made, jig, sigma_mm = KINDS[name].scan(name, seed)
        if made.fair:
            found.append(judged(made.scan, jig, made.apex_mm, sigma_mm, declared))
    return [outcome for outcome in found if outcome is not None]


def row(name: str, cells: list[list[Outcome]]) -> str:
    """Line of the table: mean and median of each cell, then medians of error and sigma over all."""
    text = "".join(
        f"{np.mean([o[0] for o in cell]):8.1f}{np.median([o[0] for o in cell]):6.1f}" if cell else f"{'-':>14}"
        for cell in cells
    )
    every = [outcome for cell in cells for outcome in cell]
    middle = [np.median([o[column] for o in every]) if every else np.nan for column in (1, 2)]
    return f"{name:30}{text}{middle[0]:10.4f}{middle[1]:9.4f}   of {len(every)}"


def over_bound(cells: list[list[Outcome]]) -> str:
    """Line of the table with the RMS of the error over the bound, a cell each."""
    rms = (np.sqrt(np.mean([(o[1] / o[3]) ** 2 for o in cell])) if cell else np.nan for cell in cells)
    return f"{'  RMS over the bound':30}" + "".join(f"{ratio:8.2f}{'':6}" for ratio in rms)


def waves(arguments: argparse.Namespace) -> Iterator[str]:
    """Print the table for smooth errors along the ray."""
    scans, points = arguments.scans, arguments.points
    yield row("white noise alone", [of_scenes(3 * scans, points)])
    for size in arguments.sizes:
        for kernel in arguments.kernels:
            cells = [
                of_scenes(scans, points, waves_mm=size, wave_length_mm=length, wave_kernel=kernel)
                for length in arguments.lengths
            ]
            yield row(f"{kernel}, {size} mm", cells)
            yield over_bound(cells)


def alone(arguments: argparse.Namespace) -> Iterator[str]:
    """Print the table for smooth errors along the ray, of a jig with nothing behind it."""
    scans, points = arguments.scans, arguments.points
    yield row("white noise alone", [of_scenes(3 * scans, points, background=False)])
    for size in arguments.sizes:
        for tell in (False, True):
            cells = [
                of_scenes(
                    scans,
                    points,
                    DeclaredNoise(size, length) if tell else NOTHING_DECLARED,
                    waves_mm=size,
                    wave_length_mm=length,
                    background=False,
                )
                for length in arguments.lengths
            ]
            yield row(f"gaussian, {size} mm{', told' if tell else ''}", cells)
            yield over_bound(cells)


def faces(arguments: argparse.Namespace) -> Iterator[str]:
    """Print the table for uneven faces."""
    for size in arguments.sizes:
        cells = [
            of_scenes(arguments.scans, arguments.points, uneven_mm=size, wave_length_mm=length)
            for length in arguments.lengths
        ]
        yield row(f"uneven, {size} mm", cells)


def wall(arguments: argparse.Namespace) -> Iterator[str]:
    """Print the table for a wall that is bent by itself, by so much over the view."""
    for bent_mm in (0.02, 0.05, 0.1, 0.3, 1.0):
        yield row(f"wall bent by {bent_mm} mm", [of_scenes(arguments.scans, arguments.points, wall_bent_mm=bent_mm)])


def scanners(arguments: argparse.Namespace) -> Iterator[str]:
    """Print the table for the second simulator's scanners."""
    for name in MESH_KINDS:
        yield row(name, [of_kind(name, arguments.scans)])
    declared = replace(NOTHING_DECLARED, registration_sigma_mm=REGISTRATION_MM)
    yield row("fused, views off, told", [of_kind("fused, views off", arguments.scans, declared)])


def views(arguments: argparse.Namespace) -> Iterator[str]:
    """Print the table for raw points of joined views: how many, off by how much, and how they were thinned."""
    kept: dict[str, Callable[[np.random.Generator, NDArray], NDArray]] = {
        "whole": lambda rng, points: points,
        "half kept": lambda rng, points: points[rng.random(len(points)) < 0.5],
        "30 % kept": lambda rng, points: points[rng.random(len(points)) < 0.3],
        "means over 2 mm": lambda rng, points: one_per_cell(points, 2.0),
        "one of each 2 mm": lambda rng, points: one_per_cell(points, 2.0, mean=False),
    }
    for count, off_mm, off_deg in ((1, 0.0, 0.0), (2, 0.0, 0.0), (2, 0.03, 0.0), (2, 0.1, 0.02), (4, 0.03, 0.0)):
        for name, keep in kept.items():
            found = []
            for seed in range(FIRST_SEED, FIRST_SEED + arguments.scans):
                rng = np.random.default_rng(seed)
                points, apex_mm = joined(rng, count, off_mm, off_deg, arguments.points)
                found.append(judged(Scan("views", keep(rng, points)), Jig(), apex_mm, WHITE_MM, NOTHING_DECLARED))
            yield row(f"{count} off {off_mm} mm, {name}", [[outcome for outcome in found if outcome is not None]])


def main() -> None:
    """Print the tables, a line as soon as it is known."""
    parser = argparse.ArgumentParser(description="the covariance of corners under smooth errors")
    parser.add_argument("--scans", type=int, default=10, help="scans a cell")
    parser.add_argument("--points", type=int, default=12_000)
    parser.add_argument("--tables", nargs="*", default=list(TABLES), choices=TABLES, metavar="NAME")
    parser.add_argument("--kernels", nargs="*", default=list(KERNELS), choices=KERNELS, metavar="NAME")
    parser.add_argument("--sizes", type=float, nargs="*", default=[0.02], help="standard deviations, mm")
    parser.add_argument("--lengths", type=float, nargs="*", default=[2, 5, 10, 15, 22, 30, 45, 60])
    arguments = parser.parse_args()
    made: dict[str, Callable[[argparse.Namespace], Iterator[str]]] = {
        "waves": waves, "alone": alone, "faces": faces, "wall": wall, "scanners": scanners, "views": views,
    }  # fmt: skip
    for table in arguments.tables:
        lengths = arguments.lengths if table in ("waves", "alone", "faces") else ()
        sys.stdout.write(f"\n{table:30}" + "".join(f"{f'{length:g} mm':>14}" for length in lengths) + "\n")
        for line in made[table](arguments):
            sys.stdout.write(line + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
