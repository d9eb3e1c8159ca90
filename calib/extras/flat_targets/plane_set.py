"""Finder of planes in known relative positions: the origin of their common frame, where they need not meet.

Three planes of the scan whose angles are those of three of the set give the frame; the others then have to be where the
set has them, if they are seen. Rotation and origin come from the points of all planes together, six unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from calib.array_types import Array
from calib.corners.intersection import packed
from calib.errors import TargetError
from calib.frames import best_fit_rotation, rotation_from_rotvec
from calib.planes.flat_patches import flat_patches
from calib.planes.point_selection import finite_rows
from calib.planes.robust_fit import PlaneFit
from calib.scans.scan import Scan
from calib.target_shapes import PlaneSet
from calib.targets.protocol.finder import FoundPoint, Wanted

_ALIKE = np.radians(1.0)
_MOST_TRIED = 12  # patches
_ROUNDS = 6
_REACH = 2.5  # sizes, beyond the farthest offset: where patches of the set lie about its origin
_SAME_MM = 0.5  # two namings that put the origin so near to each other are one
_OFF_SIGMAS = 6.0
_OFF_MM = 0.05  # by which a plane may be off besides
_SINGULAR = 0.05


@dataclass(frozen=True)
class _Named:
    """Patches, each identified as a plane of the set."""

    patches: tuple[PlaneFit, ...]
    planes: tuple[int, ...]

    @property
    def points(self) -> int:
        """Number of scan points on all patches."""
        return sum(len(patch.indices) for patch in self.patches)


def find_plane_set(scan: Scan, wanted: Wanted) -> Sequence[FoundPoint]:
    """Origin of the set's frame. Raises TargetError where three of its planes are not seen or cannot be identified."""
    shape = wanted.shape
    assert isinstance(shape, PlaneSet)
    rows = np.flatnonzero(finite_rows(scan.points_mm))
    points = scan.points_mm[rows]
    patches = flat_patches(points, shape.size_mm)[:_MOST_TRIED]
    normals, offsets = np.array(shape.normals), np.array(shape.offsets_mm)
    fits: list[tuple[_Named, _Placed]] = []
    for named in _namings(patches, normals):
        placed = _placed(named, normals, offsets)
        if placed is None:
            continue
        named = _with_others(named, patches, placed, normals, offsets, shape.size_mm)
        placed = _placed(named, normals, offsets)
        if placed is not None and _is_near(named, placed, offsets, shape.size_mm) and placed.worst < 1:
            fits.append((named, placed))
    if not fits:
        raise TargetError(
            f"{len(patches)} flat patches are in view, no three of them meet at the angles of the set's planes; "
            "check that the set is in view, and its planes in dataset.toml"
        )
    fits.sort(key=lambda fit: (-len(fit[0].planes), -fit[0].points))
    (named, placed), others = fits[0], fits[1:]
    for other, elsewhere in others:
        alike = len(other.planes) == len(named.planes) and other.points > 0.5 * named.points
        if alike and np.linalg.norm(elsewhere.origin_mm - placed.origin_mm) > _SAME_MM:
            raise TargetError(
                f"{len(named.planes)} planes fit the set in more than one way, the origins "
                f"{np.linalg.norm(elsewhere.origin_mm - placed.origin_mm):.3g} mm apart; give a fourth plane, or "
                "planes at angles that differ"
            )
    inliers = np.concatenate([patch.indices for patch in named.patches])
    return [
        FoundPoint(
            placed.origin_mm,
            placed.covariance[3:, 3:],
            len(inliers),
            max(patch.sigma_mm for patch in named.patches),
            packed(rows[inliers], len(scan.points_mm)),
            {"planes": float(len(named.planes)), "worst_plane_off_mm": placed.off_mm},
        )
    ]


@dataclass(frozen=True)
class _Placed:
    """Fitted pose of the set in the scanner's frame."""

    origin_mm: Array  # (3,)
    scanner_R_set: Array  # (3, 3)
    covariance: Array  # (6, 6) of turn (rad, about the scanner's axes) and origin (mm)
    off_mm: float  # of the plane that fits worst, at the middle of its patch
    worst: float  # the same over what its noise allows


def _namings(patches: Sequence[PlaneFit], normals: Array) -> list[_Named]:
    """Triples of patches with the angles and the handedness of three of the set's planes."""
    namings = []
    seen = [np.array([patch.normal for patch in triple]) for triple in combinations(patches, 3)]
    for three in combinations(range(len(normals)), 3):
        of_set = normals[list(three)]
        volume = np.linalg.det(of_set)
        if abs(volume) < _SINGULAR:
            continue
        for triple, there in zip(combinations(patches, 3), seen, strict=True):
            for order in permutations(range(3)):
                turned = there[list(order)]
                if np.linalg.det(turned) * volume < 0:
                    continue
                angles = np.arccos(np.clip(turned @ turned.T, -1, 1)) - np.arccos(np.clip(of_set @ of_set.T, -1, 1))
                if np.abs(angles).max() < _ALIKE:
                    namings.append(_Named(tuple(triple[k] for k in order), three))
    return namings


def _placed(named: _Named, normals: Array, offsets: Array) -> _Placed | None:
    """Pose of the set by least squares on all points of the named planes; None where they do not determine it.

    Point p of plane i has the height (R n_i) . (p - o) - d_i over it; the derivative is (R n_i) x (p - o) . w by a
    rotation w, and -(R n_i) by a shift of the origin o.
    """
    of_set, at = normals[list(named.planes)], offsets[list(named.planes)]
    seen = np.array([patch.normal for patch in named.patches])
    turn = best_fit_rotation(of_set, seen)
    there = of_set @ turn.T
    heights = np.array([p.normal @ p.centre_mm for p in named.patches])
    origin = np.linalg.lstsq(there, heights - at, rcond=None)[0]
    covariance = np.zeros((6, 6))
    moments = [plane_information(patch) for patch in named.patches]
    for _ in range(_ROUNDS):
        there = of_set @ turn.T
        normal_matrix, right = np.zeros((6, 6)), np.zeros(6)
        for k, (patch, design) in enumerate(zip(named.patches, moments, strict=True)):
            # The patch's plane sums up its points: heights over it at (1, u, v) of its own axes.
            axes = np.vstack([np.zeros(3), patch.axes])
            places = patch.centre_mm + axes  # 1 mm along each axis
            over = (places - origin) @ there[k] - at[k]
            over = np.array([over[0], over[1] - over[0], over[2] - over[0]])
            rows = np.column_stack([np.cross(there[k], places - origin), np.tile(-there[k], (3, 1))])
            rows[1:] -= rows[0]
            normal_matrix += rows.T @ design @ rows
            right -= rows.T @ design @ over
        scale = np.sqrt(np.maximum(np.diag(normal_matrix), 1e-300))
        scaled = normal_matrix / np.outer(scale, scale)
        if np.linalg.eigvalsh(scaled)[0] < 1e-10:
            return None
        covariance = np.linalg.inv(scaled) / np.outer(scale, scale)
        step = covariance @ right
        turn = rotation_from_rotvec(step[:3]) @ turn
        origin = origin + step[3:]
    there = of_set @ turn.T
    off = np.array([abs((p.centre_mm - origin) @ n - d) for p, n, d in zip(named.patches, there, at, strict=True)])
    allowed = [
        _OFF_MM + _OFF_SIGMAS * (p.sigma_mm / np.sqrt(len(p.indices)) + np.sqrt(n @ covariance[3:, 3:] @ n))
        for p, n in zip(named.patches, there, strict=True)
    ]
    return _Placed(
        np.asarray(origin, dtype=np.float64), turn, covariance, float(off.max()), float((off / allowed).max())
    )


def plane_information(plane: PlaneFit) -> Array:
    """Information matrix (3, 3) of a patch's height (mm) and two slopes (rad), from its points and their scatter."""
    design = plane.design(plane.points_mm)
    values = plane.psi_mm / plane.slope
    variance = max(float(values @ values) / max(len(values) - 3, 1), 1e-18)
    return design.T @ design / variance


def _with_others(
    named: _Named, patches: Sequence[PlaneFit], placed: _Placed, normals: Array, offsets: Array, size_mm: float
) -> _Named:
    """Identified patches, with all other patches that match further planes of the set near its origin."""
    added, planes = list(named.patches), list(named.planes)
    there = normals @ placed.scanner_R_set.T
    for k in range(len(normals)):
        if k in planes:
            continue
        for patch in patches:
            way = patch.centre_mm - placed.origin_mm
            on = abs(way @ there[k] - offsets[k]) < 0.01 * size_mm
            alike = patch.normal @ there[k] > np.cos(_ALIKE)
            if (
                on
                and alike
                and np.linalg.norm(way) < abs(offsets[k]) + _REACH * size_mm
                and not any(patch is a for a in added)
            ):
                added.append(patch)
                planes.append(k)
                break
    return _Named(tuple(added), tuple(planes))


def _is_near(named: _Named, placed: _Placed, offsets: Array, size_mm: float) -> bool:
    """Whether all patches assigned to the planes of a set lie no farther from its origin than the set is large."""
    reach = float(np.abs(offsets).max()) + _REACH * size_mm
    return all(np.linalg.norm(patch.centre_mm - placed.origin_mm) < reach for patch in named.patches)
