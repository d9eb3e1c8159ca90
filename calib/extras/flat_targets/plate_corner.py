"""Finder of the corner of a flat plate: where two of its straight edges meet, in the plane through its face.

Across its plane a plate's corner is known as well as the plane. Along it only the outermost points of the face show
where an edge is, and between the last point on the plate and the first one off it the edge may be anywhere: its place
is known to about a third of the distance between points, however many rows of points end there. The covariance says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.corners.intersection import packed
from calib.errors import TargetError
from calib.extras.flat_targets.plane_set import plane_information
from calib.lazy_modules import spatial
from calib.planes.flat_patches import flat_patches
from calib.planes.point_selection import finite_rows
from calib.planes.robust_fit import PlaneFit
from calib.scans.scan import Scan, seeded_generator
from calib.statistics import mad_sigma
from calib.target_shapes import Plate
from calib.targets.protocol.finder import FoundPoint, Wanted

_MOST_PATCHES = 10
_NEIGHBOURS = 12
_GAP_RAD = np.radians(130)  # between neighbours about a point: it lies on the border
_TRIALS = 500
_MOST_LINES = 8
_ON_LINE = 0.8  # of the distance between points
_LEAST_LENGTH = 0.4  # of the edge
_MOST_OUTSIDE = 0.06  # of the points along an edge, those beyond it
_SAME_ANGLE_DEG = 2.5
_GAP, _GAP_SIGMA = 0.65, 0.35  # of the pitch: from the last point of a row to the edge
_ROWS_FEWEST = 6
_BEFORE = 0.003  # of the distance: points so much nearer than the plane lie before it
_MOST_HIDDEN = 0.3  # of the points beyond an edge, those before the plane: it is where something hides the plate
# of the points that the plate would have there: fewer, and it may be the border of the scan's field
_LEAST_BEYOND = 0.3
_MOST_BEYOND_RIM = 0.005  # of the scan's rays, those beyond the line of its field's rim
_LEAST_ELSE = 0.1  # of the scan's points, those off the patch
_ALONG_PIXELS_RAD = np.radians(4)  # an edge so near to the pixels' rows may be the rim, and lenses bend it
_REGULAR = 4.0  # by how many times what is expected of random points neighbours agree on the rows' direction
_CELLS_ALONG, _MOSTLY = 12, 0.6  # of an edge, and the share of them in which something nearer comes first
_AT_BORDER = 0.3  # what such an edge counts
_ALIKE = 0.75  # of the best corner's score: a further corner that counts so much is as good


@dataclass(frozen=True)
class _Edge:
    """Straight edge a . p = offset in the plate's plane, a (2,) outward, and where along it the plate ends."""

    outward: Array  # (2,) unit
    offset_mm: float
    along: Array  # (2,) unit
    ends_mm: tuple[float, float]
    counts: float  # 1; less at the border of the field, where no edge may be


def find_plate_corner(scan: Scan, wanted: Wanted) -> Sequence[FoundPoint]:
    """Corners of plates, at most as many as are wanted, those with the longest edges first.

    Raises TargetError where no two straight edges meet at the plate's angle.
    """
    shape = wanted.shape
    assert isinstance(shape, Plate)
    rows = np.flatnonzero(finite_rows(scan.points_mm))
    points = scan.points_mm[rows]
    rng = seeded_generator(points)
    patches = flat_patches(points, shape.edge_mm)[:_MOST_PATCHES]
    scored: list[tuple[float, FoundPoint]] = []
    edges_seen = 0
    for patch in patches:
        flat = _Flat.of(patch, points)
        edges = _edges(flat, shape, rng)
        edges_seen = max(edges_seen, len(edges))
        for one, other in combinations(edges, 2):
            corner = _corner(one, other, flat, shape)
            if corner is None:
                continue
            place = _refined(corner, one, other, flat, rows, len(scan.points_mm))
            if place is not None:
                scored.append((sum(_score(edge, shape) for edge in (one, other)), place))
    scored.sort(key=lambda item: -item[0])
    kept: list[FoundPoint] = []
    for score, place in scored:
        apart = all(np.linalg.norm(place.xyz_mm - other.xyz_mm) > 0.2 * shape.edge_mm for other in kept)
        if apart and len(kept) == wanted.most and score > _ALIKE * scored[0][0]:
            raise TargetError(
                f"more than {wanted.most} corners of {shape.angle_deg:g} deg are in view with edges of "
                f"{shape.edge_mm:g} mm; give an edge_mm that one alone has, show only that one, or name the others "
                "as targets too"
            )
        if apart and len(kept) < wanted.most:
            kept.append(place)
    if not kept:
        raise TargetError(
            f"{len(patches)} flat patches are in view, with {edges_seen} straight edges of {shape.edge_mm:g} mm at "
            f"most on one, none of which meet at {shape.angle_deg:g} deg (the scan's rim and shadows are no edges); "
            "check that the corner is in view, something of what is around it too, and edge_mm"
        )
    return kept


@dataclass(frozen=True)
class _Flat:
    """Points of a flat patch, and of the whole scan, in coordinates of the patch's plane."""

    plane: PlaneFit
    uv_mm: Array  # (K, 2) about the patch's middle
    border: BoolArray  # (K,)
    density: float  # points a mm^2
    seen_uv_mm: Array  # (N, 2) where the rays of all the scan's points meet the plane
    nearer: BoolArray  # (N,) points before the plane, which may hide a part of the plate

    @staticmethod
    def of(plane: PlaneFit, points: Array) -> _Flat:
        """Plane coordinates of a patch's points and of all points (N, 3) of the scan, projected along their rays."""
        uv = (plane.points_mm - plane.centre_mm) @ plane.axes.T
        tree = spatial.cKDTree(uv)
        distance, near = (np.asarray(a) for a in tree.query(uv, k=min(_NEIGHBOURS + 1, len(uv))))
        way = uv[near[:, 1:]] - uv[:, None]
        angle = np.sort(np.arctan2(way[..., 1], way[..., 0]), axis=1)
        gaps = np.diff(np.column_stack([angle, angle[:, :1] + 2 * np.pi]), axis=1)
        density = (distance.shape[1] - 1) / (np.pi * float(np.median(distance[:, -1])) ** 2)
        along = points @ plane.normal / plane.offset_mm  # 1 on the plane, 0 at the scanner
        meets = along > 1e-3
        seen = (points[meets] / along[meets, None] - plane.centre_mm) @ plane.axes.T
        return _Flat(plane, uv, gaps.max(axis=1) > _GAP_RAD, density, seen, along[meets] < 1 - _BEFORE)

    def pitch_mm(self, outward: Array) -> float:
        """Distance, mm, between neighbouring points in a direction of the plane; larger where it leans to the ray."""
        plane = self.plane
        ray = plane.centre_mm / np.linalg.norm(plane.centre_mm)
        across = np.sqrt(abs(ray @ plane.normal) / self.density)
        lean = float(outward @ plane.axes @ ray)
        return float(across / np.sqrt(max(1 - lean**2, 0.05)))


def _edges(flat: _Flat, shape: Plate, rng: np.random.Generator) -> list[_Edge]:
    """Straight edges of a patch: lines that many border points lie on, with the patch on one side only."""
    border = flat.uv_mm[flat.border]
    step = 1 / np.sqrt(flat.density)
    edges: list[_Edge] = []
    for _ in range(_MOST_LINES):
        if len(border) < _ROWS_FEWEST:
            break
        first, second = border[rng.integers(len(border), size=(2, _TRIALS))]
        way = second - first
        length = np.linalg.norm(way, axis=1)
        good = length > 0.15 * shape.edge_mm
        if not good.any():
            break
        normal = np.stack([-way[good, 1], way[good, 0]], axis=1) / length[good, None]
        offset = np.einsum("ti,ti->t", normal, first[good])
        on = np.abs(border @ normal.T - offset) < _ON_LINE * step
        best = int(np.argmax(on.sum(axis=0)))
        members = border[on[:, best]]
        if len(members) * step < 0.5 * _LEAST_LENGTH * shape.edge_mm:
            break
        edge = _checked(flat, members, normal[best], step, shape)
        if edge is not None:
            edges.append(edge)
        border = border[~on[:, best]]
    return edges


def _checked(flat: _Flat, members: Array, normal: Array, step: float, shape: Plate) -> _Edge | None:
    """Edge along the longest run of border points (K, 2) without a hole; None where too short, or inside the patch."""
    middle = members.mean(axis=0)
    along = np.linalg.svd(members - middle, full_matrices=False)[2][0]
    normal = np.array([-along[1], along[0]])
    places = np.sort(members @ along)
    holes = np.flatnonzero(np.diff(places) > 8 * step)
    runs = np.split(places, holes + 1)
    run = max(runs, key=lambda r: r[-1] - r[0])
    if run[-1] - run[0] < _LEAST_LENGTH * shape.edge_mm:
        return None
    offset = float(np.median(members @ normal))
    alongside = (flat.uv_mm @ along > run[0]) & (flat.uv_mm @ along < run[-1])
    over = flat.uv_mm[alongside] @ normal - offset
    over = over[np.abs(over) < 8 * step]
    outside = np.mean(over > 1.5 * step) if len(over) else 1.0
    inside = np.mean(over < -1.5 * step) if len(over) else 1.0
    if min(outside, inside) > _MOST_OUTSIDE:
        return None
    sign = 1.0 if outside < inside else -1.0
    ends = (float(run[0]), float(run[-1]))
    over = sign * (flat.seen_uv_mm @ normal - offset)
    place = flat.seen_uv_mm @ along
    beyond = (over > 1.5 * step) & (over < 6 * step) & (place > ends[0]) & (place < ends[1])
    count = np.count_nonzero(beyond)
    if count and np.mean(flat.nearer[beyond]) > _MOST_HIDDEN:
        return None
    full = 4.5 * step * (ends[1] - ends[0]) * flat.density
    if count > _LEAST_BEYOND * full:
        return _Edge(sign * normal, sign * offset, along, ends, 1.0)
    edge = _Edge(sign * normal, sign * offset, along, ends, _AT_BORDER)
    rim = _is_rim(flat, edge, over, step)
    return None if rim or _is_shadow(flat, over, place, ends, step, shape) else edge


def _is_rim(flat: _Flat, edge: _Edge, over: Array, step: float) -> bool:
    """Whether the scan's field may end along an edge: no ray goes beyond its line, not even far from the plate.

    over  # (N,) distances, mm, of all rays beyond the line. So ends a plate before a void, too: where a scan shows
    little else, an edge is the plate's if it runs across the rows and columns of the scanner's pixels.
    """
    if np.mean(over > 1.5 * step) > _MOST_BEYOND_RIM:
        return False
    return len(flat.uv_mm) < (1 - _LEAST_ELSE) * len(over) or not _crosses_pixels(flat, edge)


def _crosses_pixels(flat: _Flat, edge: _Edge) -> bool:
    """Whether an edge is oblique to the square grid of the scanner's pixels; False where the points are in no grid."""
    places = edge.outward * edge.offset_mm + np.outer(edge.ends_mm, edge.along)
    across = np.linalg.svd(flat.plane.centre_mm[None])[2][1:]
    seen_at, ends = (
        np.asarray((points / np.linalg.norm(points, axis=1)[:, None]) @ across.T)
        for points in (flat.plane.points_mm, flat.plane.centre_mm + places @ flat.plane.axes)
    )
    nearest = np.asarray(spatial.cKDTree(seen_at).query(seen_at, k=2)[1])[:, 1]
    x, y = np.concatenate([seen_at[nearest] - seen_at, ends[1:] - ends[:1]]).T
    turns = np.exp(4j * np.arctan2(y, x))  # a quarter turn leaves a square grid as it is
    rows = np.mean(turns[:-1])
    off_rad = abs(float(np.angle(turns[-1] / rows))) / 4
    return bool(abs(rows) > _REGULAR / np.sqrt(len(seen_at)) and off_rad > _ALONG_PIXELS_RAD)


def _is_shadow(flat: _Flat, over: Array, place: Array, ends: tuple[float, float], step: float, shape: Plate) -> bool:
    """Whether what is seen first beyond an edge, along most of it, lies before the plane and so shades or hides it.

    over, place  # (N,) of all rays: beyond the edge's line and along it, mm
    """
    near = (over > 1.5 * step) & (over < shape.edge_mm) & (place > ends[0]) & (place < ends[1])
    if not near.any():
        return False
    cells = np.floor((place[near] - ends[0]) / (ends[1] - ends[0]) * _CELLS_ALONG).astype(np.int64)
    order = np.lexsort((over[near], cells))
    _, first = np.unique(cells[order], return_index=True)
    shaded = np.count_nonzero(flat.nearer[near][order][first])
    return bool(shaded > _MOSTLY * _CELLS_ALONG)


def _score(edge: _Edge, shape: Plate) -> float:
    """Length of an edge in mm, at most the plate's, times its weight."""
    return edge.counts * min(edge.ends_mm[1] - edge.ends_mm[0], shape.edge_mm)


def _corner(one: _Edge, other: _Edge, flat: _Flat, shape: Plate) -> Array | None:
    """Intersection (2,) of two edges at the plate's angle and at their ends; None where there is none."""
    angle_deg = 180 - np.degrees(np.arccos(np.clip(one.outward @ other.outward, -1, 1)))
    if abs(angle_deg - shape.angle_deg) > _SAME_ANGLE_DEG:
        return None
    at = np.linalg.solve(np.array([one.outward, other.outward]), np.array([one.offset_mm, other.offset_mm]))
    slack = 4 / np.sqrt(flat.density)
    for edge in (one, other):
        low, high = edge.ends_mm
        place = float(edge.along @ at)
        if min(abs(place - low), abs(place - high)) > slack + 0.05 * shape.edge_mm:
            return None
    return np.asarray(at)


def _refined(corner: Array, one: _Edge, other: _Edge, flat: _Flat, rows: IndexArray, count: int) -> FoundPoint | None:
    """Corner, with covariance, where lines through the outermost points at two edges meet; None for too few points."""
    fitted = [_outermost(edge, corner, flat) for edge in (one, other)]
    if any(fit is None for fit in fitted):
        return None
    (n1, d1, v1), (n2, d2, v2) = (fit for fit in fitted if fit is not None)
    turn = np.linalg.inv(np.array([n1, n2]))
    at = turn @ np.array([d1, d2])
    in_plane = turn @ np.diag([v1, v2]) @ turn.T
    plane = flat.plane
    xyz = plane.centre_mm + at @ plane.axes
    lever = plane.design(xyz[None])[0]
    height = float(lever @ np.linalg.inv(plane_information(plane)) @ lever)
    covariance = plane.axes.T @ in_plane @ plane.axes + max(height, 1e-12) * np.outer(plane.normal, plane.normal)
    pitch = float(np.mean([flat.pitch_mm(n1), flat.pitch_mm(n2)]))
    return FoundPoint(
        xyz,
        covariance,
        len(plane.indices),
        plane.sigma_mm,
        packed(rows[plane.indices], count),
        {"points_apart_mm": pitch, "height_sigma_mm": float(np.sqrt(height))},
    )


def _outermost(edge: _Edge, corner: Array, flat: _Flat) -> tuple[Array, float, float] | None:
    """Line through the outermost points at an edge: outward normal (2,), offset, and its variance at the corner."""
    pitch, width = flat.pitch_mm(edge.outward), flat.pitch_mm(edge.along)
    place = flat.uv_mm @ edge.along
    over = flat.uv_mm @ edge.outward - edge.offset_mm
    near = (np.abs(over) < 4 * pitch) & (place > edge.ends_mm[0]) & (place < edge.ends_mm[1])
    near &= np.abs(place - edge.along @ corner) > 2 * width
    if near.sum() < _ROWS_FEWEST:
        return None
    row = np.floor(place[near] / width).astype(np.int64)
    numbers, where = np.unique(row, return_inverse=True)
    last = np.full(len(numbers), -np.inf)
    np.maximum.at(last, where, over[near])
    middle = (numbers + 0.5) * width - float(edge.along @ corner)
    if len(numbers) < _ROWS_FEWEST:
        return None
    design = np.column_stack([np.ones(len(middle)), middle])
    weight = np.ones(len(last))
    for _ in range(10):
        line = np.linalg.lstsq(design * weight[:, None] ** 0.5, last * weight**0.5, rcond=None)[0]
        residual = last - design @ line
        scale = max(mad_sigma(residual - np.median(residual)), 0.05 * pitch)
        weight = np.clip(1 - (residual / (4.7 * scale)) ** 2, 1e-6, None) ** 2
    inverse = np.linalg.inv((design * weight[:, None]).T @ design)
    variance = inverse[0, 0] * float(weight @ residual**2) / max(float(weight.sum()) - 2, 1.0)
    outward = edge.outward - line[1] * edge.along
    outward = outward / np.linalg.norm(outward)
    at_corner = edge.outward * (edge.offset_mm + line[0] + _GAP * pitch) + edge.along * (edge.along @ corner)
    return outward, float(outward @ at_corner), float(variance + (_GAP_SIGMA * pitch) ** 2)
