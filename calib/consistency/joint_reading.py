"""Interpretation of a table's joint columns under other conventions: signs, order, zeros, sums of neighbours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from calib.array_types import Array, BoolArray

_MOST_SIGNS = 8  # joints up to which all patterns of signs are tried
_QUARTERS = (0.5 * np.pi, -0.5 * np.pi, np.pi)


@dataclass(frozen=True)
class JointReading:
    """Interpretation of joint columns: q_k = sign_k * column order_k + further columns + offset_k, in rad and mm."""

    order: tuple[int, ...]
    signs: tuple[float, ...]
    offsets_rad: tuple[float, ...]
    added: tuple[tuple[int, int, float], ...] = ()
    """(k, j, factor): column order_j, times the factor, is added to joint k; joints from 0."""

    @classmethod
    def plain(cls, joints: int) -> JointReading:
        """Interpretation that leaves every column unchanged."""
        return cls(tuple(range(joints)), (1.0,) * joints, (0.0,) * joints)

    @property
    def edits(self) -> int:
        """Number of changed signs, zeros, exchanges of columns and columns that are added to others."""
        moved = sum(k != column for k, column in enumerate(self.order))
        zeros = sum(offset != 0.0 for offset in self.offsets_rad)
        return sum(sign < 0 for sign in self.signs) + zeros + (moved + 1) // 2 + len(self.added)

    @property
    def rank(self) -> tuple[int, int]:
        """Order of the simple before the others: by changes, zeros last, as a wrong sign may look like a wrong zero."""
        return self.edits, sum(offset != 0.0 for offset in self.offsets_rad)

    @property
    def joints(self) -> tuple[int, ...]:
        """Numbers, from 1, of the joints whose values change."""
        plain = JointReading.plain(len(self.order))
        changed = np.array(self.order) != plain.order
        changed |= (self.coupling != np.eye(len(self.order))).any(axis=1) | (np.array(self.offsets_rad) != 0.0)
        return tuple((np.flatnonzero(changed) + 1).tolist())

    @property
    def coupling(self) -> Array:
        """Matrix (n, n) from the columns, put in order, to the joints."""
        matrix = np.diag(self.signs)
        for k, j, factor in self.added:
            matrix[k, j] += factor
        return matrix

    @property
    def solved(self) -> JointReading | None:
        """Reading by which the columns are what this one makes of the joints; None where it is no sum of whole columns.

        Of sums alone.
        """
        by_column = np.linalg.inv(self.coupling) if np.linalg.det(self.coupling) else np.zeros(0)
        off = by_column - np.eye(len(self.order)) if by_column.size else by_column
        if not off.size or np.diag(off).any():
            return None
        return replace(self, added=tuple((int(k), int(j), float(off[k, j])) for k, j in np.argwhere(off)))

    def of(self, q: Array) -> Array:
        """Joint values (N, n), rad or mm, interpreted from a file's values."""
        return q[:, list(self.order)] @ self.coupling.T + np.array(self.offsets_rad)


def simple_readings(is_revolute: BoolArray) -> tuple[JointReading, ...]:
    """Readings with any pattern of signs, two columns exchanged, all columns reversed, or one other zero."""
    plain, n = JointReading.plain(len(is_revolute)), len(is_revolute)
    edited = [reading for reading in edits(plain, is_revolute) if not reading.added]
    out = [*edited, *with_signs([plain], n)]
    if is_revolute.all() and n > 1:
        out.append(replace(plain, order=tuple(reversed(range(n)))))
    return tuple(reading for reading in dict.fromkeys(out) if reading.edits)


def with_signs(readings: Sequence[JointReading], n: int) -> Iterator[JointReading]:
    """Readings of n joints with every pattern of signs, or of many joints with two turned."""
    if n <= _MOST_SIGNS:
        patterns = list(product((1.0, -1.0), repeat=n))
    else:
        pairs = combinations(range(n), 2)
        patterns = [(1.0,) * n, *(tuple(-1.0 if k in pair else 1.0 for k in range(n)) for pair in pairs)]
    for reading in readings:
        yield from (replace(reading, signs=signs) for signs in patterns)


def edits(reading: JointReading, turns: BoolArray, *, far: bool = False) -> Iterator[JointReading]:
    """All readings with one more change: a sign, a zero, two columns exchanged, one added to another or taken off.

    The zeros of the first and the last joint are left out, as the scanner's and the tool's pose absorb them.

    far: whether a column may be added to one that is no neighbour.
    """
    n = len(turns)
    for k in range(n):
        signs = list(reading.signs)
        signs[k] = -signs[k]
        yield replace(reading, signs=tuple(signs))
        if turns[k] and 0 < k < n - 1 and reading.offsets_rad[k] == 0.0:
            for quarter in _QUARTERS:
                offsets = list(reading.offsets_rad)
                offsets[k] = quarter
                yield replace(reading, offsets_rad=tuple(offsets))
    for i, j in combinations(range(n), 2):
        if turns[i] != turns[j]:
            continue
        order = list(reading.order)
        order[i], order[j] = order[j], order[i]
        yield replace(reading, order=tuple(order))
        for to, of in ((i, j), (j, i)):
            if (far or j == i + 1) and not any(add[:2] == (to, of) for add in reading.added):
                for factor in (1.0, -1.0):
                    summed = replace(reading, added=tuple(sorted((*reading.added, (to, of, factor)))))
                    if abs(np.linalg.det(summed.coupling)) > 0.5:  # else the joints do not tell the columns
                        yield summed
