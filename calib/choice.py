"""Which three planes are the jig's faces.

Jang chooses three groups with perpendicular normals and near centres. Beside a box, or in a room, several triples are
perpendicular; what tells the jig is its outline. Seen from the apex each face is a right triangle with legs of the
jig's edge: a plane of the jig fills its triangle and ends there, others leave it empty or spill over. A candidate is
worth what its weakest face is worth.

A face that got no group of its own (nearly edge-on, or mostly hidden) is voted for: the two other planes leave one
direction for its normal, and its points agree on one offset along it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.clustering import PlaneGroup
from calib.jig import Jig
from calib.normals import Neighbourhoods

_CELLS = 12  # cells along an edge when a face's area is counted
_TRIANGLE_CELLS = _CELLS * (_CELLS - 1) // 2  # whole cells in the triangle
_MOST_GROUPS = 60
_MOST_PEAKS = 4
_CLEAR = 0.03  # of the edge: voters keep this distance from the other two faces and the far edge


@dataclass(frozen=True)
class ChoiceTolerances:
    """When three planes are the jig."""

    perpendicular_rad: float
    member_normal_rad: float  # a point belongs to a plane if its own normal agrees to this
    height_mm: float  # ... and its height over the plane is below this
    # What the best, the second and the weakest face have to be worth. A cube's square face, of whatever size, is worth
    # 0.75 at most as a triangle, so no box passes the first two. A jig in plain view reaches 1.0 and 0.92.
    least_worth: tuple[float, float, float] = (0.9, 0.8, 0.06)
    min_votes: int = 12


@dataclass(frozen=True)
class FaceChoice:
    """The three planes that are taken for the jig's faces."""

    groups: tuple[PlaneGroup, ...]  # all groups; where a face was voted for, it is the last and has no sets
    chosen: tuple[int, int, int]  # indices into groups
    worth: NDArray  # (3,) share of the face that has points, less what spills over it


def choose_faces(
    points_mm: NDArray,
    groups: Sequence[PlaneGroup],
    around: Neighbourhoods,
    jig: Jig,
    tolerances: ChoiceTolerances,
) -> FaceChoice | str:
    """The three planes that look most like the jig, or the reason why none do, with numbers and a way out.

    points_mm  # (N, 3) the whole scan; `around` its thinned points with normals.
    """
    planes = _Planes(groups, around, jig, tolerances)
    triples = planes.triples()
    found = _best(triples, tolerances) or _best(_vote_third_faces(points_mm, planes), tolerances)
    if found is not None:
        return found
    mirrored = replace(jig, convex=not jig.convex)
    if _best(_Planes(groups, around, mirrored, tolerances).triples(), tolerances) is not None:
        seen, said = ("away from", "true") if jig.convex else ("toward", "false")
        return (
            f"found a corner of the jig's size whose apex points {seen} the scanner, but the jig is described with "
            f"convex = {said}; check convex in dataset.toml, and that the scanner is the origin of the scan's frame"
        )
    return _why_none(planes, triples, jig)


class _Planes:
    """The groups' planes with every thinned point's height over each, which is all that the scoring needs."""

    def __init__(
        self, groups: Sequence[PlaneGroup], around: Neighbourhoods, jig: Jig, tolerances: ChoiceTolerances
    ) -> None:
        self.groups = tuple(groups)
        large = self.groups[:_MOST_GROUPS]
        self.normals = np.array([g.normal for g in large]).reshape(-1, 3)
        self.offsets = np.array([g.offset_mm for g in large])
        self.heights = around.points_mm @ self.normals.T - self.offsets  # (V, G)
        self.around = around
        self.tolerances = tolerances
        self.members = [self.on_plane(n, d) for n, d in zip(self.normals, self.offsets, strict=True)]
        self.perpendicular = np.abs(self.normals @ self.normals.T) <= np.sin(tolerances.perpendicular_rad)
        self.edge_mm = jig.edge_mm
        # Along an edge, away from the apex, the height over the plane that the edge leaves falls on a convex corner.
        self.sign = -1.0 if jig.convex else 1.0

    def on_plane(self, normal: NDArray, offset_mm: float) -> NDArray:
        """Indices of the thinned points at a plane whose own normals agree with it."""
        near = np.abs(self.around.points_mm @ normal - offset_mm) <= self.tolerances.height_mm
        agree = self.around.normals @ normal >= np.cos(self.tolerances.member_normal_rad)
        return np.flatnonzero(near & agree)

    def triples(self) -> list[FaceChoice]:
        """All triples of perpendicular planes with what each is worth."""
        found = []
        for i, j in np.argwhere(np.triu(self.perpendicular)).tolist():
            for k in np.flatnonzero(self.perpendicular[i] & self.perpendicular[j]).tolist():
                if k > j:
                    worth = [self.worth(i, (j, k)), self.worth(j, (i, k)), self.worth(k, (i, j))]
                    found.append(FaceChoice(self.groups, (i, j, k), np.array(worth)))
        return found

    def strip(self, pair: tuple[int, int]) -> NDArray:
        """Members of the first plane that could be a face which meets the second: from the edge to its length away."""
        members = self.members[pair[0]]
        along = self.sign * self.heights[members, pair[1]]
        return members[(along > -0.1 * self.edge_mm) & (along < self.edge_mm)]

    def worth(self, face: int, others: tuple[int, int]) -> float:
        """Worth of one plane as the face between the two edges that leave the planes `others`."""
        return outline_worth(
            self.sign * self.heights[np.ix_(self.members[face], np.array(others))], self.edge_mm
        )


def outline_worth(along_mm: NDArray, edge_mm: float) -> float:
    """Share of a face's triangle that has points, less the area (in triangles) of the points that spill over it.

    along_mm  # (K, 2) coordinates of the plane's points along the face's two edges, from the apex. Both areas are
    counted in cells of a twelfth of the edge, so that the density of the points does not matter.
    """
    a, b = along_mm.T / edge_mm
    near = (a > -0.5) & (b > -0.5) & (a < 1.5) & (b < 1.5)
    a, b = a[near], b[near]
    i, j = np.floor(a * _CELLS).astype(int), np.floor(b * _CELLS).astype(int)
    key = (i + _CELLS) * 4 * _CELLS + j + _CELLS
    inside = (i >= 0) & (j >= 0) & (i + j <= _CELLS - 2)
    margin = 0.5 / _CELLS
    spills = (a < -margin) | (b < -margin) | (a + b > 1 + 1.5 * margin)
    filled, spilt = len(np.unique(key[inside])), len(np.unique(key[spills]))
    return filled / _TRIANGLE_CELLS - spilt / (_CELLS**2 / 2)


def _best(candidates: Sequence[FaceChoice], tolerances: ChoiceTolerances) -> FaceChoice | None:
    """The candidate with the most worth in its weakest face, of those whose faces all reach what they have to."""

    def is_jig(candidate: FaceChoice) -> bool:
        return bool(np.all(np.sort(candidate.worth)[::-1] >= tolerances.least_worth))

    return max(filter(is_jig, candidates), key=lambda c: float(c.worth.min()), default=None)


def _vote_third_faces(points_mm: NDArray, planes: _Planes) -> list[FaceChoice]:
    """Candidates of two perpendicular planes each, whose third face is voted for by the points of the whole scan."""
    found = []
    for i, j in np.argwhere(np.triu(planes.perpendicular)).tolist():
        found += _vote(points_mm, planes, (i, j))
    return found


def _vote(points_mm: NDArray, planes: _Planes, pair: tuple[int, int]) -> list[FaceChoice]:
    """Candidates with the two planes `pair`.

    The third normal is n_1 x n_2 on the scanner's side. All points (N, 3) that lie over the third face's triangle
    vote with their height along it, and the fullest bands are tried as its offset.
    """
    edge_mm, height_mm = planes.edge_mm, planes.tolerances.height_mm
    thinned_mm = planes.around.points_mm
    strips = [thinned_mm[m] for m in (planes.strip(pair), planes.strip(pair[::-1]))]
    if min(map(len, strips)) < planes.tolerances.min_votes:
        return []
    normals, offsets = planes.normals[list(pair)], planes.offsets[list(pair)]
    third = np.cross(*normals)
    third /= np.linalg.norm(third)
    if third @ strips[0].mean(axis=0) > 0:
        third = -third
    along = planes.sign * (points_mm @ normals.T - offsets)
    over = np.all(along > _CLEAR * edge_mm, axis=1) & (along.sum(axis=1) < (1 - _CLEAR) * edge_mm)
    along, height = along[over], points_mm[over] @ third
    found = []
    for offset in _fullest_bands(height, height_mm / 2, planes.tolerances.min_votes):
        worth = []
        for face, other in (pair, pair[::-1]):
            members = planes.members[face]
            heights = np.column_stack([planes.heights[members, other], thinned_mm[members] @ third - offset])
            worth.append(outline_worth(planes.sign * heights, edge_mm))
        on = np.abs(height - offset) <= height_mm / 2
        # The voters all lie inside the outline, so they cannot spill: a voted face is never one of the two best.
        worth.append(min(outline_worth(along[on], edge_mm), *worth))
        centre = points_mm[over][on].mean(axis=0)
        voted = PlaneGroup(np.zeros(0, dtype=np.int64), centre, third, offset)
        found.append(FaceChoice((*planes.groups, voted), (*pair, len(planes.groups)), np.array(worth)))
    return found


def _fullest_bands(height_mm: NDArray, width_mm: float, min_votes: int) -> list[float]:
    """Middles of the fullest bands of the given width, the fullest first; none overlaps a fuller one."""
    order = np.sort(height_mm)
    bands: list[float] = []
    count = np.searchsorted(order, order + width_mm, side="right") - np.arange(len(order))
    for start in np.argsort(-count, kind="stable"):
        if count[start] < min_votes or len(bands) == _MOST_PEAKS:
            break
        middle = float(np.median(order[start : start + count[start]]))
        if all(abs(middle - other) > 2 * width_mm for other in bands):
            bands.append(middle)
    return bands


def _why_none(planes: _Planes, triples: Sequence[FaceChoice], jig: Jig) -> str:
    """Why no three planes are the jig."""
    count = len(planes.groups)
    sizes = [f"{len(m)}" for m in planes.members[:3]]
    if count < 3:
        found = f"found {count} plane{'s' * (count != 1)}" + (
            f" ({' and '.join(sizes)} points)" if sizes else ""
        )
        return f"{found}, a corner needs 3; turn the jig so that three faces are seen, or scan it finer"
    if not triples:
        return (
            f"found {count} planes (the largest of {', '.join(sizes)} points), no three of them perpendicular; "
            "turn the jig so that three faces are seen, or scan it finer"
        )
    best = max(triples, key=lambda c: float(np.sort(c.worth)[1]))
    filled = ", ".join(f"{max(w, 0):.0%}" for w in np.sort(best.worth))
    return (
        f"found {len(triples)} triples of perpendicular planes, but none with the outline of a jig of edge "
        f"{jig.edge_mm:g} mm (the best fills {filled} of its faces); check edge_mm, and that the jig is in full view"
    )
