"""Where in its own frame a scanner measures: a camera's field, or the space in which it was seen to measure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray


@dataclass(frozen=True)
class ScanField:
    """The scanner's field and the steepest incidence on a face (Jang 2025: 450 mm field, 700 mm away)."""

    distance_mm: float = 700.0
    width_mm: float = 450.0  # at that distance, as the height
    height_mm: float = 360.0
    depth_mm: float = 280.0
    margin_mm: float = 60.0  # the apex keeps this far from the field's sides, so that the jig is inside
    max_incidence_deg: float = 65.0
    middle_mm: tuple[float, float] = (0.0, 0.0)  # of the field at that distance, off the line of sight

    @property
    def half_mm(self) -> Array:
        """(2,) how far the apex may be from the field's middle at the field's distance."""
        return 0.5 * np.array([self.width_mm, self.height_mm]) - self.margin_mm

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """(count, 3) apexes in the field's frustum, scanner frame."""
        depth_mm = self.distance_mm + self.depth_mm * rng.uniform(-0.5, 0.5, count)
        across = rng.uniform(-self.half_mm, self.half_mm, (count, 2)) + np.array(self.middle_mm)
        return np.column_stack([across * (depth_mm / self.distance_mm)[:, None], depth_mm])

    def contains(self, apex_mm: Array) -> BoolArray:
        """(N,) whether apexes (N, 3), scanner frame, lie in it."""
        depth_mm = apex_mm[:, 2]
        inside = np.abs(depth_mm - self.distance_mm) <= 0.5 * self.depth_mm
        across = apex_mm[:, :2] * (self.distance_mm / np.where(inside, depth_mm, 1.0))[:, None]
        off_mm = np.abs(across - np.array(self.middle_mm))
        return np.asarray(inside & (depth_mm > 0.0) & np.all(off_mm <= self.half_mm, axis=1))


@dataclass(frozen=True)
class BoxField:
    """A box in the scanner's frame: where an instrument that looks all around was seen to measure."""

    low_mm: tuple[float, float, float]
    high_mm: tuple[float, float, float]
    max_incidence_deg: float = 70.0

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """(count, 3) apexes, scanner frame."""
        return rng.uniform(self.low_mm, self.high_mm, (count, 3))

    def contains(self, apex_mm: Array) -> BoolArray:
        """(N,) whether apexes (N, 3), scanner frame, lie in it."""
        return np.asarray(np.all((apex_mm >= np.array(self.low_mm)) & (apex_mm <= np.array(self.high_mm)), axis=1))


JANG_FIELD = ScanField()


def tilted(sight: Array, most_deg: float, rng: np.random.Generator) -> Array:
    """Unit axes (N, 3) within a tilt of the lines of sight (N, 3), spread evenly over the cap."""
    cosine = rng.uniform(np.cos(np.radians(most_deg)), 1.0, len(sight))
    azimuth = rng.uniform(-np.pi, np.pi, len(sight))
    aside = np.where(np.abs(sight[:, :1]) > 0.99, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    across = np.cross(sight, aside)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(sight, across)
    sideways = np.cos(azimuth)[:, None] * across + np.sin(azimuth)[:, None] * other
    return np.asarray(cosine[:, None] * sight + np.sqrt(1.0 - cosine**2)[:, None] * sideways)
