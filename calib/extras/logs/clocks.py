"""Offset between the clocks of joints and points, by the motion that both have seen.

The nominal arm's tool and the measured point move at nearly the same speeds, whatever the scanner's frame; the lag at
which the speeds correlate best is the offset, and each travel tells it once more, which gives its sigma.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import correlate, correlation_lags, find_peaks

from calib.array_types import Array
from calib.extras.logs.series import RecordingError
from calib.statistics import mad_sigma

STEP_S = 0.02
_SMOOTH_S = 0.08
_LEAST_CORRELATION = 0.85
_RIVAL = 0.8  # of the best correlation, from which another lag is possible, too
_APART_S = 0.6  # of two lags that are not one
_LEAST_OVERLAP = 0.5  # of the shorter recording
_MOST_RIVALS = 6
_TRAVELS = 4  # at least, for a sigma
_DRIFTS = 5.0  # its own sigmas, from which a drift is told


@dataclass(frozen=True)
class ClockOffset:
    """Time of the points' clock less that of the joints'."""

    offset_s: float = 0.0
    sigma_s: float = 0.0
    correlation: float = 1.0
    drift: float = 0.0  # s/s, by the travels; 0 where they tell none
    travels: int = 0


def possible_offsets(
    joint_s: Array, path_mm: Array, point_s: Array, points: Array, most_s: float = np.inf
) -> list[tuple[float, float]]:
    """Lags, s, at which the speeds of tool and point agree, with their correlations, the best first.

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
    return [(float(lags[k]), float(quality[k])) for k in best if quality[k] >= _RIVAL * quality[best[0]]]


def speeds(time_s: Array, places: Array) -> Array:
    """Smoothed speeds on a grid of `STEP_S` from the first time on."""
    grid = np.arange(time_s[0], time_s[-1], STEP_S)
    on_grid = np.column_stack([np.interp(grid, time_s, axis) for axis in places.T])
    return np.linalg.norm(gaussian_filter1d(on_grid, _SMOOTH_S / STEP_S, axis=0, order=1), axis=1)


def refined(
    joint_s: Array, path_mm: Array, point_s: Array, points: Array, rough: tuple[float, float], spans: Array
) -> ClockOffset:
    """Offset with its sigma, from the shift that fits the speeds of each travel best.

    spans  # (K, 2) begin and end of each travel, s, by the joints' clock
    """
    mine, seen = speeds(joint_s, path_mm), speeds(point_s, points)
    here, at, shift = np.arange(len(mine)) * STEP_S + joint_s[0], np.arange(len(seen)) * STEP_S + point_s[0], rough[0]
    slopes, found = np.gradient(seen, STEP_S), np.zeros((0, 2))
    travels = [np.flatnonzero((here >= begin) & (here < end)) for begin, end in spans]
    for _ in range(3):
        told = []
        for rows in (rows for rows in travels if len(rows) >= 10):
            times = here[rows] + shift
            if at[0] <= times[0] and times[-1] <= at[-1]:
                there = np.column_stack([np.interp(times, at, seen), np.interp(times, at, slopes)])
                scale, moved = np.linalg.lstsq(there, mine[rows], rcond=None)[0]
                if scale > 0.0 and abs(moved) < 0.5 * scale:
                    told.append((here[rows].mean(), moved / scale))
        if not told:
            break
        found = np.array(told)
        shift += float(np.median(found[:, 1]))
    if len(found) < _TRAVELS:
        return ClockOffset(shift, STEP_S, rough[1], travels=len(found))
    left = found[:, 1] - np.median(found[:, 1])
    spread = max(mad_sigma(left), 1e-6)
    when, near = found[np.abs(left) <= 4.0 * spread].T
    drift = 0.0
    if len(near) >= 6 and np.ptp(when) > 0.0:
        (slope, _), covariance = np.polyfit(when - when.mean(), near, 1, cov=True)
        drift = float(slope) if abs(slope) > _DRIFTS * np.sqrt(covariance[0, 0]) else 0.0
    return ClockOffset(shift, 1.2533 * spread / float(np.sqrt(len(near))), rough[1], drift, len(near))


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
            "give recordings of one run"
        )
    ranked = sorted((misfit(each[0]), each) for each in possible) if len(possible) > 1 else [(0.0, possible[0])]
    if len(ranked) == 1 or (np.isfinite(ranked[0][0]) and ranked[1][0] > 5.0 * ranked[0][0]):
        return ranked[0][1]
    several = " or ".join(f"{offset:.3f} s" for offset, _ in possible[:3])
    raise RecordingError(
        f"{points}: the offset of its clock to that of {joints} is ambiguous: {several} fit alike, as the motions "
        "repeat; record both with one clock, or begin with a motion that comes once"
    )


def offset_of_single_points(names: tuple[str, str], starts_s: Array, ends_s: Array, point_s: Array) -> ClockOffset:
    """Offset of the clock of points that were taken one by one: the range of offsets at which most fall in phases.

    Raises RecordingError where ranges apart from each other do alike.
    """
    joints, points = names
    edges = np.concatenate([np.subtract.outer(point_s, ends_s).ravel(), np.subtract.outer(point_s, starts_s).ravel()])
    steps = np.repeat([1.0, -1.0], edges.size // 2)
    order = np.lexsort((-steps, edges))
    depth = np.cumsum(steps[order])
    best = depth.max(initial=0.0)
    if best < 0.8 * len(point_s):
        raise RecordingError(
            f"{points}: of its {len(point_s)} points at most {best:.0f} were taken while {joints} stands, at any "
            "offset of the clocks; give recordings of one run"
        )
    tops = np.flatnonzero(depth[:-1] >= best - 0.5)
    lows, highs = edges[order[tops]], edges[order[tops + 1]]
    if np.any((lows <= 0.0) & (highs >= 0.0)):  # one clock explains it
        return ClockOffset()
    low, high = float(lows[0]), float(highs[-1])
    if high - low > max(2.0 * float(np.min(ends_s - starts_s)), 2.0):
        raise RecordingError(
            f"{points}: the offset of its clock to that of {joints} is ambiguous, anything from {low:.2f} to "
            f"{high:.2f} s puts its points into phases; record both with one clock"
        )
    return ClockOffset(0.5 * (low + high), (high - low) / float(np.sqrt(12.0)))
