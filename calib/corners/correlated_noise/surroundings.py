"""Other flat surfaces in the scan, such as a wall behind the jig, which show errors correlated over more than the jig.

They have the same scanner's errors and reach farther. A wall may be bent by itself, so an error that it shows is
believed only in part; the absence of one is believed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.array_types import Array, IndexArray
from calib.corners.correlated_noise.likelihood import LENGTHS, evidence_of, gaussian_kernels
from calib.corners.correlated_noise.patches import Patches, ScannerView, patches_of
from calib.corners.correlated_noise.posterior import SIZES
from calib.planes.clustering import PlaneGroup
from calib.planes.robust_fit import PlaneFit, fit_plane_robustly

_MOST_PLANES = 2
_MOST_TRIED = 4
_MOST_POINTS = 20_000  # of the scan, that are looked at
_MOST_ON_PLANE = (1_500, 5_000)
_FEWEST_POINTS = 300
_BANDS_SIGMA = (20.0, 8.0)  # at first about the group's plane, which few sets make
_REACH = 1.1  # edges about the apex that are left to the jig
_MOST_SIGMA = 4.0  # times the jig's faces'; surfaces farther away scatter more
_DEPTHS = (0.6, 1.7)  # of the apex's depth
_CELLS = 8  # patches across
_LEAST_SIDE = 1 / 6  # of a patch, in edges
_FEWEST_IN_PATCH = 8
_EMPTIEST = 0.15  # times the usual number of points
_ROUGHEST = 2.0  # times the usual variance within a patch; more where another surface crosses the plane
_FEWEST_PATCHES = 10
_PRIOR_FLAT = 0.8  # of a surface near the jig, apart from a bow


def flat_surroundings(
    points_mm: Array,
    groups: Sequence[PlaneGroup],
    chosen: Sequence[int],
    origin_mm: Array,
    edge_mm: float,
    sigma_mm: float,
) -> tuple[PlaneFit, ...]:
    """Planes around the jig that scatter about as little as its faces, the largest groups first.

    Coordinates are about the origin (3,) near the apex. points_mm  # (N, 3) the whole scan; groups and the three chosen
    ones are the search's; sigma_mm is the scatter of the jig's faces.
    """
    some = points_mm[:: max(1, len(points_mm) // _MOST_POINTS)] - origin_mm
    free = some[np.einsum("ni,ni->n", some, some) > (_REACH * edge_mm) ** 2]
    others = [group for number, group in enumerate(groups) if number not in chosen and len(group.sets)]
    planes: list[PlaneFit] = []
    for group in others[:_MOST_TRIED]:
        normal, offset_mm = group.normal, float(group.offset_mm - group.normal @ origin_mm)
        scatter_mm = sigma_mm
        for band, most in zip(_BANDS_SIGMA, _MOST_ON_PLANE, strict=True):
            on = np.flatnonzero(np.abs(free @ normal - offset_mm) < band * scatter_mm)
            if len(on) < _FEWEST_POINTS:
                break
            fitted = on[:: max(1, len(on) // most)]
            plane = fit_plane_robustly(free[fitted], fitted, normal, offset_mm)
            normal, offset_mm, scatter_mm = plane.normal, plane.offset_mm, plane.sigma_mm
        else:
            if scatter_mm < _MOST_SIGMA * sigma_mm:
                planes.append(plane)
                free = np.delete(free, on, axis=0)
        if len(planes) == _MOST_PLANES:
            break
    return tuple(planes)


def patches_of_surroundings(plane: PlaneFit, view: ScannerView, edge_mm: float) -> Patches | None:
    """Patches of a flat surface in the scanner's image, without sparse or rough ones; None where few remain."""
    image_mm = view.image_mm(plane.points_mm)
    side_mm = max(float(np.sqrt(np.prod(np.ptp(image_mm, axis=0)))) / _CELLS, _LEAST_SIDE * edge_mm)
    patches = patches_of(plane, view, image_mm, side_mm)
    if not _DEPTHS[0] < patches.depth < _DEPTHS[1]:
        return None
    variance = patches.within_mm2 / np.maximum(patches.count - 1, 1)
    full = patches.count >= max(_FEWEST_IN_PATCH, _EMPTIEST * float(np.median(patches.count)))
    if not full.any():
        return None
    rows: IndexArray = np.flatnonzero(full & (variance < _ROUGHEST * np.median(variance[full])))
    return patches.chosen(rows) if len(rows) >= _FEWEST_PATCHES else None


def evidence_of_surroundings(patches: Patches, edge_mm: float, sizes_mm: Array) -> tuple[Array, float, Array]:
    """Log likelihood of a surface near the jig with (S, W) and without correlated error, and expected loss (S, W).

    Walls and tables are bowed, so a quadratic part of their shape is left free. Apart from that the surface is flat and
    shows the scanner's error alone, which grows with no, the first or the second power of the depth, or it is uneven by
    itself and shows that error or anything larger.
    """
    variance = float(np.sum(patches.within_mm2) / np.sum(patches.count - 1))
    kernels = gaussian_kernels(patches.image, LENGTHS * edge_mm)
    kernels *= np.outer(patches.cosine, patches.cosine)
    u, v = (patches.design[:, 1:] / np.maximum(np.std(patches.design[:, 1:], axis=0), 1e-9)).T
    bow = np.column_stack([patches.design, u * u, u * v, v * v])
    evidence = evidence_of(patches.mean_mm, max(variance, 1e-24) / patches.count, bow, kernels, sizes_mm)
    likelihood = evidence.log_likelihood
    step = np.log(SIZES[1] / SIZES[0])
    place = np.arange(len(SIZES))
    flat = [_interpolated(likelihood, place + power * np.log(patches.depth) / step) for power in (0, 1, 2)]
    larger = np.logaddexp.accumulate(likelihood[:, ::-1], axis=1)[:, ::-1] - np.log(len(SIZES) - place)
    anything = np.logaddexp.reduce(likelihood, axis=None) - np.log(likelihood.size)
    waves = np.logaddexp(
        np.log(_PRIOR_FLAT) + np.logaddexp.reduce(flat, axis=0) - np.log(len(flat)), np.log(1 - _PRIOR_FLAT) + larger
    )
    none = float(np.logaddexp(np.log(_PRIOR_FLAT), np.log(1 - _PRIOR_FLAT) + anything))
    return waves, none, evidence.expected_loss


def _interpolated(values: Array, place: Array) -> Array:
    """Columns of `values` (S, W), interpolated linearly at fractional indices `place` (W,), clamped to the range."""
    place = np.clip(place, 0, values.shape[1] - 1)
    low = np.minimum(place.astype(np.int64), values.shape[1] - 2)
    return values[:, low] + (place - low) * (values[:, low + 1] - values[:, low])
