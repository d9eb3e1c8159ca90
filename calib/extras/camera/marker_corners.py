"""Corners of a printed marker, refined as the places where its four edges meet.

Blur rounds a corner, which then seems to lie further inside: by 0.2 pixels in a sharp image and 1 in a soft one, for
each of a marker's four, so that it seems smaller and farther away. An edge stays where it is. So each side is found
at many places along it, as the mean of the rise from black to white across it, a line is laid through these, and the
lines are intersected. On long sides, which a lens bends visibly, it is a parabola.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np

from calib.array_types import Array
from calib.statistics import mad_sigma

_REACHES = (0.08, 0.04, 0.025)  # across an edge in turn, of the marker's extent there, less than the black border
_FROM_CORNERS = 0.12  # of a side, left out at its ends
_LEAST_REACH_PX = 3.0
_MOST_REACH = 0.12  # of the extent, where the least reach is more
_LEAST_RISE = 0.3  # of the steepest rise across an edge: less is noise, or another edge
_STEP_PX = 0.5
_FEWEST = 5  # places along a side
_PLACES = 40  # along a side, while the edges are only approached
_LONG_PX = 150.0  # sides on which the lens shows
_FAR = 3.0  # sigmas
_LEAST_SPREAD_PX = 0.02
_MOST_MOVED = 0.15  # of a side: a corner that moves by more was none


def refined_corners(cv2: ModuleType, picture: Array, corners_px: Array) -> Array:
    """Corners (4, 2) of a marker, clockwise in the image, where its edges meet; as given where no edges are found."""
    found = corners_px
    for share in _REACHES:
        most = None if share == _REACHES[-1] else _PLACES
        around = [np.roll(found, -k, axis=0) for k in range(4)]
        sides = [side for four in around if (side := _edge(cv2, picture, four, share, most)) is not None]
        if len(sides) < 4:
            return corners_px
        found = np.array([_meeting(sides[k - 1], sides[k], found[k]) for k in range(4)])
    size_px = float(np.linalg.norm(corners_px[0] - corners_px[2])) / np.sqrt(2.0)
    return corners_px if np.abs(found - corners_px).max() > _MOST_MOVED * size_px else found


def _edge(
    cv2: ModuleType, picture: Array, corners_px: Array, share: float, most: int | None
) -> tuple[Array, Array, Array] | None:
    """A side as its start, its direction (2,), and a polynomial of the shift to the outside; None where none is seen.

    The side is that between the first two corners (4, 2); the share is that of the marker's extent within which its
    edge is sought, at `most` places or one a pixel. The polynomial is of the way along the side, pixels, the highest
    power first.
    """
    start, end = corners_px[:2]
    length = float(np.linalg.norm(end - start))
    if length < 2 * _LEAST_REACH_PX:
        return None
    along = (end - start) / length
    outwards = np.array([along[1], -along[0]])  # clockwise, with v downwards
    extent = min(length, float(np.mean((start - corners_px[2:]) @ outwards)))  # of a tilted marker, the less
    reach = min(max(_LEAST_REACH_PX, share * extent), _MOST_REACH * extent)
    if reach < 2.0 * _STEP_PX:
        return None
    count = max(2 * _FEWEST, int(length))
    way = np.linspace(_FROM_CORNERS, 1.0 - _FROM_CORNERS, min(count, most or count)) * length
    across = np.arange(-reach, reach + 0.5 * _STEP_PX, _STEP_PX)
    places = start + way[:, None, None] * along + across[None, :, None] * outwards
    seen = cv2.remap(picture, *np.moveaxis(places, -1, 0).astype(np.float32), cv2.INTER_LINEAR).astype(float)
    rise = np.maximum(np.diff(seen, axis=1), 0.0)
    rise = np.maximum(rise - _LEAST_RISE * rise.max(axis=1, keepdims=True), 0.0) ** 2
    total = rise.sum(axis=1)
    shift = rise @ (0.5 * (across[1:] + across[:-1])) / np.maximum(total, 1e-9)
    kept = (total > 0) & (np.abs(shift) < 0.8 * reach)
    degree = 2 if length > _LONG_PX else 1
    for _ in range(3):
        if kept.sum() < _FEWEST:
            return None
        powers = np.vander(way[kept] / length, degree + 1)
        line = np.linalg.solve(powers.T @ powers, powers.T @ shift[kept]) / length ** np.arange(degree, -1, -1)
        off = np.abs(shift - np.polyval(line, way))
        kept &= off < _FAR * max(mad_sigma(off[kept]), _LEAST_SPREAD_PX)
    return start, along, line


def _meeting(one: tuple[Array, Array, Array], other: tuple[Array, Array, Array], near: Array) -> Array:
    """Point (2,) where two sides meet, by their tangents near a point."""
    normals, offsets = [], []
    for start, along, line in (one, other):
        outwards = np.array([along[1], -along[0]])
        way = float((near - start) @ along)
        slope, height = float(np.polyval(np.polyder(line), way)), float(np.polyval(line, way))
        normal = outwards - slope * along
        normals.append(normal)
        offsets.append(float(normal @ (start + way * along + height * outwards)))
    return np.asarray(np.linalg.solve(np.array(normals), np.array(offsets)))
