"""Three planes that may be the jig's faces, and how much they look like it.

A face's score is the share of its outline's area that has points less the share that is wrong: seen through, or of
points of the same plane beyond its edges. All lengths come from the heights of the scan's thinned points over the
planes: along an edge, away from the apex, the height over the plane that the edge leaves falls on a convex corner.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.corners.faces.face_outline import FaceOutline, outline_shares
from calib.corners.intersection import intersect
from calib.jig import Jig, Outline
from calib.planes.clustering import PlaneGroup
from calib.planes.normals import Neighbourhoods

_MOST_GROUPS = 60
# Of the triples, those whose faces have the most points; a jig in clutter is among the first few.
_MOST_SCORED = 60
_MOST_PAIRS = 20  # for which a third face is voted
_WALL = 3.0  # largest rectangles between two of the jig's edges; a plane with more area is no face of it


@dataclass(frozen=True)
class SelectionTolerances:
    """What three planes have to satisfy to be the jig's faces."""

    perpendicular_rad: float
    member_normal_rad: float  # a point belongs to a plane if its own normal agrees to this
    height_mm: float  # ... and its height over the plane is below this
    # Least scores of the best, the second and the weakest face. A cube's square face, of whatever size, scores 0.75 at
    # most as a triangle, so no box passes the first. A jig in plain view reaches 1.0 and 0.92; the second face may be
    # half hidden.
    least_scores: tuple[float, float, float] = (0.85, 0.4, 0.04)
    least_of_box: float = (
        0.6  # in place of the first where whole rectangles are compared: it may stand among others
    )
    most_wrong: float = (
        0.2  # share of a face that may be wrong; the edges of a scanned face are never quite sharp
    )
    min_votes: int = 6


@dataclass(frozen=True)
class FaceTriple:
    """Three planes that may be the jig's faces."""

    groups: tuple[PlaneGroup, ...]  # all groups; where a face was voted for, it is the last and has no sets
    chosen: tuple[int, int, int]  # indices into groups
    score: Array  # (3,) share of the face that has points, less the share that is wrong
    outline: Outline  # the jig's that fits best; edge i leaves the plane chosen[i]
    wrong: Array  # (3,) area seen through the face, or of points of its plane beyond its edges, as a share of the face

    def is_jig(self, tolerances: SelectionTolerances) -> bool:
        """Whether the faces all reach the least scores."""
        best, second, weakest = tolerances.least_scores
        if self.outline.rectangular:
            best = tolerances.least_of_box
        enough = np.all(np.sort(self.score) >= (weakest, second, best))
        return bool(enough and self.wrong.max() <= tolerances.most_wrong)


@dataclass(frozen=True)
class _Face:
    """One of three planes: the thinned points at it."""

    heights: Array  # (V,) over the plane
    on: IndexArray  # (K,) points within the height tolerance
    agrees: BoolArray  # (K,) whether their own normals are the plane's
    offset_mm: float


class Planes:
    """The groups' planes with every thinned point's height over each, which is all that the scoring needs."""

    def __init__(
        self, groups: Sequence[PlaneGroup], around: Neighbourhoods, jig: Jig, tolerances: SelectionTolerances
    ) -> None:
        self.groups = tuple(groups)
        large = self.groups[:_MOST_GROUPS]
        self.normals = np.array([g.normal for g in large]).reshape(-1, 3)
        self.offsets = np.array([g.offset_mm for g in large])
        self.around = around
        self.tolerances = tolerances
        self.heights = self.normals @ around.points_mm.T - self.offsets[:, None]  # (G, V)
        self.faces = [
            self._face(*plane) for plane in zip(self.normals, self.offsets, self.heights, strict=True)
        ]
        self.members = [face.on[face.agrees] for face in self.faces]
        self.perpendicular = np.abs(self.normals @ self.normals.T) <= np.sin(tolerances.perpendicular_rad)
        self.jig = jig
        self.outlines = jig.outlines()
        self.face_outlines = {FaceOutline.of(o, face) for o in self.outlines for face in range(3)}
        self.sign = -1.0 if jig.convex else 1.0

    def _face(self, normal: Array, offset_mm: float, heights: Array) -> _Face:
        on = np.flatnonzero(np.abs(heights) <= self.tolerances.height_mm)
        agrees = self.around.normals.take(on, axis=0) @ normal >= np.cos(self.tolerances.member_normal_rad)
        return _Face(heights, on, agrees, float(offset_mm))

    def walls(self) -> list[PlaneGroup]:
        """The planes that have far more points than a face of the jig can."""
        _, middle_mm, longest_mm = sorted(self.jig.edges_mm)
        most = _WALL * middle_mm * longest_mm
        return [
            group
            for group, members in zip(self.groups, self.members, strict=False)
            if len(members) and len(members) * self.around.spacing_mm(members) ** 2 > most
        ]

    @cached_property
    def solid(self) -> IndexArray:
        """Indices of the points of a surface, no stray ones."""
        return np.flatnonzero(self.around.thickness_mm < self.tolerances.height_mm)

    @cached_property
    def squared_mm2(self) -> Array:
        """(V,) squared distances from the scanner."""
        return np.asarray(np.einsum("vi,vi->v", self.around.points_mm, self.around.points_mm))

    @cached_property
    def triples(self) -> list[FaceTriple]:
        """The triples of perpendicular planes with their scores; of very many those that have the most points."""
        return [self.candidate((i, j, k)) for i, j, k in self.likeliest_triples().tolist()]

    @cached_property
    def perpendicular_triples(self) -> IndexArray:
        """(T, 3) indices of perpendicular planes, in ascending order."""
        found = []
        for i, j in np.argwhere(np.triu(self.perpendicular)).tolist():
            both = np.flatnonzero(self.perpendicular[i] & self.perpendicular[j])
            found += [(i, j, k) for k in both[both > j].tolist()]
        return np.array(found, dtype=np.int64).reshape(-1, 3)

    def likeliest_triples(self) -> IndexArray:
        """(T, 3) the triples worth a score: of many those with the most points on their three faces."""
        triples = self.perpendicular_triples
        if len(triples) <= _MOST_SCORED:
            return triples
        in_reach = (np.abs(self.sign * self.heights / self.jig.longest_mm - 0.5) <= 0.5).astype(np.float32)
        points = np.zeros(len(triples))
        for plane in np.unique(triples):
            reach = in_reach.take(self.faces[plane].on, axis=1)
            shared = np.sqrt(reach @ reach.T)
            for face in range(3):
                of_plane = np.flatnonzero(triples[:, face] == plane)
                one, other = np.delete(triples[of_plane], face, axis=1).T
                points[of_plane] += shared[one, other]
        return triples[np.argsort(-points, kind="stable")[:_MOST_SCORED]]

    @cached_property
    def likeliest_pairs(self) -> list[tuple[int, int]]:
        """Perpendicular planes that may be two of the faces: of many those whose weaker face has the most points."""
        pairs = [(i, j) for i, j in np.argwhere(np.triu(self.perpendicular)).tolist()]
        if len(pairs) > _MOST_PAIRS:
            pairs.sort(key=lambda pair: -min(len(self.strip(pair)), len(self.strip(pair[::-1]))))
        return pairs[:_MOST_PAIRS]

    def strip(self, pair: tuple[int, int]) -> IndexArray:
        """Members of the first plane that could be a face which meets the second: from the edge to its length away."""
        members = self.members[pair[0]]
        along = self.sign * self.heights[pair[1]].take(members)
        return members[(along > -0.1 * self.jig.shortest_mm) & (along < self.jig.longest_mm)]

    def could_be_face(self, strip: IndexArray) -> bool:
        """Whether the points `strip` are as many as cover the least share of a face that one of two good ones has."""
        one, other, _ = sorted(self.jig.edges_mm)
        a_face = 0.5 * one * other / self.around.spacing_mm(strip) ** 2
        return len(strip) > 0.5 * self.tolerances.least_scores[1] * a_face

    def candidate(self, chosen: tuple[int, int, int], voted: PlaneGroup | None = None) -> FaceTriple:
        """Three planes with the score of each as the face between the edges in which it meets the two others.

        chosen are indices of groups, the last of them len(groups) where a plane `voted` takes part. Of several outlines
        of the jig the one with the highest score is taken. Where the faces do not reach the least scores by the area
        that has points, it is not counted what is seen through them.
        """
        groups = self.groups if voted is None else (*self.groups, voted)
        faces = [self.faces[g] for g in chosen if g < len(self.faces)]
        if voted is not None:
            heights = self.around.points_mm @ voted.normal - voted.offset_mm
            faces.append(self._face(voted.normal, voted.offset_mm, heights))
        normals = np.array([groups[g].normal for g in chosen])
        apex = intersect(normals, np.array([face.offset_mm for face in faces]))
        # |p x a|^2 = |p|^2 |a|^2 - (p . a)^2, so near the ray to the apex is:
        near = (self.around.points_mm @ apex) ** 2 > (self.squared_mm2 - (1.5 * self.jig.longest_mm) ** 2) * (
            apex @ apex
        )
        spacing_mm = self.around.spacing_mm(near) if near.any() else 0.0
        nothing = np.zeros((0, 2))
        on = [self._along(faces, face) for face in range(3)]
        triple = self._scored(groups, chosen, on, [nothing] * 3, spacing_mm)
        if not triple.is_jig(self.tolerances):
            return triple
        behind = self.solid[near[self.solid]]
        return self._scored(
            groups, chosen, on, [self._through(faces, face, behind) for face in range(3)], spacing_mm
        )

    def _along(self, faces: Sequence[_Face], face: int) -> tuple[Array, BoolArray]:
        """A plane's points (K, 2) along the two edges of the face, and whether their normals are the plane's."""
        at = faces[face]
        along = np.stack([self.sign * other.heights.take(at.on) for other in faces if other is not at])
        beside = np.flatnonzero(np.all(np.abs(along / self.jig.longest_mm - 0.75) < 1.25, axis=0))
        return along.take(beside, axis=1).T, at.agrees[beside]

    def _through(self, faces: Sequence[_Face], face: int, behind: IndexArray) -> Array:
        """Where (M, 2) along a face's edges the rays of the points `behind` went through it; the scanner is the origin.

        The ray to a point of height h over the plane n . p = d meets the plane at the share d / (h + d) of its length.
        """
        at = faces[face]
        heights = at.heights.take(behind)
        seen = np.flatnonzero((heights < -2 * self.tolerances.height_mm) & (heights + at.offset_mm < 0))
        behind, share = behind[seen], at.offset_mm / (heights[seen] + at.offset_mm)
        others = (other for other in faces if other is not at)
        through = self.sign * np.stack(
            [(o.heights.take(behind) + o.offset_mm) * share - o.offset_mm for o in others]
        )
        over = np.all(np.abs(through / self.jig.longest_mm - 0.5) < 0.6, axis=0)
        return through[:, over].T

    def _scored(
        self,
        groups: tuple[PlaneGroup, ...],
        chosen: tuple[int, int, int],
        on: Sequence[tuple[Array, BoolArray]],
        through_mm: Sequence[Array],
        spacing_mm: float,
    ) -> FaceTriple:
        shares = {
            (face, outline): outline_shares(*on[face], through_mm[face], outline, spacing_mm)
            for face in range(3)
            for outline in self.face_outlines
        }
        triples = []
        for whole in self.outlines:
            areas = np.array([shares[face, FaceOutline.of(whole, face)] for face in range(3)])
            filled, spilt, seen_through = areas.T
            # One face may be mostly broken or cut away, and points be seen through it.
            seen_through[np.argmin(filled - spilt - seen_through)] = 0.0
            wrong = spilt + seen_through
            triples.append(FaceTriple(groups, chosen, filled - wrong, whole, wrong))
        return max(triples, key=lambda triple: (triple.is_jig(self.tolerances), float(triple.score.sum())))
