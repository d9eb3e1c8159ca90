"""Patches of a plane's points: mean heights over the plane, and coordinates for the covariance kernels.

A covariance of some hundred means shows as much of a correlated error as one of a hundred thousand points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, IndexArray
from calib.planes.robust_fit import PlaneFit

_FARTHEST_EYE = 5.0  # edges: a scan whose origin lies nearer to the apex than this is not seen from its origin


@dataclass(frozen=True)
class ScannerView:
    """Line of sight from the scanner to the origin of the local coordinates, near the apex, and the distance to it."""

    sight: Array  # (3,) unit, from the eye to that origin
    distance_mm: float  # between both

    @staticmethod
    def of(origin_mm: Array, edge_mm: float) -> ScannerView:
        """View from the scanner to an origin (3,), mm, scanner frame, taken as at least five edge lengths away."""
        distance_mm = float(np.linalg.norm(origin_mm))
        sight = origin_mm / distance_mm if distance_mm > 1e-9 * edge_mm else np.array([0.0, 0.0, 1.0])
        return ScannerView(sight, max(distance_mm, _FARTHEST_EYE * edge_mm))

    def rays(self, points_mm: Array) -> Array:
        """Unit directions (N, 3) from the scanner to points (N, 3)."""
        way = points_mm + self.distance_mm * self.sight
        return way / np.linalg.norm(way, axis=1, keepdims=True)

    def image_mm(self, points_mm: Array) -> Array:
        """Coordinates (N, 2) of points (N, 3) in the scanner's image, in mm at the origin's depth."""
        across = np.linalg.svd(self.sight[None])[2][1:]
        depth = np.maximum(1 + points_mm @ self.sight / self.distance_mm, 0.1)
        return points_mm @ across.T / depth[:, None]


@dataclass(frozen=True)
class PatchPlaces:
    """Centres and spreads of B patches in two-dimensional coordinates: the scanner's image, or the plane."""

    centres_mm: Array  # (B, 2)
    spreads_mm2: Array  # (B, 2, 2) second central moments of each patch's points


@dataclass(frozen=True)
class Patches:
    """B patches of one plane's points: mean heights, numbers of points, scatter and places."""

    mean_mm: Array  # (B,) height over the plane, as the robust fit takes it
    count: Array  # (B,) points
    within_mm2: Array  # (B,) sums of squared heights about the patch's mean
    design: Array  # (B, 3) mean of the design's rows
    cosine: Array  # (B,) of the incidence
    image: PatchPlaces  # in the scanner's image
    face: PatchPlaces  # in the plane
    depth: float  # of the plane's middle, over that of the coordinates' origin

    def chosen(self, rows: IndexArray) -> Patches:
        """The patches with the given indices."""
        image, face = (PatchPlaces(p.centres_mm[rows], p.spreads_mm2[rows]) for p in (self.image, self.face))
        return Patches(
            self.mean_mm[rows], self.count[rows], self.within_mm2[rows], self.design[rows], self.cosine[rows],
            image, face, self.depth,
        )  # fmt: skip


def patches_of(plane: PlaneFit, view: ScannerView, along_mm: Array, side_mm: float) -> Patches:
    """Patches of a plane's points: square cells, `side_mm` wide, of their coordinates along_mm (K, 2)."""
    cell = np.floor(along_mm / side_mm).astype(np.int64)
    cell -= cell.min(axis=0)
    key = cell[:, 0] * (int(cell[:, 1].max()) + 1) + cell[:, 1]
    table = np.bincount(key)
    patch = (np.cumsum(table > 0) - 1)[key]
    count = table[table > 0].astype(np.float64)

    def mean(column: Array) -> Array:
        return np.bincount(patch, column) / count

    def places(coordinates_mm: Array) -> PatchPlaces:
        centres = np.column_stack([mean(column) for column in coordinates_mm.T])
        spreads = np.empty((len(count), 2, 2))
        for i, j in ((0, 0), (0, 1), (1, 1)):
            moment = mean(coordinates_mm[:, i] * coordinates_mm[:, j]) - centres[:, i] * centres[:, j]
            spreads[:, i, j] = spreads[:, j, i] = moment
        return PatchPlaces(centres, spreads)

    values = plane.psi_mm / plane.slope
    means = mean(values)
    middles = np.column_stack([mean(column) for column in plane.points_mm.T])
    return Patches(
        mean_mm=means,
        count=count,
        within_mm2=np.asarray(np.bincount(patch, (values - means[patch]) ** 2), dtype=np.float64),
        design=plane.design(middles),
        cosine=np.abs(view.rays(middles) @ plane.normal),
        image=places(view.image_mm(plane.points_mm)),
        face=places((plane.points_mm - plane.centre_mm) @ plane.axes.T),
        depth=1 + float(plane.centre_mm @ view.sight) / view.distance_mm,
    )


def joined(places: Sequence[PatchPlaces]) -> PatchPlaces:
    """Places of the patches of several planes in one value, plane by plane."""
    return PatchPlaces(np.concatenate([p.centres_mm for p in places]), np.concatenate([p.spreads_mm2 for p in places]))
