"""What a scanner evidently sees: the space in which it measured, a little widened; and where it then stands."""

from __future__ import annotations

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.dataset.dataset import Scanner
from calib.errors import CalibError
from calib.workcell.scan_field import JANG_FIELD, BoxField, ScanField

MAX_INCIDENCE_DEG = 70.0
_WIDER = 0.1  # of the range that was measured, either side
_LEAST_MM = 40.0  # by which it is widened
_WIDEST = 1.0  # tangent off the line of sight: beyond it the instrument's z axis is no line of sight
_TRIM = 5.0  # times the median residual: a point farther off says nothing of the scanner's place


def evident_field(scanner: Scanner, apex_mm: Array) -> tuple[ScanField | BoxField, str]:
    """The field that dataset.toml tells, else that in which apexes (M, 3), scanner frame, were measured; and its words.

    Raises:
        CalibError: neither is there.
    """
    incidence = scanner.max_incidence_deg or MAX_INCIDENCE_DEG
    if scanner.field_mm is not None and scanner.distance_mm is not None:
        width, height, depth = scanner.field_mm
        field = ScanField(scanner.distance_mm, width, height, depth, JANG_FIELD.margin_mm, incidence)
        return (
            field,
            f"scanner's field: {width:g} x {height:g} x {depth:g} mm at {scanner.distance_mm:g} mm, as told",
        )
    if not len(apex_mm):
        raise CalibError("no point is measured, so nothing tells the scanner's field; add [scanner] field_mm")
    low, high = _widened(apex_mm)
    if low[2] <= 0.0 or np.any(np.abs(apex_mm[:, :2]) > _WIDEST * apex_mm[:, 2:]):
        told = " x ".join(f"{size:.0f}" for size in high - low)
        box = BoxField((low[0], low[1], low[2]), (high[0], high[1], high[2]), incidence)
        return box, f"space that is measured: {told} mm, where points were measured and a little more"
    distance = float(0.5 * (low[2] + high[2]))
    left, right = _widened(apex_mm[:, :2] * (distance / apex_mm[:, 2:]))
    (width, height), middle = right - left, 0.5 * (left + right)
    field = ScanField(
        distance, float(width), float(height), float(high[2] - low[2]), 0.0, incidence,
        (float(middle[0]), float(middle[1])),
    )  # fmt: skip
    said = f"{width:.0f} x {height:.0f} x {field.depth_mm:.0f} mm at {distance:.0f} mm"
    return field, f"scanner's field: {said}, where the jig was measured and a little more"


def _widened(values: Array) -> tuple[Array, Array]:
    low, high = values.min(axis=0), values.max(axis=0)
    more = np.maximum(_WIDER * (high - low), _LEAST_MM)
    return low - more, high + more


def fitted_scanner_place(base_mm: Array, scanner_mm: Array) -> Array:
    """base_T_scanner (4, 4) that brings measured points (M, 3) onto the nominal arm's, without what lies far off."""
    base_T_scanner = frames.best_fit_transform(scanner_mm, base_mm)
    off_mm = np.linalg.norm(frames.apply(base_T_scanner, scanner_mm) - base_mm, axis=1)
    keep = off_mm <= _TRIM * np.median(off_mm)
    return frames.best_fit_transform(scanner_mm[keep], base_mm[keep]) if keep.sum() >= 3 else base_T_scanner
