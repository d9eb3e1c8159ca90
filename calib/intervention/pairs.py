"""Paired poses: measured at the same joint values while a condition of the pose differs, such as the payload.

They need no table of roles: whatever was measured twice at one place is found, with the condition that changed. A place
may have been measured under more than two levels of it (0, 1.25 and 2.5 kg).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calib.array_types import IndexArray
from calib.brief import Brief
from calib.dataset.dataset import Dataset, Poses
from calib.statistics import ranks

SAME_JOINT_DEG = 0.05
"""Joint values that agree within this belong to one place; 0.05 mm for a prismatic joint."""
SAME_TEMPERATURE_C = 1.0  # below it lengths hardly change: 0.01 mm a metre
_SAME_AMOUNT = 1e-3  # of a payload, kg, or a speed
PAYLOAD, APPROACH, SPEED = "payload_kg", "approach", "speed"
SETUP, TARGET, TIME = "setup", "target", "time_s"
_TEMPERATURE = "temperature_"  # begins the name of each temperature's column

Level = float | str | tuple[float, ...]
"""A value of a condition at one pose: a number, a name, or the side that each joint came from."""


@dataclass(frozen=True)
class Change:
    """A condition that differs between two poses, as a column of poses.csv, with its values at both."""

    column: str  # "payload_kg", "approach3" ...
    before: float | str
    after: float | str


@dataclass(frozen=True)
class Pair:
    """Two poses measured at the same joint values, and what differed between them."""

    first: int  # index into Poses
    second: int
    changes: tuple[Change, ...]


@dataclass(frozen=True)
class PairedPoses(Brief):
    """K poses at which one condition differs while the others that move an arm agree, by place."""

    conditions: tuple[str, ...]  # that differ: usually one, several where they never differ alone
    poses: IndexArray  # (K,) index into Poses, by place, in the order of the levels
    place: IndexArray  # (K,) number of each one's place, from 0
    level: IndexArray  # (K,) number of the level of the conditions, from 0: equal where they were equal
    of: Poses  # all poses of the dataset

    @property
    def is_held_out(self) -> NDArray[np.bool_]:
        """Mask (K,) of the poses at places where any pose is a test pose: no fit of differences sees these."""
        held = np.zeros(int(self.place.max(initial=-1)) + 1, dtype=bool)
        np.logical_or.at(held, self.place, self.of.is_test[self.poses])
        return np.asarray(held[self.place])

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """Neighbouring levels at each place, as pairs."""
        neighbours = [(k, k + 1) for k in range(len(self.poses) - 1) if self.place[k] == self.place[k + 1]]
        found = [(int(self.poses[a]), int(self.poses[b])) for a, b in neighbours]
        return tuple(Pair(a, b, tuple(self._changes(a, b))) for a, b in found)

    @property
    def levels(self) -> tuple[float, ...]:
        """Values of the condition, where it is one number for the whole arm; () for sides of approach and several."""
        if len(self.conditions) != 1:
            return ()
        values = conditions_of(self.of).get(self.conditions[0], [])
        return tuple(sorted({value for i in self.poses if isinstance(value := values[i], float)})) if values else ()

    def _changes(self, first: int, second: int) -> Iterator[Change]:
        levels = conditions_of(self.of)
        for name in self.conditions:
            if name == TARGET:
                continue
            before, after = levels[name][first], levels[name][second]
            if isinstance(before, tuple) and isinstance(after, tuple):
                sides = enumerate(zip(before, after, strict=True), 1)
                yield from (Change(f"{name}{joint}", *both) for joint, both in sides if both[0] != both[1])
            elif not isinstance(before, tuple) and not isinstance(after, tuple) and before != after:
                yield Change(name, before, after)

    def _brief(self) -> str:
        return f"{len(self.pairs)} pairs of poses that differ in {', '.join(self.conditions)}"


def conditions_of(poses: Poses) -> dict[str, list[Level]]:
    """Values (N) of each condition that poses may be paired by; those that move an arm first."""
    out: dict[str, list[Level]] = {}
    if poses.payload_kg is not None:
        out[PAYLOAD] = poses.payload_kg.tolist()
    if poses.temperature_c is not None:
        out["temperature_c"] = poses.temperature_c.tolist()
    for name, column in poses.extra.by_name.items():
        is_temperature = name.startswith(_TEMPERATURE) and name.endswith("_c")
        if (is_temperature or name == SPEED) and np.issubdtype(np.asarray(column).dtype, np.number):
            out[name] = np.asarray(column, dtype=float).tolist()
    if poses.approach is not None:
        out[APPROACH] = [tuple(sides) for sides in poses.approach.tolist()]
    out[SETUP] = poses.setup.tolist()
    out[TIME] = (poses.order if poses.time_s is None else poses.time_s).tolist()
    return out


def find_pairs(dataset: Dataset) -> tuple[PairedPoses, ...]:
    """All paired poses of a dataset, one value for each condition that differs at some place.

    At each place the poses are held against each other for one condition at a time, the others being equal. Where the
    arm was measured with several conditions changed at once, and never with one of them alone, they are named together.
    Poses that differ in setup, target or time alone come last.
    """
    if dataset.points is None or dataset.points.lengths is not None:  # their lines differ at equal joints too
        return ()
    poses, measured = dataset.poses, np.unique(dataset.points.pose)
    acting = {name: values for name, values in conditions_of(poses).items() if name not in (SETUP, TIME)}
    found: dict[tuple[str, ...], list[_Group]] = {}
    for place in places(dataset, measured):
        levels = {
            name: dict(zip(place, _levels(name, [values[i] for i in place]), strict=True))
            for name, values in acting.items()
        }
        differ = tuple(name for name, of_pose in levels.items() if len(set(of_pose.values())) > 1)
        alone: list[tuple[tuple[str, ...], list[int]]] = [
            ((name,), group)
            for name in differ
            for group in _split(place, [of_pose for other, of_pose in levels.items() if other != name])
            if len({levels[name][i] for i in group}) > 1
        ]
        for names, group in alone or [(differ or (_what_else(dataset, place),), place)]:
            found.setdefault(names, []).append(_group(group, [levels[name] for name in names if name in levels], poses))
    return tuple(
        _paired(names, found[names], poses)
        for names in sorted(found, key=lambda names: (names[0] not in acting, names))
    )


@dataclass(frozen=True)
class _Group:
    """Poses of a place in the order of their levels."""

    poses: list[int]
    levels: list[tuple[Level, ...]]


def _group(place: list[int], levels: list[dict[int, Level]], poses: Poses) -> _Group:
    """Poses of a place in the order of the levels that differ, or of measuring where none does."""
    if not levels:
        ordered = sorted(place, key=lambda i: poses.order[i])
        return _Group(ordered, [(float(visit),) for visit in range(len(ordered))])
    ordered = sorted(place, key=lambda i: (tuple(of_pose[i] for of_pose in levels), poses.order[i]))
    return _Group(ordered, [tuple(of_pose[i] for of_pose in levels) for i in ordered])


def _paired(names: tuple[str, ...], groups: list[_Group], poses: Poses) -> PairedPoses:
    place = np.repeat(np.arange(len(groups)), [len(group.poses) for group in groups])
    levels = [level for group in groups for level in group.levels]
    number = {level: k for k, level in enumerate(sorted(set(levels)))}
    rows = np.array([i for group in groups for i in group.poses])
    return PairedPoses(names, rows, place, np.array([number[level] for level in levels]), poses)


def places(dataset: Dataset, measured: IndexArray) -> list[list[int]]:
    """Poses with joint values that agree, among those measured; places with a single pose are left out."""
    poses = dataset.poses
    q = np.where(dataset.robot.is_revolute, np.degrees(poses.q), poses.q)  # deg, mm
    keys = np.column_stack([ranks(values, SAME_JOINT_DEG) for values in q[measured].T])
    coarse: dict[tuple[int, ...], list[int]] = {}
    for pose, key in zip(measured.tolist(), map(tuple, keys.tolist()), strict=True):
        coarse.setdefault(key, []).append(pose)
    out = []
    for group in coarse.values():
        left = group
        while len(left) > 1:
            near = np.abs(q[left] - q[left[0]]).max(axis=1) <= SAME_JOINT_DEG
            if np.count_nonzero(near) > 1:
                out.append([i for i, is_near in zip(left, near, strict=True) if is_near])
            left = [i for i, is_near in zip(left, near, strict=True) if not is_near]
    return sorted(out)


def _levels(name: str, values: list[Level]) -> list[Level]:
    """Levels of a condition at the poses of one place, equal where no difference counts.

    Of a temperature, which is read and not set, its rank at this place.
    """
    if isinstance(values[0], tuple):
        return values
    numbers = np.array(values, dtype=float)
    if name.startswith(_TEMPERATURE):
        return [float(rank) for rank in ranks(numbers, SAME_TEMPERATURE_C)]
    return [float(value) for value in np.round(numbers / _SAME_AMOUNT) * _SAME_AMOUNT]


def _split(place: list[int], levels: list[dict[int, Level]]) -> list[list[int]]:
    """The poses of a place in groups of equal levels of some conditions; groups with a single pose are left out."""
    out: dict[tuple[Level, ...], list[int]] = {}
    for i in place:
        out.setdefault(tuple(of_pose[i] for of_pose in levels), []).append(i)
    return [group for group in out.values() if len(group) > 1]


def _what_else(dataset: Dataset, place: list[int]) -> str:
    """What differs between poses of a place at which the arm was under the same conditions."""
    points = dataset.points
    assert points is not None
    targets = [frozenset(points.target[points.pose == i].tolist()) for i in place]
    if any(one != other for one, other in pairwise(targets)):
        return TARGET
    return SETUP if len(set(dataset.poses.setup[place].tolist())) > 1 else TIME
