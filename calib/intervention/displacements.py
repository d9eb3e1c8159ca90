"""Displacement of each target by a changed condition, for drawing: measured, and as the proven causes explain it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.intervention.differences import Differences


@dataclass(frozen=True)
class PairDisplacements:
    """What a changed condition moved at P places, from its lowest level there to its highest.

    The motion of the instrument and the shift of the tool between the runs, as they were fitted, are taken away.
    """

    before: IndexArray  # (P,) index of the pose under the lowest level
    after: IndexArray  # (P,) and under the highest
    names: tuple[str, ...]  # (P,) ids of the poses under the highest level
    held_out: BoolArray  # (P,) whether the pair was not fitted
    place_mm: Array  # (P, 3) point measured before the change, in the scanner's frame
    moved_mm: Array  # (P, 3) measured, in that frame
    explained_mm: Array  # (P, 3) by the proven causes

    @property
    def longest_mm(self) -> float:
        """Length of the longest measured displacement."""
        return float(np.linalg.norm(self.moved_mm, axis=1).max(initial=0.0))


def displacements_of(differences: Differences, explained: Array) -> PairDisplacements:
    """Displacements at the places of some differences.

    Args:
        differences: of paired poses.
        explained: what the proven causes add to them (R,), in sigmas.
    """
    train = differences.train
    rest = (differences.residual - explained)[train]
    moved = np.linalg.lstsq(differences.nuisance[train], rest, rcond=1e-9)[0]
    measured = differences.residual - differences.nuisance @ moved
    in_mm = [np.linalg.solve(differences.whiten, part.reshape(-1, 3, 1))[..., 0] for part in (measured, explained)]
    first, last = _ends(differences)
    to_scanner = differences.scanner_R_base[first]
    moved_mm, explained_mm = ((to_scanner @ (part[last] - part[first])[:, :, None])[..., 0] for part in in_mm)
    ids = differences.paired.of.ids
    return PairDisplacements(
        before=differences.pose[first],
        after=differences.pose[last],
        names=tuple(ids[pose] for pose in differences.pose[last].tolist()),
        held_out=~train[::3][first],
        place_mm=differences.xyz_mm[first],
        moved_mm=moved_mm,
        explained_mm=explained_mm,
    )


def _ends(differences: Differences) -> tuple[IndexArray, IndexArray]:
    """Rows (P,) of the points under the lowest and the highest level of each place and target, where these differ."""
    level = dict(zip(differences.paired.poses.tolist(), differences.paired.level.tolist(), strict=True))
    of_point = np.array([level[pose] for pose in differences.pose.tolist()])
    order = np.lexsort((of_point, differences.cell))
    starts = np.flatnonzero(np.diff(differences.cell[order], prepend=-1))
    ends = np.append(starts[1:], len(order)) - 1
    first, last = order[starts], order[ends]
    differ = of_point[first] != of_point[last]
    return first[differ], last[differ]
