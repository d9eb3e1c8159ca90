"""Triples of planes that may be the jig's faces, scored by how well the points fit the jig's outline.

A face's score is the share of its outline's area that has points less the share that is wrong: seen through, or with
points of the same plane beyond its edges. All lengths come from the heights of the scan's thinned points over the
planes: along an edge, away from the apex, the height over the plane that the edge leaves falls on a convex corner.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from calib.array_types import Array, BoolArray, IndexArray, Vector
from calib.corners.faces.face_outline import FaceOutline, filled_share, outline_shares
from calib.corners.intersection import intersect
from calib.jig import Jig, Outline
from calib.planes.clustering import PlaneGroup
from calib.planes.normals import Neighbourhoods

_MOST_GROUPS = 60
# Of the triples, those whose faces have the most points; a jig in clutter is among the first few.
_MOST_SCORED = 40
_ENOUGH_TO_COUNT = 1000  # of a plane's points, to know its share within reach of two others
_MOST_PAIRS = 20  # for which a third face is voted
_WORTH_A_WORD = 0.02  # share of mirrored points
_WALL = 3.0  # largest rectangles between two of the jig's edges; a plane with more area is no face of it


@dataclass(frozen=True)
class SelectionTolerances:
    """Conditions that three planes have to satisfy to be the jig's faces."""

    perpendicular_rad: float
    member_normal_rad: float  # a point belongs to a plane if its own normal agrees to this
    height_mm: float  # ... and its height over the plane is below this
    # Least scores of the best, the second and the weakest face. A cube's square face, of whatever size, scores 0.75 at
    # most as a triangle, so no box passes the first. A jig in plain view reaches 1.0 and 0.92; the second face may be
    # half hidden.
    least_scores: Vector = (0.85, 0.4, 0.04)
    least_of_box: float = 0.6  # in place of the first where whole rectangles are compared: other boxes may be near it
    most_wrong: float = 0.2  # share of a face that may be wrong; the edges of a scanned face are never quite sharp
    min_votes: int = 6


@dataclass(frozen=True)
class FaceTriple:
    """Three planes that may be the jig's faces, with their scores."""

    groups: tuple[PlaneGroup, ...]  # all groups; where a face was voted for, it is the last and has no sets
    chosen: tuple[int, int, int]  # indices into groups
    score: Array  # (3,) share of the face that has points, less the share that is wrong
    outline: Outline  # the jig's that fits best; edge i leaves the plane chosen[i]
    wrong: Array  # (3,) area seen through the face, or of points of its plane beyond its edges, as a share of the face
    mirrored: float = 0.0  # share of the points on and behind the faces that are mirror images of other faces

    def note_on_mirroring(self) -> tuple[str, ...]:
        """Warning on points that one face mirrors in another; () where there are few."""
        if self.mirrored < _WORTH_A_WORD:
            return ()
        return (
            f"{self.mirrored:.0%} of the thinned points on and behind the faces are mirror images of one face in "
            "another, and are left out; make the faces matt",
        )

    def is_jig(self, tolerances: SelectionTolerances) -> bool:
        """Whether points fill enough of every face, and few are beyond a face's edges or seen through it."""
        best, second, weakest = tolerances.least_scores
        if self.outline.rectangular:
            best = tolerances.least_of_box
        enough = np.all(np.sort(self.score) >= (weakest, second, best))
        return bool(enough and self.wrong.max() <= tolerances.most_wrong)


@dataclass(frozen=True)
class _Face:
    """Thinned points near one of three planes, and all points' heights over it."""

    heights: NDArray[np.float32]  # (V,) over the plane
    on: IndexArray  # (K,) points within the height tolerance
    offset_mm: float


class Planes:
    """Planes of the plane groups with heights of all thinned points, for scoring triples of planes as a jig's faces."""

    def __init__(
        self, groups: Sequence[PlaneGroup], around: Neighbourhoods, jig: Jig, tolerances: SelectionTolerances
    ) -> None:
        self.groups = tuple(groups)
        large = self.groups[:_MOST_GROUPS]
        self.normals = np.array([g.normal for g in large]).reshape(-1, 3)
        self.offsets = np.array([g.offset_mm for g in large])
        self.around = around
        self.tolerances = tolerances
        # From the middle, so that single precision gives heights to a ten thousandth of an edge.
        self._middle_mm = around.points_mm.mean(axis=0)
        self._columns = np.asarray((around.points_mm - self._middle_mm).T, dtype=np.float32, order="C")
        self.faces = [self._face(g) for g in large]
        self.members = [
            face.on[around.normals.take(face.on, axis=0) @ normal >= self._least_cosine()]
            for face, normal in zip(self.faces, self.normals, strict=True)
        ]
        self.perpendicular = np.abs(self.normals @ self.normals.T) <= np.sin(tolerances.perpendicular_rad)
        self.jig = jig
        self.outlines = jig.outlines()
        self.sign = -1.0 if jig.convex else 1.0

    def _face(self, plane: PlaneGroup) -> _Face:
        """Heights of the thinned points over a plane, and the points within the height tolerance."""
        offset_mm = plane.offset_mm - float(plane.normal @ self._middle_mm)
        heights = plane.normal.astype(np.float32) @ self._columns - np.float32(offset_mm)
        return _Face(
            np.asarray(heights, dtype=np.float32),
            np.flatnonzero(np.abs(heights) <= self.tolerances.height_mm),
            plane.offset_mm,
        )

    def _least_cosine(self) -> float:
        """Least cosine of the angle between a plane's normal and the own normal of a point that belongs to it."""
        return float(np.cos(self.tolerances.member_normal_rad))

    def walls(self) -> list[PlaneGroup]:
        """Planes with far more points than a face of the jig can have."""
        _, middle_mm, longest_mm = sorted(self.jig.edges_mm)
        most = _WALL * middle_mm * longest_mm
        return [
            group
            for group, members in zip(self.groups, self.members, strict=False)
            if len(members) and len(members) * self.around.spacing_mm(members) ** 2 > most
        ]

    @cached_property
    def solid(self) -> IndexArray:
        """Indices of the thinned points that lie on a surface, without stray points."""
        return np.flatnonzero(self.around.thickness_mm < self.tolerances.height_mm)

    @cached_property
    def squared_mm2(self) -> Array:
        """Squared distances (V,) of the thinned points from the scanner."""
        return np.einsum("vi,vi->v", self.around.points_mm, self.around.points_mm)

    @cached_property
    def triples(self) -> list[FaceTriple]:
        """Triples of perpendicular planes with their scores; where there are very many, those with the most points."""
        return [self.candidate((i, j, k)) for i, j, k in self.likeliest_triples().tolist()]

    @cached_property
    def perpendicular_triples(self) -> IndexArray:
        """Indices (T, 3) of mutually perpendicular planes, in ascending order."""
        triples = []
        for i, j in np.argwhere(np.triu(self.perpendicular)).tolist():
            both = np.flatnonzero(self.perpendicular[i] & self.perpendicular[j])
            triples += [(i, j, k) for k in both[both > j].tolist()]
        return np.array(triples, dtype=np.int64).reshape(-1, 3)

    def likeliest_triples(self) -> IndexArray:
        """Indices (T, 3) of the triples to be scored: of many, those with the most points on their faces."""
        triples = self.perpendicular_triples
        if len(triples) <= _MOST_SCORED:
            return triples
        along = self.sign * np.stack([face.heights for face in self.faces])
        points = np.zeros(len(triples))
        for plane in np.unique(triples):
            on = self.faces[plane].on
            every = max(1, len(on) // _ENOUGH_TO_COUNT)
            reach = np.abs(along[:, on[::every]] - 0.5 * self.jig.longest_mm) <= 0.5 * self.jig.longest_mm
            reach = reach.astype(np.float32)
            shared = np.sqrt(every * (reach @ reach.T))
            for face in range(3):
                of_plane = np.flatnonzero(triples[:, face] == plane)
                one, other = np.delete(triples[of_plane], face, axis=1).T
                points[of_plane] += shared[one, other]
        return triples[np.argsort(-points, kind="stable")[:_MOST_SCORED]]

    @cached_property
    def likeliest_pairs(self) -> list[tuple[int, int]]:
        """Pairs of perpendicular planes that may be two faces; of many, those whose weaker face has most points."""
        pairs = [(i, j) for i, j in np.argwhere(np.triu(self.perpendicular)).tolist()]
        if len(pairs) > _MOST_PAIRS:
            pairs.sort(key=lambda pair: -min(len(self.strip(pair)), len(self.strip(pair[::-1]))))
        return pairs[:_MOST_PAIRS]

    def strip(self, pair: tuple[int, int]) -> IndexArray:
        """Indices of the points on the pair's first plane within an edge length of the second, where a face can be."""
        members = self.members[pair[0]]
        along = self.sign * self.faces[pair[1]].heights.take(members)
        return members[(along > -0.1 * self.jig.shortest_mm) & (along < self.jig.longest_mm)]

    def could_be_face(self, strip: IndexArray) -> bool:
        """Whether the points `strip` cover as much area as the second-best face of a jig has to."""
        one, other, _ = sorted(self.jig.edges_mm)
        a_face = 0.5 * one * other / self.around.spacing_mm(strip) ** 2
        return len(strip) > 0.5 * self.tolerances.least_scores[1] * a_face

    def candidate(self, chosen: tuple[int, int, int], voted: PlaneGroup | None = None) -> FaceTriple:
        """Three planes with scores: how well each fills the face between its lines of intersection with the others.

        chosen are indices of groups, the last of them len(groups) where a plane `voted` takes part. Of several outlines
        of the jig the one with the highest score is taken. Deductions from a score that is too low already are not
        computed.
        """
        groups = self.groups if voted is None else (*self.groups, voted)
        faces = [self.faces[g] for g in chosen if g < len(self.faces)]
        if voted is not None:
            faces.append(self._face(voted))
        normals = np.array([groups[g].normal for g in chosen])
        mirrored = self._mirrored(faces, normals)
        on = [self._along(faces, face, mirrored) for face in range(3)]
        at = np.concatenate([points for _, points in on])
        spacing_mm = self.around.spacing_mm(at) if len(at) else 0.0
        # What costs least is counted first: no score is higher than the area that has points.
        triples = self._scored(
            groups, chosen, self.outlines, lambda i, face: (filled_share(on[i][0], face, spacing_mm), 0.0, 0.0)
        )
        count = int(np.count_nonzero(mirrored))
        share = count / max(len(at) + count, 1)
        triples = [replace(triple, mirrored=share) for triple in triples]
        if not (outlines := self._like(triples)):
            return self._best(triples)
        agrees = [
            self.around.normals.take(points, axis=0) @ normal >= self._least_cosine()
            for (_, points), normal in zip(on, normals, strict=True)
        ]
        through = [np.zeros((0, 2))] * 3
        triples = self._scored(
            groups, chosen, outlines, lambda i, face: outline_shares(on[i][0], agrees[i], through[i], face, spacing_mm)
        )
        if not (outlines := self._like(triples)):
            return self._best(triples)
        apex = intersect(normals, np.array([face.offset_mm for face in faces]))
        # |p x a|^2 = |p|^2 |a|^2 - (p . a)^2, so near the ray to the apex is:
        near = (self.around.points_mm @ apex) ** 2 > (self.squared_mm2 - (1.5 * self.jig.longest_mm) ** 2) * (
            apex @ apex
        )
        behind = self.solid[(near & ~mirrored)[self.solid]]
        through = [self._through(faces, face, behind) for face in range(3)]
        triples = self._scored(
            groups, chosen, outlines, lambda i, face: outline_shares(on[i][0], agrees[i], through[i], face, spacing_mm)
        )
        return replace(self._best(triples), mirrored=share)

    def _mirrored(self, faces: Sequence[_Face], normals: Array) -> BoolArray:
        """Mask (V,) of the points that a concave jig's shiny faces put behind one of them.

        A ray that a face reflects meets another face, and its point is measured as far along the ray: at the mirror
        image of that other face in the first. Mirrored back in the planes that it is behind, it lies in the face.
        """
        mirrored = np.zeros(len(self.around.points_mm), dtype=bool)
        if not self.jig.convex:
            heights = np.stack([face.heights for face in faces])
            offsets = np.array([face.offset_mm for face in faces])
            behind = np.flatnonzero((heights < -2 * self.tolerances.height_mm).any(axis=0))
            heights = heights[:, behind]
            # The ray to a point of height h over the plane n . p = d meets it at the share d / (h + d) of its length.
            met = np.where(heights < 0, offsets[:, None] / np.minimum(heights + offsets[:, None], -1e-9), np.inf)
            first = np.argmin(met, axis=0)
            there = heights[first, np.arange(len(behind))]
            back = np.abs(heights - 2 * there * (normals @ normals.T)[:, first])
            low, middle, high = np.sort(back, axis=0)
            of_face = (low < 2 * self.tolerances.height_mm) & (middle + high < 1.1 * self.jig.longest_mm)
            if self.outlines[0].rectangular:
                of_face = (low < 2 * self.tolerances.height_mm) & (high < 1.1 * self.jig.longest_mm)
            mirrored[behind[of_face]] = True
        return mirrored

    def _scored(
        self,
        groups: tuple[PlaneGroup, ...],
        chosen: tuple[int, int, int],
        outlines: Sequence[Outline],
        shares: Callable[[int, FaceOutline], Vector],
    ) -> list[FaceTriple]:
        """Three planes taken as the jig's faces, scored with each of several possible outlines of the jig.

        shares(i, face)  # of face i: filled, spilt over and seen through
        """
        known = cache(shares)
        triples = []
        for whole in outlines:
            areas = np.array([known(face, FaceOutline.of(whole, face)) for face in range(3)])
            filled, spilt, seen_through = areas.T
            # One face may be mostly broken or cut away, and points be seen through it.
            seen_through[np.argmin(filled - spilt - seen_through)] = 0.0
            wrong = spilt + seen_through
            triples.append(FaceTriple(groups, chosen, filled - wrong, whole, wrong))
        return triples

    def _like(self, triples: Sequence[FaceTriple]) -> list[Outline]:
        """Outlines of the triples that satisfy `FaceTriple.is_jig`."""
        return [triple.outline for triple in triples if triple.is_jig(self.tolerances)]

    def _best(self, triples: Sequence[FaceTriple]) -> FaceTriple:
        """Triple with the highest sum of scores, among those that satisfy `FaceTriple.is_jig` if any does."""
        return max(triples, key=lambda triple: (triple.is_jig(self.tolerances), float(triple.score.sum())))

    def _along(self, faces: Sequence[_Face], face: int, mirrored: BoolArray) -> tuple[Array, IndexArray]:
        """Coordinates (K, 2), along a face's two edges, of points on its plane near these edges; and their indices."""
        at = faces[face]
        on = at.on[~mirrored[at.on]]
        one, other = (self.sign * o.heights.take(on) for o in faces if o is not at)
        least, most = -0.5 * self.jig.longest_mm, 2 * self.jig.longest_mm
        near = np.flatnonzero((np.minimum(one, other) > least) & (np.maximum(one, other) < most))
        return np.stack([one[near], other[near]]).T, on[near]

    def _through(self, faces: Sequence[_Face], face: int, behind: IndexArray) -> Array:
        """Coordinates (M, 2), along a face's edges, where the rays of the points `behind` went through its plane.

        The scanner is the origin. The ray to a point of height h over the plane n . p = d meets the plane at the share
        d / (h + d) of its length.
        """
        at = faces[face]
        heights = at.heights.take(behind)
        seen = np.flatnonzero((heights < -2 * self.tolerances.height_mm) & (heights + at.offset_mm < 0))
        behind, share = behind[seen], at.offset_mm / (heights[seen] + at.offset_mm)
        others = (other for other in faces if other is not at)
        through = self.sign * np.stack([(o.heights.take(behind) + o.offset_mm) * share - o.offset_mm for o in others])
        over = np.flatnonzero(np.all(np.abs(through / self.jig.longest_mm - 0.5) < 0.6, axis=0))
        return through.take(over, axis=1).T
