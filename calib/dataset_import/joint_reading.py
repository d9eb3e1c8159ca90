"""Joint angles as another convention counts them: the signs, order and zeros that the points speak for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from calib.array_types import Array, BoolArray
from calib.dataset_import.agreement import Sample, misfit_mm
from calib.kinematics.robot import Robot

GAIN = 5.0  # times less is left over; nothing smaller is overwhelming
AGREES = 0.1  # of the points' spread, at most, where arm and points belong together
LOOKS_RIGHT = 0.02  # of the points' spread: below it no other reading is looked for
_RIVAL = 2.0  # another reading as simple that leaves less than this many times as much is as good
_BEAM, _DEEPEST = 6, 3
_MOST_SIGNS = 8  # joints up to which all patterns of signs are tried
_QUARTERS = (0.5 * np.pi, -0.5 * np.pi, np.pi)


@dataclass(frozen=True)
class JointReading:
    """q_k = sign_k * value of column order_k + offset_k: how a table's columns make joint values."""

    order: tuple[int, ...]
    signs: tuple[float, ...]
    offsets_rad: tuple[float, ...]

    @classmethod
    def plain(cls, joints: int) -> JointReading:
        """Each as it stands."""
        return cls(tuple(range(joints)), (1.0,) * joints, (0.0,) * joints)

    @property
    def edits(self) -> int:
        """How many things it changes."""
        moved = sum(k != column for k, column in enumerate(self.order))
        return sum(s < 0 for s in self.signs) + sum(o != 0.0 for o in self.offsets_rad) + (moved + 1) // 2

    def of(self, q: Array) -> Array:
        """(N, n) joint values of those in the file, rad or mm."""
        return np.asarray(q[:, list(self.order)] * np.array(self.signs) + np.array(self.offsets_rad))


@dataclass(frozen=True)
class Found:
    """A reading, what it leaves over, and another one that is as simple and as good, if there is one."""

    reading: JointReading
    misfit_mm: float
    rival: JointReading | None = None


def better_reading(robot: Robot, sample: Sample, misfit_as_it_is_mm: float) -> Found | None:
    """The simplest reading that leaves overwhelmingly less over than the values as they stand; None without one."""
    most = min(misfit_as_it_is_mm / GAIN, AGREES * sample.spread_mm)
    turns = robot.is_revolute
    tried: dict[JointReading, float] = {}

    def judged(readings: Iterable[JointReading]) -> None:
        for reading in readings:
            if reading not in tried:
                tried[reading] = misfit_mm(robot, reading.of(sample.q), sample.points_mm)

    if robot.n_joints <= _MOST_SIGNS:
        judged(_sign_patterns(robot.n_joints))
    if turns.all():
        judged([replace(JointReading.plain(robot.n_joints), order=tuple(reversed(range(robot.n_joints))))])
    beam = [JointReading.plain(robot.n_joints)]
    for _ in range(_DEEPEST):
        edited = [edit for reading in beam for edit in _edits(reading, turns)]
        judged(edited)
        beam = sorted(set(edited), key=lambda reading: tried[reading])[:_BEAM]
    good = [reading for reading, misfit in tried.items() if misfit <= most]
    if not good:
        return None
    # What changes more and leaves no less says nothing: a joint that moves the point little may have any sign.
    least = min(tried[reading] for reading in good)
    simplest = min(reading.edits for reading in good if tried[reading] <= _RIVAL * least)
    simple = sorted((r for r in good if r.edits == simplest), key=lambda reading: tried[reading])
    rivals = [r for r in simple[1:] if tried[r] < _RIVAL * tried[simple[0]]]
    return Found(simple[0], tried[simple[0]], rivals[0] if rivals else None)


def _sign_patterns(joints: int) -> Iterator[JointReading]:
    plain = JointReading.plain(joints)
    for signs in product((1.0, -1.0), repeat=joints):
        if -1.0 in signs:
            yield replace(plain, signs=signs)


def _edits(reading: JointReading, turns: BoolArray) -> Iterator[JointReading]:
    """All readings that are one change away: a sign, a zero, two columns that change places."""
    for k in range(len(turns)):
        signs = list(reading.signs)
        signs[k] = -signs[k]
        yield replace(reading, signs=tuple(signs))
        if turns[k] and reading.offsets_rad[k] == 0.0:
            for quarter in _QUARTERS:
                offsets = list(reading.offsets_rad)
                offsets[k] = quarter
                yield replace(reading, offsets_rad=tuple(offsets))
    for i, j in combinations(range(len(turns)), 2):
        if turns[i] == turns[j]:
            order = list(reading.order)
            order[i], order[j] = order[j], order[i]
            yield replace(reading, order=tuple(order))
