"""Which three planes are the jig's faces.

Jang chooses three groups with perpendicular normals and near centres. Beside a box, or in a room, several triples are
perpendicular; only the jig has its outline. Seen from the apex each face is a right triangle with legs of the jig's
edges (where three are told, perhaps their rectangle): a plane of the jig fills it, ends there, and no point is seen
through it. Other planes leave it empty, go on beyond its edges, or are seen through. A face's score is the share of its
area that has points less the share that is wrong in these ways.

A face that got no group of its own (nearly edge-on, or mostly hidden) is found by a vote: the two other planes leave
one direction for its normal, and the points vote for its offset along that.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.array_types import Array, IndexArray
from calib.corners.faces.face_outline import FaceOutline, outline_shares
from calib.corners.intersection import intersect
from calib.jig import Jig, Outline
from calib.planes.clustering import PlaneGroup
from calib.planes.normals import Neighbourhoods

_MOST_GROUPS = 60
_MOST_PEAKS = 4
# Of the triples, those whose faces have the most points; a jig in clutter is among the first few.
_MOST_SCORED = 60
_MOST_PAIRS = 20  # for which a third face is voted
_SETS_TO_COUNT = 3  # a group of fewer sets is mostly a part of another plane
_CLEAR = 0.015  # of the edge: voters keep this distance from the other two faces and the far edge
_NEAR_END = 0.12  # of the edge: how far from where the two other faces end the third may be


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


def face_triples(points_mm: Array, planes: Planes) -> Iterator[FaceTriple]:
    """The triples of planes with the outline of the jig, the highest score first; those with a voted face come last.

    points_mm  # (N, 3) the whole scan
    """
    yield from _like_the_jig(planes.triples, planes.tolerances)
    yield from _like_the_jig(_vote_third_faces(points_mm, planes), planes.tolerances)


def why_no_triple(planes: Planes) -> str:
    """Why no three planes are the jig's faces, with numbers and what would help."""
    jig = planes.jig
    mirrored = Planes(planes.groups, planes.around, replace(jig, convex=not jig.convex), planes.tolerances)
    if _like_the_jig(mirrored.triples, planes.tolerances):
        seen, said = ("away from", "true") if jig.convex else ("toward", "false")
        return (
            f"found a corner of the jig's size whose apex points {seen} the scanner, but the jig is described with "
            f"convex = {said}; check convex in dataset.toml, and that the scanner is the origin of the scan's frame"
        )
    return _what_was_found(planes, planes.triples, jig)


class Planes:
    """The groups' planes with every thinned point's height over each, which is all that the scoring needs."""

    def __init__(
        self, groups: Sequence[PlaneGroup], around: Neighbourhoods, jig: Jig, tolerances: SelectionTolerances
    ) -> None:
        self.groups = tuple(groups)
        large = self.groups[:_MOST_GROUPS]
        self.normals = np.array([g.normal for g in large]).reshape(-1, 3)
        self.offsets = np.array([g.offset_mm for g in large])
        self.heights = around.points_mm @ self.normals.T - self.offsets  # (V, G)
        self.around = around
        self.squared_mm2 = np.einsum("vi,vi->v", around.points_mm, around.points_mm)
        self.tolerances = tolerances
        self.members = [self.on_plane(n, d) for n, d in zip(self.normals, self.offsets, strict=True)]
        self.perpendicular = np.abs(self.normals @ self.normals.T) <= np.sin(tolerances.perpendicular_rad)
        self.jig = jig
        self.outlines = jig.outlines()
        self.face_outlines = {FaceOutline.of(o, face) for o in self.outlines for face in range(3)}
        # Along an edge, away from the apex, the height over the plane that the edge leaves falls on a convex corner.
        self.sign = -1.0 if jig.convex else 1.0

    def on_plane(self, normal: Array, offset_mm: float) -> IndexArray:
        """Indices of the thinned points at a plane whose own normals agree with it."""
        near = np.abs(self.around.points_mm @ normal - offset_mm) <= self.tolerances.height_mm
        agree = self.around.normals @ normal >= np.cos(self.tolerances.member_normal_rad)
        return np.flatnonzero(near & agree)

    @cached_property
    def triples(self) -> list[FaceTriple]:
        """The triples of perpendicular planes with their scores; of very many those that have the most points."""
        return [self.candidate(self.groups, (i, j, k)) for i, j, k in self.likeliest_triples().tolist()]

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
        on = np.abs(self.heights) <= self.tolerances.height_mm
        points = np.zeros(len(triples))
        for face in range(3):
            one, other = np.delete(triples, face, axis=1).T
            for plane in np.unique(triples[:, face]):
                reach = in_reach[on[:, plane]]
                of_plane = triples[:, face] == plane
                points[of_plane] += np.sqrt((reach.T @ reach)[one[of_plane], other[of_plane]])
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
        along = self.sign * self.heights[members, pair[1]]
        return members[(along > -0.1 * self.jig.shortest_mm) & (along < self.jig.longest_mm)]

    def could_be_face(self, strip: IndexArray) -> bool:
        """Whether the points `strip` are as many as cover the least share of a face that one of two good ones has."""
        one, other, _ = sorted(self.jig.edges_mm)
        a_face = 0.5 * one * other / self.around.spacing_mm(strip) ** 2
        return len(strip) > 0.5 * self.tolerances.least_scores[1] * a_face

    def candidate(self, groups: tuple[PlaneGroup, ...], chosen: tuple[int, int, int]) -> FaceTriple:
        """Three planes with the score of each as the face between the edges in which it meets the two others.

        Of several outlines of the jig the one with the highest score is taken.
        """
        normals = np.array([groups[g].normal for g in chosen])
        offsets = np.array([groups[g].offset_mm for g in chosen])
        apex = intersect(normals, offsets)
        # |p x a|^2 = |p|^2 |a|^2 - (p . a)^2, so near the ray to the apex is:
        along_ray = self.around.points_mm @ apex
        near = along_ray**2 > (self.squared_mm2 - (1.5 * self.jig.longest_mm) ** 2) * (apex @ apex)
        points, point_normals = self.around.points_mm[near], self.around.normals[near]
        heights = points @ normals.T - offsets
        # Points of a surface, no stray ones.
        solid = self.around.thickness_mm[near] < self.tolerances.height_mm
        spacing_mm = self.around.spacing_mm(near) if near.any() else 0.0
        shares: dict[tuple[int, FaceOutline], tuple[float, float, float]] = {}
        for face in range(3):
            others = [i for i in range(3) if i != face]
            on = np.abs(heights[:, face]) <= self.tolerances.height_mm
            agrees = point_normals @ normals[face] >= np.cos(self.tolerances.member_normal_rad)
            # Where the ray of a point behind the plane has gone through it; the scanner is the origin.
            behind = solid & (heights[:, face] < -2 * self.tolerances.height_mm)
            way = points[behind] @ normals[face]
            crossing = points[behind] * (offsets[face] / np.where(way < 0, way, -np.inf))[:, None]
            through = crossing @ normals[others].T - offsets[others]
            along_mm, through_mm = self.sign * heights[np.ix_(on, others)], self.sign * through
            beside = np.all(np.abs(along_mm / self.jig.longest_mm - 0.75) < 1.25, axis=1)
            over = np.all(np.abs(through_mm / self.jig.longest_mm - 0.5) < 0.6, axis=1)
            along_mm, agree, through_mm = along_mm[beside], agrees[on][beside], through_mm[over]
            for outline in self.face_outlines:
                shares[face, outline] = outline_shares(along_mm, agree, through_mm, outline, spacing_mm)
        triples = []
        for whole in self.outlines:
            areas = np.array([shares[face, FaceOutline.of(whole, face)] for face in range(3)])
            filled, spilt, seen_through = areas.T
            # One face may be mostly broken or cut away, and points be seen through it.
            seen_through[np.argmin(filled - spilt - seen_through)] = 0.0
            wrong = spilt + seen_through
            triples.append(FaceTriple(groups, chosen, filled - wrong, whole, wrong))
        return max(triples, key=lambda triple: (triple.is_jig(self.tolerances), float(triple.score.sum())))


def _like_the_jig(candidates: Sequence[FaceTriple], tolerances: SelectionTolerances) -> list[FaceTriple]:
    """The triples whose faces all reach the least scores, the highest sum of scores first."""
    like = [candidate for candidate in candidates if candidate.is_jig(tolerances)]
    return sorted(like, key=lambda c: -float(c.score.sum()))


def _vote_third_faces(points_mm: Array, planes: Planes) -> list[FaceTriple]:
    """Triples of two perpendicular planes each, whose third face all points of the scan vote for."""
    return [triple for pair in planes.likeliest_pairs for triple in _vote(points_mm, planes, pair)]


def _vote(points_mm: Array, planes: Planes, pair: tuple[int, int]) -> list[FaceTriple]:
    """Triples with the two planes `pair`.

    The third normal is n_1 x n_2 on the scanner's side. All points (N, 3) that lie over the third face's triangle
    vote with their height along it, and the fullest bands are tried as its offset.
    """
    edge_mm, height_mm = planes.jig.shortest_mm, planes.tolerances.height_mm
    thinned_mm = planes.around.points_mm
    members = (planes.strip(pair), planes.strip(pair[::-1]))
    strips = [thinned_mm[m] for m in members]
    if min(map(len, strips)) < planes.tolerances.min_votes or not all(map(planes.could_be_face, members)):
        return []
    normals, offsets = planes.normals[list(pair)], planes.offsets[list(pair)]
    third = np.cross(*normals)
    third /= np.linalg.norm(third)
    if third @ strips[0].mean(axis=0) > 0:
        third = -third
    along = planes.sign * (points_mm @ normals.T - offsets)
    over = np.all(along > _CLEAR * edge_mm, axis=1) & (
        along.sum(axis=1) < (1 - _CLEAR) * planes.jig.longest_mm
    )
    height = points_mm[over] @ third
    # The two faces end at the third one, which gives its offset to a cell or so; its few points give the rest.
    ends = [float(np.quantile(planes.sign * (strip @ third), 0.02)) * planes.sign for strip in strips]
    close = np.abs(height - 0.5 * sum(ends)) < _NEAR_END * edge_mm
    found = []
    for offset in _fullest_bands(height[close], height_mm / 2, planes.tolerances.min_votes):
        on = np.abs(height - offset) <= height_mm / 2
        voted = PlaneGroup(np.zeros(0, dtype=np.int64), points_mm[over][on].mean(axis=0), third, offset)
        groups = (*planes.groups, voted)
        found.append(planes.candidate(groups, (pair[0], pair[1], len(planes.groups))))
    return found


def _fullest_bands(height_mm: Array, width_mm: float, min_votes: int) -> list[float]:
    """Middles of the fullest bands of the given width, the fullest first; none overlaps a fuller one."""
    order = np.sort(height_mm)
    bands: list[float] = []
    count = np.searchsorted(order, order + width_mm, side="right") - np.arange(len(order))
    for start in np.argsort(-count, kind="stable"):
        if count[start] < min_votes or len(bands) == _MOST_PEAKS:
            break
        middle = float(order[start + count[start] // 2])
        if all(abs(middle - other) > 2 * width_mm for other in bands):
            bands.append(middle)
    return bands


def _what_was_found(planes: Planes, triples: Sequence[FaceTriple], jig: Jig) -> str:
    """Which planes and triples there were, and what would help."""
    count = sum(len(g.sets) >= _SETS_TO_COUNT for g in planes.groups) or len(planes.groups)
    sizes = [f"{len(m)}" for m in planes.members[: min(count, 3)]]
    if count < 3:
        found = f"found {count} plane{'s' * (count != 1)}" + f" ({' and '.join(sizes)} points)" * bool(sizes)
        if count == 2:
            cosine = min(abs(float(planes.normals[0] @ planes.normals[1])), 1.0)
            found = f"two faces only, at {np.degrees(np.arccos(cosine)):.0f} deg to each other: {found}"
        return f"{found}, a corner needs 3; turn the jig so that three faces are seen, or scan it finer"
    if not triples:
        return (
            f"found {count} planes (the largest of {', '.join(sizes)} points), no three of them perpendicular; "
            "turn the jig so that three faces are seen, or scan it finer"
        )
    best = max(triples, key=lambda c: float(np.sort(c.score)[1]))
    filled = ", ".join(f"{max(w, 0):.0%}" for w in np.sort(best.score))
    return (
        f"found {len(planes.perpendicular_triples)} triples of perpendicular planes, but none with the outline of "
        f"a jig of {jig.edge_words()} (the best fills {filled} of its faces); check edge_mm, and that the jig is in "
        "full view"
    )
