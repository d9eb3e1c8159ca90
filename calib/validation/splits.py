"""Splits of a dataset's training poses: folds, growing subsets, and the datasets made from them.

Poses with the same joint vector form a group and stay together: repeats, several targets, the same joints under another
name. Otherwise a pose would be tested by a fit to its own repeats. Every setup keeps training poses, because its
scanner frame is fitted to them. Poses of the role test take no part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.array_types import IndexArray
from calib.dataset.dataset import Dataset
from calib.errors import FitError

MIN_FRAME_POSES = 3  # fewer points do not determine a scanner frame


@dataclass(frozen=True)
class JointGroups:
    """Groups of a dataset's measured training poses; the poses of one group have the same joint vector."""

    poses: tuple[IndexArray, ...]  # of each group, indices into the dataset's poses
    setup: NDArray[np.str_]  # (K,) the setup of each group's first pose

    def __len__(self) -> int:
        return len(self.poses)

    def poses_of(self, groups: Sequence[int] | IndexArray) -> IndexArray:
        """Indices of the poses of some groups, in the dataset's order."""
        chosen = [self.poses[int(k)] for k in groups]
        return np.sort(np.concatenate(chosen)) if chosen else np.zeros(0, dtype=np.int64)


def training_groups(dataset: Dataset) -> JointGroups:
    """Groups of equal training and reference poses. Raises FitError where the dataset has no points."""
    if dataset.points is None:
        raise FitError(f"dataset {dataset.name}: no measured points yet; find the corners of its scans first")
    poses = dataset.poses
    measured = np.isin(np.arange(len(poses)), dataset.points.pose) & ~poses.is_test
    by_joints: dict[bytes, list[int]] = {}
    for i in np.flatnonzero(measured):
        by_joints.setdefault((np.round(poses.q[i], 9) + 0.0).tobytes(), []).append(int(i))
    groups = tuple(np.array(rows, dtype=np.int64) for rows in by_joints.values())
    return JointGroups(groups, np.array([str(poses.setup[rows[0]]) for rows in groups], dtype=str))


def deal_folds(groups: JointGroups, folds: int, rng: np.random.Generator) -> tuple[list[IndexArray], list[str]]:
    """Deal the groups into folds, setup by setup, so that each fold has its share of every setup.

    Returns:
        The groups of each fold, and the setups that are too small to lose any: fewer than three of their groups would
        be left for the scanner's frame, so all of them always train.
    """
    dealt: list[list[int]] = [[] for _ in range(folds)]
    small, turn = [], 0
    for setup in np.unique(groups.setup):
        members = rng.permutation(np.flatnonzero(groups.setup == setup))
        if len(members) - int(np.ceil(len(members) / folds)) < MIN_FRAME_POSES:
            small.append(str(setup))
            continue
        for group in members:
            dealt[turn % folds].append(int(group))
            turn += 1
    return [np.array(sorted(fold), dtype=np.int64) for fold in dealt], small


def growing_order(groups: JointGroups, among: IndexArray, rng: np.random.Generator) -> IndexArray:
    """Order of pose groups in which every beginning covers all setups: three of each, then in proportion."""
    rank, share = {}, {}
    for setup in np.unique(groups.setup[among]):
        members = rng.permutation(among[groups.setup[among] == setup])
        for k, group in enumerate(members):
            rank[int(group)] = 0 if k < MIN_FRAME_POSES else 1
            share[int(group)] = (k + rng.uniform()) / len(members)
    return np.array(sorted(rank, key=lambda group: (rank[group], share[group])), dtype=np.int64)


def split_dataset(dataset: Dataset, train: IndexArray, held_out: IndexArray) -> tuple[Dataset, IndexArray]:
    """Dataset with some poses for training and others held out as test poses, and the poses' indices (N,).

    The reference pose keeps its role where it is in `train`; else the first training pose becomes the reference.
    """
    assert dataset.points is not None
    rows = np.sort(np.concatenate([train, held_out]))
    poses = dataset.poses.select(rows)
    role = np.where(np.isin(rows, held_out), "test", np.where(poses.role == "reference", "reference", "train"))
    if not np.any(role == "reference"):
        role[np.flatnonzero(role == "train")[0]] = "reference"
    points = dataset.points.select(np.isin(dataset.points.pose, rows))
    kept = replace(points, pose=np.searchsorted(rows, points.pose))
    return replace(dataset, poses=replace(poses, role=role), points=kept, warnings=()), rows
