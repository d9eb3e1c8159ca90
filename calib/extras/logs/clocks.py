"""Offset between the clocks of joints and points, by the motion that both have seen.

The nominal arm's tool and the measured point move at nearly the same speeds, whatever the scanner's frame; the lag at
which the speeds correlate best is the offset.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import correlate, correlation_lags, find_peaks

from calib.array_types import Array
from calib.extras.logs.series import RecordingError

STEP_S = 0.02
_SMOOTH_S = 0.08
_LEAST_CORRELATION = 0.85
_RIVAL = 0.8  # of the best correlation, from which another lag is possible, too
_APART_S = 0.6  # of two lags that are not one
_LEAST_OVERLAP = 0.5  # of the shorter recording
_MOST_RIVALS = 6
_ENOUGH = 0.8  # of single points, that stops have to hold
_ONE_LAG_S = 2.0  # that lags of single points differ at most, or by the shortest stop on both sides


def possible_offsets(
    joint_s: Array, path_mm: Array, point_s: Array, points: Array, most_s: float = np.inf
) -> list[tuple[float, float]]:
    """Lags, s, at which the speeds of tool and point agree, with their correlations, the best first.

    A lag is that of the parabola through the three correlations about a largest one.

    Args:
        joint_s: (N,) times of the joints.
        path_mm: (N, 3) the nominal tool at these times.
        point_s: (M,) times of the points, by their own clock.
        points: (M, 3) in any unit.
        most_s: largest lag; inf for any, as of clocks that count from different days.
    """
    mine, seen = speeds(joint_s, path_mm), speeds(point_s, points)
    here, there, a, b = np.ones(len(mine)), np.ones(len(seen)), mine - mine.mean(), seen - seen.mean()
    overlap = correlate(there, here, method="fft")
    norm = correlate(there, a**2, method="fft") * correlate(b**2, here, method="fft")
    quality = correlate(b, a, method="fft") / np.sqrt(np.maximum(norm, 1e-300))
    lags = correlation_lags(len(seen), len(mine)) * STEP_S + (point_s[0] - joint_s[0])
    enough = overlap >= max(_LEAST_OVERLAP * min(len(mine), len(seen)), 3.0 / STEP_S)
    quality = np.where(enough & (np.abs(lags) <= most_s), quality, -1.0)
    peaks = find_peaks(quality, height=_LEAST_CORRELATION, distance=round(_APART_S / STEP_S))[0]
    best = peaks[np.argsort(-quality[peaks])][:_MOST_RIVALS]
    before, top, after = (quality[best + k] for k in (-1, 0, 1))
    offsets = lags[best] + 0.5 * STEP_S * (before - after) / (before - 2.0 * top + after)
    return [(float(lag), float(q)) for lag, q in zip(offsets, top, strict=True) if q >= _RIVAL * top[0]]


def speeds(time_s: Array, places: Array) -> Array:
    """Smoothed speeds on a grid of `STEP_S` from the first time on."""
    grid = np.arange(time_s[0], time_s[-1], STEP_S)
    on_grid = np.column_stack([np.interp(grid, time_s, axis) for axis in places.T])
    return np.linalg.norm(gaussian_filter1d(on_grid, _SMOOTH_S / STEP_S, axis=0, order=1), axis=1)


def settled_offset(
    names: tuple[str, str], possible: list[tuple[float, float]], misfit: Callable[[float], float]
) -> tuple[float, float]:
    """The one lag among the possible ones; where several are, that with which the nominal arm meets the points.

    Raises RecordingError where none is, or several are.
    """
    joints, points = names
    if not possible:
        raise RecordingError(
            f"{points}: its motion is not that of {joints}: at no offset of the clocks do they move at the same times; "
            "give recordings of one run, and if the joints turn by a few degrees alone tell their unit, --map "
            "'PREFIX*=q*_deg'"
        )
    if len(possible) == 1:
        return possible[0]
    (least_mm, best), (next_mm, _), *_ = sorted((misfit(each[0]), each) for each in possible)
    if next_mm > 5.0 * least_mm:
        return best
    several = " or ".join(f"{offset:.3f} s" for offset, _ in possible[:3])
    raise RecordingError(
        f"{points}: the offset of its clock to that of {joints} is ambiguous: {several} fit alike, as the motions "
        "repeat; record both with one clock, or begin with a motion that comes once"
    )


def offset_of_single_points(names: tuple[str, str], starts_s: Array, ends_s: Array, point_s: Array) -> float:
    """Offset of the clock of points that were taken one by one, with which most fall into stops; 0 if that does.

    Tried is each with which a point falls into the middle of a stop. Raises RecordingError where lags apart from each
    other do alike.
    """
    joints, points = names
    offsets = np.append(0.0, np.sort(np.subtract.outer(point_s, 0.5 * (starts_s + ends_s)), axis=None))
    at = point_s - offsets[:, None]
    held = np.sum(np.searchsorted(starts_s, at) > np.searchsorted(ends_s, at), axis=1)
    if held.max() < _ENOUGH * len(point_s):
        raise RecordingError(
            f"{points}: of its {len(point_s)} points at most {held.max()} were taken while {joints} stands, at any "
            "offset of the clocks; give recordings of one run"
        )
    best = offsets[held == held.max()]
    if best[0] != 0.0 and np.ptp(best) > max(_ONE_LAG_S, 2.0 * float(np.min(ends_s - starts_s))):
        raise RecordingError(
            f"{points}: the offset of its clock to that of {joints} is ambiguous, anything from {best[0]:.2f} to "
            f"{best[-1]:.2f} s puts its points into stops; record both with one clock"
        )
    return float(np.median(best)) if best[0] != 0.0 else 0.0
