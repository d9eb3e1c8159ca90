"""Corners of a printed marker, refined as the places where its four edges meet.

Blur rounds a corner, which then seems to lie further inside: by 0.2 pixels in a sharp image and 1 in a soft one, for
each of a marker's four, so that it seems smaller and farther away. An edge stays where it is. So each side is found
at many places along it, as the mean of the rise from black to white across it. A lens bends the sides of a marker in
the image: the places are freed of its distortion, lines are laid through them, and where these meet is seen through
the lens again.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np

from calib.array_types import Array
from calib.extras.camera.lens import Lens, project
from calib.statistics import mad_sigma

_REACHES = (0.08, 0.04, 0.025)  # across an edge in turn, of the marker's extent there, less than the black border
_FROM_CORNERS = 0.12  # of a side, left out at its ends
_LEAST_REACH_PX = 3.0
_MOST_REACH = 0.12  # of the extent, where the least reach is more
_LEAST_RISE = 0.3  # of the steepest rise across an edge: less is noise, or another edge
_STEP_PX = 0.5
_FEWEST = 5  # places along a side
_PLACES = 40  # along a side, while the edges are only approached
_FAR = 3.0  # sigmas
_LEAST_SPREAD_PX = 0.02
_MOST_MOVED = 0.15  # of a side: a corner that moves by more was none
_UNDISTORTED = (3, 100, 1e-12)  # rounds and precision of OpenCV's search


def refined_corners(cv2: ModuleType, picture: Array, corners_px: Array, lens: Lens) -> Array:
    """Corners (4, 2) of a marker, clockwise in the image, where its edges meet; as given where no edges are found."""
    found = corners_px
    for share in _REACHES:
        most = None if share == _REACHES[-1] else _PLACES
        around = [np.roll(found, -k, axis=0) for k in range(4)]
        sides = [side for four in around if (side := _edge(cv2, picture, four, lens, share, most)) is not None]
        if len(sides) < 4:
            return corners_px
        met = np.cross(sides, np.roll(sides, 1, axis=0))
        found = project(lens, met / met[:, 2:])
    size_px = float(np.linalg.norm(corners_px[0] - corners_px[2])) / np.sqrt(2.0)
    return corners_px if not np.abs(found - corners_px).max() < _MOST_MOVED * size_px else found


def _edge(
    cv2: ModuleType, picture: Array, corners_px: Array, lens: Lens, share: float, most: int | None
) -> Array | None:
    """A side as the line (3,) of its sights (x, y, 1), which is zero there; None where none is seen.

    The side is that between the first two corners (4, 2); the share is that of the marker's extent within which its
    edge is sought, at `most` places or one a pixel.
    """
    start, end = corners_px[:2]
    length = float(np.linalg.norm(end - start))
    if length < 2 * _LEAST_REACH_PX:
        return None
    across_px = np.array([end[1] - start[1], start[0] - end[0]]) / length  # to the outside: clockwise, v downwards
    extent = min(length, float(np.mean((start - corners_px[2:]) @ across_px)))  # of a tilted marker, the less
    reach = min(max(_LEAST_REACH_PX, share * extent), _MOST_REACH * extent)
    if reach < 2.0 * _STEP_PX:
        return None
    count = max(2 * _FEWEST, int(length))
    way = np.linspace(_FROM_CORNERS, 1.0 - _FROM_CORNERS, min(count, most or count))[:, None]
    ends = _sights(cv2, corners_px[:2], lens)
    middle = project(lens, ends[0] + way * (ends[1] - ends[0]))  # of a line that the lens bends
    along = np.gradient(middle, axis=0)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    outwards = np.column_stack([along[:, 1], -along[:, 0]])
    across = np.arange(-reach, reach + 0.5 * _STEP_PX, _STEP_PX)
    places = middle[:, None] + across[:, None] * outwards[:, None]
    seen = cv2.remap(picture, *np.moveaxis(places, -1, 0).astype(np.float32), cv2.INTER_LINEAR).astype(float)
    rise = np.maximum(np.diff(seen, axis=1), 0.0)
    rise = np.maximum(rise - _LEAST_RISE * rise.max(axis=1, keepdims=True), 0.0) ** 2
    total = rise.sum(axis=1)
    shift = rise @ (0.5 * (across[1:] + across[:-1])) / np.maximum(total, 1e-9)
    kept = (total > 0) & (np.abs(shift) < 0.8 * reach)
    sights = _sights(cv2, middle + shift[:, None] * outwards, lens)
    for _ in range(3):
        if kept.sum() < _FEWEST:
            return None
        centre = sights[kept].mean(axis=0)
        normal = np.linalg.svd((sights[kept] - centre)[:, :2])[2][1]
        line = np.array([*normal, -normal @ centre[:2]])
        off = np.abs(sights @ line) * lens.numbers[0]
        kept &= off < _FAR * max(mad_sigma(off[kept]), _LEAST_SPREAD_PX)
    return line


def _sights(cv2: ModuleType, pixels: Array, lens: Lens) -> Array:
    """Sights (N, 3), x, y and 1 in the camera's frame, along which pixels (N, 2) are seen."""
    found = cv2.undistortPointsIter(pixels[:, None], lens.matrix, lens.distortion, None, None, _UNDISTORTED)
    return np.column_stack([found[:, 0], np.ones(len(pixels))])
