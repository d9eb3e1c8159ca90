"""Shape of the noise of measured points where it differs with direction, place or time.

Only the shape: the mean variance stays as declared. `calib.fitting.noise` applies it to points.
"""

from __future__ import annotations

from dataclasses import dataclass

Row = tuple[float, float, float]
_MOST, _MOST_GROWTH, _FURTHEST_MM = 1e3, 50.0, 1e6
IDENTITY: tuple[Row, Row, Row] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class CorrelatedDrift:
    """Slow part of the noise, shared by points measured soon after each other: correlation exp(-|dt| / time).

    An Ornstein-Uhlenbeck process that shifts all measured points together, independently in each axis.
    """

    share: float  # of the noise's variance, 0 ... 1
    time: float  # s, or poses in the order of measuring
    in_poses: bool = False  # `time` counts poses, because the times of measuring are not known


@dataclass(frozen=True)
class NoiseShape:
    """Shape of a measured point's noise: scale, direction, growth with distance, drift and tail.

    Noise = scale x exp(growth (d - distance)) x axes x (1 + (depth - 1) u u^T) x declared noise.

    u is the line of sight from the scanner's origin, d the point's distance from there.
    """

    scale: float = 1.0  # so that the mean variance stays as declared
    depth: float = 1.0  # sigma along the line of sight over sigma across it
    axes: tuple[Row, Row, Row] = IDENTITY  # symmetric, in the scanner's frame
    growth_per_m: float = 0.0
    distance_mm: float = 0.0
    wander: CorrelatedDrift | None = None  # a key of model.json and of session files, hence its name
    tail: float | None = None  # degrees of freedom of Student's t; None: normal

    @property
    def is_possible(self) -> bool:
        """Whether the values describe a possible noise and lie within computable limits."""
        (a, b, c), (d, e, f), (g, h, i) = self.axes
        volume = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
        sizes = (self.scale, self.depth, volume)
        return (
            all(1.0 / _MOST < size < _MOST for size in sizes)
            and max(abs(entry) for row in self.axes for entry in row) < _MOST
            and abs(self.growth_per_m) < _MOST_GROWTH
            and 0.0 <= self.distance_mm < _FURTHEST_MM
            and (self.wander is None or (0.0 < self.wander.share < 1.0 and self.wander.time > 0.0))
            and (self.tail is None or self.tail > 2.0)
        )

    @property
    def reshapes_points(self) -> bool:
        """Whether the covariance of single points differs from the declared one."""
        return self.depth != 1.0 or self.axes != IDENTITY or self.growth_per_m != 0.0
