"""Interpretation of a table's joint columns under other conventions: other signs, another order, other zeros."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from calib.array_types import Array, BoolArray
from calib.consistency.agreement import Sample, misfit_mm
from calib.kinematics.robot import Robot

_BEAM, _DEEPEST = 6, 3
_MOST_SIGNS = 8  # joints up to which all patterns of signs are tried
_QUARTERS = (0.5 * np.pi, -0.5 * np.pi, np.pi)


@dataclass(frozen=True)
class JointReading:
    """Interpretation of joint columns: q_k = sign_k * value of column order_k + offset_k."""

    order: tuple[int, ...]
    signs: tuple[float, ...]
    offsets_rad: tuple[float, ...]

    @classmethod
    def plain(cls, joints: int) -> JointReading:
        """Interpretation that leaves every column unchanged."""
        return cls(tuple(range(joints)), (1.0,) * joints, (0.0,) * joints)

    @property
    def edits(self) -> int:
        """Number of changed signs, zeros and exchanges of columns."""
        moved = sum(k != column for k, column in enumerate(self.order))
        return sum(s < 0 for s in self.signs) + sum(o != 0.0 for o in self.offsets_rad) + (moved + 1) // 2

    @property
    def joints(self) -> tuple[int, ...]:
        """Numbers, from 1, of the joints whose values change."""
        return tuple(
            k + 1
            for k, (column, sign, offset) in enumerate(zip(self.order, self.signs, self.offsets_rad, strict=True))
            if column != k or sign < 0 or offset != 0.0
        )

    def of(self, q: Array) -> Array:
        """Joint values (N, n), rad or mm, interpreted from a file's values."""
        return q[:, list(self.order)] * np.array(self.signs) + np.array(self.offsets_rad)


def simple_readings(is_revolute: BoolArray) -> tuple[JointReading, ...]:
    """Interpretations with any pattern of signs, two columns exchanged, all columns reversed, or one other zero."""
    plain, n = JointReading.plain(len(is_revolute)), len(is_revolute)
    out = list(_edits(plain, is_revolute))
    if n <= _MOST_SIGNS:
        patterns = (replace(plain, signs=signs) for signs in product((1.0, -1.0), repeat=n))
    else:
        patterns = (replace(plain, signs=tuple(-1.0 if k in pair else 1.0 for k in range(n)))
                    for pair in combinations(range(n), 2))  # fmt: skip
    out += [reading for reading in patterns if reading.edits]
    if is_revolute.all() and n > 1:
        out.append(replace(plain, order=tuple(reversed(range(n)))))
    return tuple(dict.fromkeys(out))


def likely_readings(robot: Robot, sample: Sample) -> tuple[JointReading, ...]:
    """Interpretations with up to three changes that have the least misfit of the nominal arm (beam search)."""
    tried: dict[JointReading, float] = {}
    beam = [JointReading.plain(robot.n_joints)]
    for _ in range(_DEEPEST):
        edited = list(dict.fromkeys(edit for reading in beam for edit in _edits(reading, robot.is_revolute)))
        for reading in edited:
            if reading.edits and reading not in tried:
                tried[reading] = misfit_mm(robot, replace(sample, q=reading.of(sample.q)))
        beam = sorted((r for r in edited if r.edits), key=lambda reading: tried[reading])[:_BEAM]
    return tuple(sorted(tried, key=lambda reading: tried[reading])[: _BEAM * _DEEPEST])


def _edits(reading: JointReading, turns: BoolArray) -> Iterator[JointReading]:
    """All interpretations with one more change of the joint columns: a sign, a zero, or two columns exchanged.

    The zeros of the first and the last joint are left out, as the scanner's and the tool's pose absorb them.
    """
    for k in range(len(turns)):
        signs = list(reading.signs)
        signs[k] = -signs[k]
        yield replace(reading, signs=tuple(signs))
        if turns[k] and 0 < k < len(turns) - 1 and reading.offsets_rad[k] == 0.0:
            for quarter in _QUARTERS:
                offsets = list(reading.offsets_rad)
                offsets[k] = quarter
                yield replace(reading, offsets_rad=tuple(offsets))
    for i, j in combinations(range(len(turns)), 2):
        if turns[i] == turns[j]:
            order = list(reading.order)
            order[i], order[j] = order[j], order[i]
            yield replace(reading, order=tuple(order))
