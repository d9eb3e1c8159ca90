"""Protocol of every finder of targets, including a user's own: its request and its answer.

A finder is a function from a scan and what is wanted in it to the places where such targets are. It does not know which
of several equal targets a place belongs to: `calib.targets.assignment` decides that from all poses together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from calib.array_types import Array, ByteArray, IndexArray
from calib.corners.correlated_noise.declared import NOTHING_DECLARED, DeclaredNoise
from calib.scans.scan import Scan
from calib.target_shapes import Shape


@dataclass(frozen=True)
class Wanted:
    """Request to a finder: all targets of one shape."""

    shape: Shape
    names: tuple[str, ...] = ("jig",)  # of the targets that have this shape
    scan_sigma_mm: float | None = None  # the scanner's declared noise along the ray
    declared: DeclaredNoise = NOTHING_DECLARED  # of its smooth error

    @property
    def most(self) -> int:
        """Number of places wanted."""
        return len(self.names)


@dataclass(frozen=True)
class FoundPoint:
    """Place where a target may be, in the scanner's frame."""

    xyz_mm: Array  # (3,) of the target's point: a sphere's centre, a plate's corner
    covariance_mm2: Array  # (3, 3)
    points: int = 0  # of the scan, that it was made from
    rms_mm: float = 0.0  # robust: of those points about the target's surface
    inlier_bits: ByteArray = field(default_factory=lambda: np.zeros(0, dtype=np.uint8))  # (N / 8,) as in `Face`
    facts: Mapping[str, float] = field(default_factory=dict)  # name with its unit -> what was found besides
    doubts: tuple[str, ...] = ()  # what should be checked, each with what would help
    radius_mm: float | None = None  # of a sphere to draw about the point
    name: str = ""  # of the target, where the shape itself identifies it

    @property
    def inliers(self) -> IndexArray:
        """Indices (points,) of the scan's points from which the place was computed."""
        return np.flatnonzero(np.unpackbits(self.inlier_bits))

    def sigma_mm(self) -> float:
        """Standard deviation of the point over all three axes: sqrt(trace of the covariance)."""
        return float(np.sqrt(np.trace(self.covariance_mm2)))


class TargetFinder(Protocol):
    """Function that finds at most `wanted.most` places of targets of one shape in a scan, the surest first.

    Raises TargetError with the reason, in one line that says what would help, where there is none.
    """

    def __call__(self, scan: Scan, wanted: Wanted) -> Sequence[FoundPoint]: ...
