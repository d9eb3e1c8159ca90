"""The space in which a scanner measures, in its own frame: declared, or inferred from earlier measurements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray, Vector
from calib.dataset.dataset import Scanner
from calib.errors import CalibError

MAX_INCIDENCE_DEG = 70.0
_WIDER = 0.1  # of the range that was measured, either side
_LEAST_MM = 40.0  # by which it is widened
_WIDEST = 1.0  # tangent off the line of sight: beyond it the instrument's z axis is no line of sight


@dataclass(frozen=True)
class ScanField:
    """Measuring field of a camera-like scanner, and its largest incidence on a face (Jang 2025: 450 mm, at 700 mm)."""

    distance_mm: float = 700.0
    width_mm: float = 450.0  # at that distance, as the height
    height_mm: float = 360.0
    depth_mm: float = 280.0
    margin_mm: float = 60.0  # the apex keeps this far from the field's sides, so that the jig is inside
    max_incidence_deg: float = 65.0
    middle_mm: tuple[float, float] = (0.0, 0.0)  # of the field at that distance, off the line of sight

    @property
    def half_mm(self) -> Array:
        """Largest offset (2,) of the apex from the field's middle at the field's distance."""
        return 0.5 * np.array([self.width_mm, self.height_mm]) - self.margin_mm

    @property
    def corners_mm(self) -> Array:
        """Corners (2, 4, 3) of the field's frustum in the scanner's frame: the near end, then the far one, around."""
        around = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        across = np.array(self.middle_mm) + 0.5 * around * [self.width_mm, self.height_mm]
        depths_mm = self.distance_mm + self.depth_mm * np.array([-0.5, 0.5])
        ends = [np.column_stack([across * depth / self.distance_mm, np.full(4, depth)]) for depth in depths_mm]
        return np.array(ends)

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """(count, 3) random apexes in the field's frustum, scanner frame."""
        depth_mm = self.distance_mm + self.depth_mm * rng.uniform(-0.5, 0.5, count)
        across = rng.uniform(-self.half_mm, self.half_mm, (count, 2)) + np.array(self.middle_mm)
        return np.column_stack([across * (depth_mm / self.distance_mm)[:, None], depth_mm])

    def contains(self, apex_mm: Array) -> BoolArray:
        """Mask (N,): whether apexes (N, 3), scanner frame, lie in the field."""
        depth_mm = apex_mm[:, 2]
        inside = np.abs(depth_mm - self.distance_mm) <= 0.5 * self.depth_mm
        across = apex_mm[:, :2] * (self.distance_mm / np.where(inside, depth_mm, 1.0))[:, None]
        off_mm = np.abs(across - np.array(self.middle_mm))
        return inside & (depth_mm > 0.0) & np.all(off_mm <= self.half_mm, axis=1)


@dataclass(frozen=True)
class BoxField:
    """Field of an instrument that measures in all directions: the box, in its frame, of its measured points."""

    low_mm: Vector
    high_mm: Vector
    max_incidence_deg: float = 70.0

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """(count, 3) random apexes in the box, scanner frame."""
        return rng.uniform(self.low_mm, self.high_mm, (count, 3))

    def contains(self, apex_mm: Array) -> BoolArray:
        """Mask (N,): whether apexes (N, 3), scanner frame, lie in the box."""
        return np.all((apex_mm >= np.array(self.low_mm)) & (apex_mm <= np.array(self.high_mm)), axis=1)


JANG_FIELD = ScanField()


def tilted(sight: Array, most_deg: float, rng: np.random.Generator) -> Array:
    """Random unit vectors (N, 3) within an angle of the lines of sight (N, 3), uniform over the cap."""
    cosine = rng.uniform(np.cos(np.radians(most_deg)), 1.0, len(sight))
    azimuth = rng.uniform(-np.pi, np.pi, len(sight))
    aside = np.where(np.abs(sight[:, :1]) > 0.99, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    across = np.cross(sight, aside)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(sight, across)
    sideways = np.cos(azimuth)[:, None] * across + np.sin(azimuth)[:, None] * other
    return cosine[:, None] * sight + np.sqrt(1.0 - cosine**2)[:, None] * sideways


def declared_field(scanner: Scanner) -> ScanField | None:
    """Measuring field that dataset.toml declares for the scanner; None where it declares none."""
    if scanner.field_mm is None or scanner.distance_mm is None:
        return None
    incidence = scanner.max_incidence_deg or MAX_INCIDENCE_DEG
    return ScanField(scanner.distance_mm, *scanner.field_mm, JANG_FIELD.margin_mm, incidence)


def evident_field(scanner: Scanner, apex_mm: Array) -> tuple[ScanField | BoxField, str]:
    """Measuring field of the scanner, declared in dataset.toml or inferred from measured apexes (M, 3); and a note.

    Raises:
        CalibError: neither exists.
    """
    incidence = scanner.max_incidence_deg or MAX_INCIDENCE_DEG
    declared = declared_field(scanner)
    if declared is not None:
        size = f"{declared.width_mm:g} x {declared.height_mm:g} x {declared.depth_mm:g} mm"
        return declared, f"scanner's field: {size} at {declared.distance_mm:g} mm, as declared"
    if not len(apex_mm):
        raise CalibError("no point is measured, so the scanner's field is not known; add [scanner] field_mm")
    low, high = _widened(apex_mm)
    if low[2] <= 0.0 or np.any(np.abs(apex_mm[:, :2]) > _WIDEST * apex_mm[:, 2:]):
        size = " x ".join(f"{size:.0f}" for size in high - low)
        box = BoxField((low[0], low[1], low[2]), (high[0], high[1], high[2]), incidence)
        return box, f"space that is measured: {size} mm, where points were measured and a little more"
    distance = float(0.5 * (low[2] + high[2]))
    low_xy, high_xy = _widened(apex_mm[:, :2] * (distance / apex_mm[:, 2:]))
    (width, height), middle = high_xy - low_xy, 0.5 * (low_xy + high_xy)
    field = ScanField(
        distance, float(width), float(height), float(high[2] - low[2]), 0.0, incidence,
        (float(middle[0]), float(middle[1])),
    )  # fmt: skip
    size = f"{width:.0f} x {height:.0f} x {field.depth_mm:.0f} mm at {distance:.0f} mm"
    return field, f"scanner's field: {size}, where the jig was measured and a little more"


def _widened(values: Array) -> tuple[Array, Array]:
    """Least and largest coordinates of points, each moved outward by a tenth of the range or more."""
    low, high = values.min(axis=0), values.max(axis=0)
    more = np.maximum(_WIDER * (high - low), _LEAST_MM)
    return low - more, high + more
