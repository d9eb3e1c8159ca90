"""Selection of the three planes that are the jig's faces.

Jang chooses three groups with perpendicular normals and near centres. Next to a box, or indoors, several triples are
perpendicular; only the jig has its outline. Seen from the apex each face is a right triangle whose legs are the jig's
edges (where three edges are declared, perhaps their rectangle): a plane of the jig fills it, ends there, and no point
is seen through it. Other planes leave it empty, go on beyond its edges, or are seen through.

A face without a group of its own (nearly edge-on, or mostly hidden) is found by a vote: the two other planes determine
its normal, and the points vote for its offset along that.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from calib.array_types import Array
from calib.corners.plane_triples import FaceTriple, Planes, SelectionTolerances
from calib.jig import Jig
from calib.planes.clustering import PlaneGroup

_MOST_PEAKS = 4
_MOST_VOTERS = 100_000
_SAME_RAD = np.radians(0.5)  # planes of two passes that differ less are the same
_SETS_TO_COUNT = 3  # a group of fewer sets is mostly a part of another plane
_CLEAR = 0.015  # of the edge: voters keep this distance from the other two faces and the far edge
_MOSTLY_MIRRORED = 0.1  # share of the points on and behind three planes
_NEAR_END = 0.12  # of the edge: how far from where the two other faces end the third may be


class TriedPairs:
    """Pairs of planes with which a vote found no third face in earlier passes through the scan."""

    def __init__(self) -> None:
        self._normals: list[Array] = []  # of each pair, (2, 3)
        self._offsets_mm: list[Array] = []

    def new(self, planes: Planes) -> list[tuple[int, int]]:
        """Likeliest pairs of planes not tried before, within the tolerances; the pairs returned count as tried."""
        pairs = planes.likeliest_pairs
        new = [pair for pair in pairs if not self._tried(planes, pair)]
        self._normals += [planes.normals[list(pair)] for pair in new]
        self._offsets_mm += [planes.offsets[list(pair)] for pair in new]
        return new

    def _tried(self, planes: Planes, pair: tuple[int, int]) -> bool:
        """Whether a tried pair has the same normals and the same line of intersection as this pair."""
        if not self._normals:
            return False
        one, other = (planes.groups[g] for g in pair)
        way = np.cross(one.normal, other.normal)
        middle = np.linalg.solve(
            np.array([one.normal, other.normal, way]),
            np.array([one.offset_mm, other.offset_mm, way @ (one.centre_mm + other.centre_mm) / 2]),
        )
        tried = np.array(self._normals)  # (P, 2, 3)
        near = np.abs(tried @ middle - np.array(self._offsets_mm)) <= planes.tolerances.height_mm
        for normals in (np.array([one.normal, other.normal]), np.array([other.normal, one.normal])):
            same = np.einsum("pij,ij->pi", tried, normals) >= np.cos(_SAME_RAD)
            if np.any(np.all(near & same, axis=1)):
                return True
        return False


def face_triples(points_mm: Array, planes: Planes, tried: TriedPairs) -> Iterator[FaceTriple]:
    """Triples of planes with the jig's outline, the highest score first; last those whose third plane came from a vote.

    points_mm  # (N, 3) the whole scan
    """
    yield from _like_the_jig(planes.triples, planes.tolerances)
    pairs = tried.new(planes)
    if pairs:
        voters_mm = np.ascontiguousarray(points_mm[:: max(1, len(points_mm) // _MOST_VOTERS)].T)
        voted = [triple for pair in pairs for triple in _vote(voters_mm, planes, pair)]
        yield from _like_the_jig(voted, planes.tolerances)


def why_no_triple(planes: Planes) -> str:
    """Reason why no three planes are the jig's faces, with numbers and what would help."""
    jig = planes.jig
    mirrored = Planes(planes.groups, planes.around, replace(jig, convex=not jig.convex), planes.tolerances)
    if _like_the_jig(mirrored.triples, planes.tolerances):
        direction, declared = ("away from", "true") if jig.convex else ("toward", "false")
        return (
            f"found a corner of the jig's size whose apex points {direction} the scanner, but the jig is described "
            f"with convex = {declared}; check convex in dataset.toml, and that the scanner is the origin of the scan's "
            "frame"
        )
    return _reason_by_planes(planes, planes.triples, jig)


def _like_the_jig(candidates: Sequence[FaceTriple], tolerances: SelectionTolerances) -> list[FaceTriple]:
    """Triples with the outline of the jig (`FaceTriple.is_jig`), the highest sum of scores first."""
    like = [candidate for candidate in candidates if candidate.is_jig(tolerances)]
    return sorted(like, key=lambda c: -float(c.score.sum()))


def _vote(voters_mm: Array, planes: Planes, pair: tuple[int, int]) -> list[FaceTriple]:
    """Triples of the two planes `pair` and a third perpendicular one, at the offsets where most scan points lie.

    The third normal is n_1 x n_2 on the scanner's side. All points (3, N) over the third face's triangle vote with
    their height along it, and the fullest bands are tried as its offset.
    """
    edge_mm, height_mm = planes.jig.shortest_mm, planes.tolerances.height_mm
    members = (planes.strip(pair), planes.strip(pair[::-1]))
    if min(map(len, members)) < planes.tolerances.min_votes or not all(map(planes.could_be_face, members)):
        return []
    strips = [planes.around.points_mm.take(m, axis=0) for m in members]
    normals, offsets = planes.normals[list(pair)], planes.offsets[list(pair)]
    third = np.cross(*normals)
    third /= np.linalg.norm(third)
    if third @ strips[0].mean(axis=0) > 0:
        third = -third
    one, other = planes.sign * (normals @ voters_mm - offsets[:, None])
    over = np.flatnonzero(
        (np.minimum(one, other) > _CLEAR * edge_mm) & (one + other < (1 - _CLEAR) * planes.jig.longest_mm)
    )
    voters_mm = voters_mm.take(over, axis=1)
    height = third @ voters_mm
    # The two faces end at the third one, which gives its offset to a cell or so; its few points give the rest.
    ends = [float(np.quantile(planes.sign * (strip @ third), 0.02)) * planes.sign for strip in strips]
    close = np.abs(height - 0.5 * sum(ends)) < _NEAR_END * edge_mm
    triples = []
    for offset in _fullest_bands(height[close], height_mm / 2, planes.tolerances.min_votes):
        on = np.abs(height - offset) <= height_mm / 2
        voted = PlaneGroup(np.zeros(0, dtype=np.int64), voters_mm[:, on].mean(axis=1), third, offset)
        triples.append(planes.candidate((pair[0], pair[1], len(planes.groups)), voted))
    return triples


def _fullest_bands(height_mm: Array, width_mm: float, min_votes: int) -> list[float]:
    """Middles of the fullest bands of the given width, the fullest first; no band overlaps a fuller one."""
    order = np.sort(height_mm)
    first = np.arange(len(order))
    count = np.searchsorted(order, order + width_mm, side="right") - first
    middle = order[first + count // 2]
    bands: list[float] = []
    while len(bands) < _MOST_PEAKS and len(count):
        fullest = int(np.argmax(count))
        if count[fullest] < min_votes:
            break
        bands.append(float(middle[fullest]))
        apart = np.abs(middle - bands[-1]) > 2 * width_mm
        count, middle = count[apart], middle[apart]
    return bands


def _reason_by_planes(planes: Planes, triples: Sequence[FaceTriple], jig: Jig) -> str:
    """Reason for a failed selection, from the planes and triples that the scan has, and what would help."""
    count = sum(len(g.sets) >= _SETS_TO_COUNT for g in planes.groups) or len(planes.groups)
    sizes = [f"{len(m)}" for m in planes.members[: min(count, 3)]]
    if count < 3:
        reason = f"found {count} plane{'s' * (count != 1)}" + f" ({' and '.join(sizes)} points)" * bool(sizes)
        if count == 2:
            cosine = min(abs(float(planes.normals[0] @ planes.normals[1])), 1.0)
            reason = f"two faces only, at {np.degrees(np.arccos(cosine)):.0f} deg to each other: {reason}"
        return (
            f"{reason}, a corner needs 3; turn the jig so that three faces are seen, scan it finer, "
            f"or check edge_mm ({jig.edges_text()})"
        )
    if not triples:
        return (
            f"found {count} planes (the largest of {', '.join(sizes)} points), no three of them perpendicular; "
            "turn the jig so that three faces are seen, or scan it finer"
        )
    best = max(triples, key=lambda c: float(np.sort(c.score)[1]))
    filled = ", ".join(f"{max(w, 0):.0%}" for w in np.sort(best.score))
    return (
        f"found {len(planes.perpendicular_triples)} triples of perpendicular planes, but none with the outline of "
        f"a jig of {jig.edges_text()} (the best fills {filled} of its faces); {_remedy(best)}"
    )


def _remedy(best: FaceTriple) -> str:
    """Advice for a scan whose best triple of planes has not the jig's outline."""
    if best.mirrored > _MOSTLY_MIRRORED:
        return (
            f"{best.mirrored:.0%} of the points on and behind these planes are mirror images of one in another: the "
            "faces are shiny; make them matt"
        )
    return "check edge_mm, and that the jig is in full view"
