"""Length of a jig's edges where nobody has told it, measured on the three faces that a search finds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import combinations

import numpy as np

from calib.array_types import Array
from calib.corners.search import CornerSearch, find_corner
from calib.jig import Jig
from calib.scans.scan import Scan

_GUESSES_MM = (60.0, 150.0, 25.0)  # by which planes are looked for; they need not be a jig's of that size
_MOST_PLANES = 6  # with the most sample sets
_SQUARE = 0.1  # cosine between faces, at the most
_BESIDE = 0.1  # of the guess: points so near to an edge tell how long it is
_BAND, _GAP = 1 / 60, 1 / 6  # of the guess: thickness of a face, and free way beyond its end
_RECTANGLE = 1.35  # of an edge: sum of both coordinates that points of a triangle do not reach
_END = 0.99  # quantile of the points along an edge
_STEP_MM, _NEAR_STEP = 5.0, 0.025  # jigs are made in steps; a measured length so near to one is taken for it
_FEWEST = 8
_ALIKE = 0.04  # by which the edges of a jig of one length, and those of several scans, differ at the most


def measured_edge_mm(scans: Iterable[Scan]) -> float | None:
    """Length of the jig's edges by which most of some scans show its corner; None where they do not.

    Planes that are square to each other are taken from a search with a guessed length; how far they reach along their
    edges counts where a search with that length finds the corner.
    """
    found = [_edge_of(scan) for scan in scans]
    lengths = [length for length in found if length is not None]
    middle = float(np.median(lengths)) if lengths else 0.0
    near = [length for length in lengths if abs(length - middle) <= max(_ALIKE * middle, 1.0)]
    if 2 * len(near) <= len(found):
        return None
    step = _STEP_MM * round(middle / _STEP_MM)
    return step if abs(step - middle) <= _NEAR_STEP * middle else float(round(middle))


def _edge_of(scan: Scan) -> float | None:
    for guess_mm in _GUESSES_MM:
        for length in _lengths(scan, find_corner(scan, jig_of_edge(guess_mm)), guess_mm):
            if find_corner(scan, jig_of_edge(length)).corner is not None:
                return length
    return None


def jig_of_edge(edge_mm: float) -> Jig:
    """Jig of three equal edges whose faces may be triangles or squares."""
    return Jig(edge_mm=(edge_mm,) * 3)


def _lengths(scan: Scan, search: CornerSearch, guess_mm: float) -> Iterator[float]:
    """Lengths to which planes of a search reach along their edges, where all six edges of a corner agree."""
    planes = sorted(search.groups, key=lambda plane: -len(plane.sets))[:_MOST_PLANES]
    for three in combinations(planes, 3):
        normals = np.stack([plane.normal for plane in three])
        if np.abs(normals @ normals.T - np.eye(3)).max() > _SQUARE:
            continue
        heights = scan.points_mm @ normals.T - [plane.offset_mm for plane in three]
        ends: list[float] = []
        for face in range(3):
            on = -heights[np.abs(heights[:, face]) < _BAND * guess_mm]
            one, other = (on[:, k] for k in range(3) if k != face)
            ends += [_end(one, other, guess_mm), _end(other, one, guess_mm)]
        if min(ends) > 0.0 and np.ptp(ends) <= 2.0 * _ALIKE * max(ends):
            yield float(np.median(ends))


def _end(along: Array, across: Array, guess_mm: float) -> float:
    """How far a face reaches along an edge, by its points beside it; 0 where there are few."""
    inside = (along > 0.0) & (across > 0.0)
    along, across = along[inside], across[inside]
    beside = across < _BESIDE * guess_mm
    order = np.argsort(along[beside])
    reach, sums = along[beside][order], (along + across)[beside][order]
    if len(reach) < _FEWEST:
        return 0.0
    gaps = np.flatnonzero(np.diff(reach) > _GAP * guess_mm)
    end = int(gaps[0]) + 1 if len(gaps) else len(reach)
    length = float(np.quantile(reach[:end], _END))
    of_face = (along + across)[(along < length) & (across < length)]
    is_rectangle = bool(np.quantile(of_face, _END) > _RECTANGLE * length)
    return float(np.quantile((reach if is_rectangle else sums)[:end], _END)) / _END
