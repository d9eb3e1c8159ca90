"""Offset between the clocks of joints and points, by the motion that both have seen.

The nominal arm's tool and the measured point move at nearly the same speeds, whatever the scanner's frame; the lag at
which the speeds correlate best is the offset, and each travel tells it once more, which gives its sigma.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import gaussian_filter1d

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


@dataclass(frozen=True)
class ClockOffset:
    """Time of the points' clock less that of the joints'."""

    offset_s: float
    sigma_s: float
    correlation: float
    drift: float = 0.0  # s/s, by the travels; 0 where they tell none
    travels: int = 0


def possible_offsets(
    joint_s: Array, path_mm: Array, point_s: Array, points: Array, most_s: float | None = None
) -> list[tuple[float, float]]:
    """Lags, s, at which the speeds of tool and point agree, with their correlations, the best first.

    Args:
        joint_s: (N,) times of the joints.
        path_mm: (N, 3) the nominal tool at these times.
        point_s: (M,) times of the points, by their own clock.
        points: (M, 3) in any unit.
        most_s: largest lag; None for any, as of clocks that count from different days.
    """
    mine, seen = speeds(joint_s, path_mm), speeds(point_s, points)
    n = next_fast_len(len(mine) + len(seen))
    here, there = np.ones(len(mine)), np.ones(len(seen))
    a, b = mine - mine.mean(), seen - seen.mean()

    def correlated(x: Array, y: Array) -> Array:
        return np.asarray(irfft(np.conj(rfft(x, n)) * rfft(y, n), n))

    overlap = correlated(here, there)
    norm = np.sqrt(np.maximum(correlated(a**2, there) * correlated(here, b**2), 1e-300))
    enough = overlap >= max(_LEAST_OVERLAP * min(len(mine), len(seen)), 3.0 / STEP_S)
    quality = np.where(enough, correlated(a, b) / norm, -1.0)
    lags = np.arange(n)
    lags = np.where(lags >= len(seen), lags - n, lags) * STEP_S + (point_s[0] - joint_s[0])
    if most_s is not None:
        quality = np.where(np.abs(lags) <= most_s, quality, -1.0)
    out: list[tuple[float, float]] = []
    for _ in range(_MOST_RIVALS):
        best = int(np.argmax(quality))
        if quality[best] < _LEAST_CORRELATION or (out and quality[best] < _RIVAL * out[0][1]):
            break
        out.append((float(lags[best]), float(quality[best])))
        quality = np.where(np.abs(lags - lags[best]) < _APART_S, -1.0, quality)
    return out


def speeds(time_s: Array, places: Array) -> Array:
    """Smoothed speeds on a grid of `STEP_S` from the first time on."""
    return np.linalg.norm(_velocity(time_s, places), axis=1)


def _velocity(time_s: Array, places: Array) -> Array:
    grid = np.arange(time_s[0], time_s[-1], STEP_S)
    on_grid = np.column_stack([np.interp(grid, time_s, places[:, k]) for k in range(places.shape[1])])
    return np.asarray(gaussian_filter1d(on_grid, _SMOOTH_S / STEP_S, axis=0, order=1))


def refined(
    joint_s: Array, path_mm: Array, point_s: Array, points: Array, rough: tuple[float, float], spans: Array
) -> ClockOffset:
    """Offset with its sigma, from the shift that fits the speeds of each travel best.

    spans  # (K, 2) begin and end of each travel, s, by the joints' clock
    """
    mine, seen = speeds(joint_s, path_mm), speeds(point_s, points)
    at, shift = np.arange(len(seen)) * STEP_S + point_s[0], rough[0]
    found, middles = np.zeros(0), np.zeros(0)
    for _ in range(3):
        shifts, middle = [], []
        for begin, end in spans:
            rows = np.arange(
                max(0, int((begin - joint_s[0]) / STEP_S)), min(len(mine), int((end - joint_s[0]) / STEP_S))
            )
            times = joint_s[0] + rows * STEP_S + shift
            if len(rows) < 10 or times[0] < at[0] or times[-1] > at[-1]:
                continue
            there = np.interp(times, at, seen)
            slope = np.gradient(there, STEP_S)
            (scale, moved), *_ = np.linalg.lstsq(np.column_stack([there, slope]), mine[rows], rcond=None)
            if scale > 0.0 and abs(moved / scale) < 0.5:
                shifts.append(moved / scale)
                middle.append(0.5 * (begin + end))
        if not shifts:
            break
        found, middles = np.array(shifts), np.array(middle)
        shift += float(np.median(found))
    if len(found) < _TRAVELS:
        return ClockOffset(shift, STEP_S, rough[1], 0.0, len(found))
    left = found - np.median(found)
    spread = max(mad_sigma(left), 1e-6)
    near = np.abs(left) <= 4.0 * spread
    drift = 0.0
    if near.sum() >= 6 and np.ptp(middles[near]) > 0.0:
        when = middles[near] - middles[near].mean()
        slope = float(when @ left[near] / (when @ when))
        off = left[near] - left[near].mean() - slope * when
        sigma = float(np.sqrt(off @ off / (len(off) - 2) / (when @ when)))
        drift = slope if abs(slope) > 5.0 * sigma else 0.0
    return ClockOffset(shift, 1.2533 * spread / float(np.sqrt(near.sum())), rough[1], drift, int(near.sum()))


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
    if len(possible) == 1:
        return possible[0]
    misfits = [misfit(offset) for offset, _ in possible]
    order = np.argsort(misfits)
    if np.isfinite(misfits[order[0]]) and misfits[order[1]] > 5.0 * misfits[order[0]]:
        return possible[int(order[0])]
    several = " or ".join(f"{offset:.3f} s" for offset, _ in possible[:3])
    raise RecordingError(
        f"{points}: the offset of its clock to that of {joints} is ambiguous: {several} fit alike, as the motions "
        f"repeat; "
        "record both with one clock, or begin with a motion that comes once"
    )


def offset_of_single_points(names: tuple[str, str], starts_s: Array, ends_s: Array, point_s: Array) -> ClockOffset:
    """Offset of the clock of points that were taken one by one: the range of offsets at which most fall in phases.

    Raises RecordingError where ranges apart from each other do alike.
    """
    joints, points = names
    edges = np.concatenate([np.subtract.outer(point_s, ends_s).ravel(), np.subtract.outer(point_s, starts_s).ravel()])
    steps = np.concatenate([np.ones(edges.size // 2), -np.ones(edges.size // 2)])
    order = np.lexsort((-steps, edges))
    depth = np.cumsum(steps[order])
    best = depth.max(initial=0.0)
    if best < 0.8 * len(point_s):
        raise RecordingError(
            f"{points}: of its {len(point_s)} points at most {best:.0f} were taken while {joints} stands, at any "
            f"offset "
            "of the clocks; give recordings of one run"
        )
    tops = np.flatnonzero(depth >= best - 0.5)
    ranges = [(float(edges[order[k]]), float(edges[order[k + 1]])) for k in tops if k + 1 < len(edges)]
    low, high = ranges[0][0], ranges[-1][1]
    around = next(((a, b) for a, b in ranges if a <= 0.0 <= b), None)
    if around is not None:  # one clock explains it
        return ClockOffset(0.0, 0.0, 1.0)
    shortest = float(np.min(ends_s - starts_s))
    if high - low > max(2.0 * shortest, 2.0):
        raise RecordingError(
            f"{points}: the offset of its clock to that of {joints} is ambiguous, anything from {low:.2f} to "
            f"{high:.2f} s "
            "puts its points into phases; record both with one clock"
        )
    return ClockOffset(0.5 * (low + high), (high - low) / float(np.sqrt(12.0)), 1.0)
