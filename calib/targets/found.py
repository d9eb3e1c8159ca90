"""What a finder says of one target in one scan, and the protocol that every finder has, a user's own too.

A finder is a function from a scan and a target to the places where such a target is. It does not know which of several
equal targets a place belongs to: `calib.targets.assignment` tells them apart, from all poses together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from calib.array_types import Array, ByteArray, IndexArray
from calib.scans.scan import Scan


@dataclass(frozen=True)
class FoundPoint:
    """One place where a target may be, in the scanner's frame."""

    xyz_mm: Array  # (3,) of the target's point: a sphere's centre, a plate's corner
    covariance_mm2: Array  # (3, 3)
    points: int = 0  # of the scan, that it was made from
    rms_mm: float = 0.0  # robust: of those points about the target's surface
    inlier_bits: ByteArray = field(
        default_factory=lambda: np.zeros(0, dtype=np.uint8)
    )  # (N / 8,) as in `Face`
    facts: Mapping[str, float] = field(default_factory=dict)  # name with its unit -> what was found besides
    doubts: tuple[str, ...] = ()  # what should be checked, each with what would help
    radius_mm: float | None = None  # of a sphere to draw about the point

    @property
    def inliers(self) -> IndexArray:
        """(points,) indices into the scan's points."""
        return np.flatnonzero(np.unpackbits(self.inlier_bits))

    def sigma_mm(self) -> float:
        """Standard deviation of the point, all three axes together: sqrt(trace of the covariance)."""
        return float(np.sqrt(np.trace(self.covariance_mm2)))


class TargetFinder(Protocol):
    """Find every place in a scan where a target of this shape is, the surest first.

    `shape` is one of `calib.target_shapes`, `scan_sigma_mm` the scanner's declared noise along the ray or None. At most
    `most` places are wanted: as many as the dataset has targets of this shape. Raises TargetError with the reason, in
    one line that says what would help, where there is none.
    """

    def __call__(
        self, scan: Scan, shape: Any, scan_sigma_mm: float | None = None, most: int = 1
    ) -> Sequence[FoundPoint]: ...
