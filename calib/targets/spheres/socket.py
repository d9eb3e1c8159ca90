"""Finder of a ball or socket measured by a touch probe: the contacts lie on a sphere about the target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.array_types import Array, BoolArray
from calib.corners.intersection import packed
from calib.errors import TargetError
from calib.planes.point_selection import finite_rows
from calib.scans.scan import Scan
from calib.target_shapes import Socket
from calib.targets.protocol.finder import FoundPoint, Wanted

_MOST_CONTACTS = 500  # beyond them it is a scan
_ROUNDS = 50
_OFF_SIGMAS = 4.5  # a contact that is so far off the sphere of the others touched something else
_MOST_OFF = 0.25  # of the contacts
_MOST_RATIO = 3.0  # of the contacts' scatter over the probe's declared sigma
_MOST_SIGMA = 0.1  # of the sphere's radius, in the centre's weakest direction
_TRIALS = 300


def find_socket(scan: Scan, wanted: Wanted) -> Sequence[FoundPoint]:
    """Centre of the sphere that a probe's contacts (N, 3) lie on; at least four for a known diameter, five otherwise.

    The fit is least squares of the distances, without contacts that the others contradict. The sigma is the larger of
    the probe's declared one and the contacts' scatter. Raises TargetError where the contacts determine no sphere.
    """
    shape = wanted.shape
    assert isinstance(shape, Socket)
    rows = np.flatnonzero(finite_rows(scan.points_mm))
    points = scan.points_mm[rows]
    fixed = shape.diameter_mm is not None
    needed = 4 if fixed else 5
    if not needed <= len(points) <= _MOST_CONTACTS:
        raise TargetError(
            f"the file holds {len(points)} contacts of the probe; {needed} to {_MOST_CONTACTS} are needed, spread over "
            "the surface"
        )
    radius = None if shape.diameter_mm is None else shape.diameter_mm / 2
    kept = _agreeing(points, radius, shape.probe_sigma_mm)
    fit = _fitted(points[kept], radius)
    if fit is None or np.count_nonzero(kept) < max(needed, (1 - _MOST_OFF) * len(points)):
        raise TargetError(
            f"{np.count_nonzero(kept)} of {len(points)} contacts lie on one sphere; probe the surface again"
        )
    centre, found_radius, over, inverse = fit
    freedom = len(over) - (3 if fixed else 4)
    scatter = float(np.sqrt(over @ over / freedom)) if freedom > 0 else 0.0
    if freedom > 0 and scatter > _MOST_RATIO * shape.probe_sigma_mm and freedom > 2:
        raise TargetError(
            f"the {len(over)} contacts scatter {scatter:.2g} mm about a sphere, the probe's sigma is "
            f"{shape.probe_sigma_mm:.2g} mm; check diameter_mm (ball and probe together) and probe_sigma_mm"
        )
    covariance = inverse[:3, :3] * max(scatter, shape.probe_sigma_mm) ** 2
    if np.sqrt(np.linalg.eigvalsh(covariance)[-1]) > _MOST_SIGMA * found_radius:
        raise TargetError(
            f"the {len(over)} contacts lie so that the centre is open in one direction; probe the surface all around"
        )
    left_out = len(points) - len(over)
    doubts = (f"{left_out} of {len(points)} contacts lie off the sphere of the others; probe them again",)
    return [
        FoundPoint(
            centre,
            covariance,
            len(over),
            scatter,
            packed(rows[kept], len(scan.points_mm)),
            {"diameter_mm": 2 * found_radius},
            doubts if left_out else (),
            found_radius,
        )
    ]


def _agreeing(points: Array, radius: float | None, sigma_mm: float) -> BoolArray:
    """Mask (N,) of the contacts on one sphere: the largest set that agrees with a sphere fitted to a few of them."""
    rng = np.random.default_rng(0)
    every = np.ones(len(points), dtype=bool)
    best = np.zeros(len(points), dtype=bool)
    count = 4
    for trial in range(_TRIALS):
        some = every if trial == 0 else np.isin(np.arange(len(points)), rng.choice(len(points), count, replace=False))
        fit = _fitted(points[some], radius if trial == 0 else None)
        if fit is None:
            continue
        centre, found, _, _ = fit
        on = np.abs(np.linalg.norm(points - centre, axis=1) - (radius or found)) < _OFF_SIGMAS * sigma_mm
        for _ in range(3):
            again = _fitted(points[on], radius) if on.sum() >= count else None
            if again is None:
                break
            on = np.abs(np.linalg.norm(points - again[0], axis=1) - again[1]) < _OFF_SIGMAS * sigma_mm
        if on.sum() > best.sum():
            best = on
        if best.all():
            break
    return best if best.sum() >= (1 - _MOST_OFF) * len(points) else every


def _fitted(points: Array, radius: float | None) -> tuple[Array, float, Array, Array] | None:
    """Centre, radius, distances (N,) and inverse normal matrix of a sphere by Gauss-Newton; None where singular."""
    middle = points.mean(axis=0)
    local = points - middle
    rows = np.column_stack([2 * local, np.ones(len(local))])
    solved, _, rank, _ = np.linalg.lstsq(rows, np.einsum("ni,ni->n", local, local), rcond=1e-9)
    if rank < 4:
        return None
    centre = solved[:3]
    size = radius or float(np.sqrt(max(solved[3] + centre @ centre, 1e-12)))
    for _ in range(_ROUNDS):
        way = local - centre
        reach = np.maximum(np.linalg.norm(way, axis=1), 1e-12)
        over = reach - size
        design = way / reach[:, None]
        if radius is None:
            design = np.column_stack([design, np.ones(len(design))])
        normal = design.T @ design
        if np.linalg.eigvalsh(normal)[0] < 1e-9:
            return None
        step = np.linalg.solve(normal, design.T @ over)
        centre = centre + step[:3]
        size = radius or size + float(step[3])
        if np.linalg.norm(step) < 1e-10 * max(size, 1.0):
            break
    way = local - centre
    return centre + middle, size, np.linalg.norm(way, axis=1) - size, np.linalg.inv(normal)
