"""Standing phases: the spans of a recording in which no joint moves, by a threshold learned from the recording.

The range of each joint in a sliding window is small where the arm stands (noise, quantisation) and large where it
moves; the logarithms of both form two groups, between which Otsu's threshold lies. Source: N. Otsu, "A threshold
selection method from gray-level histograms", IEEE Trans. SMC 9 (1979). A small move between two stops is a peak of the
speed within such a span, a creep before a stop is none: the speed only falls there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d, uniform_filter1d
from scipy.signal import find_peaks

from calib.array_types import Array, BoolArray
from calib.extras.logs.series import RecordingError
from calib.statistics import mad_sigmas

LEAST_S = 0.5  # that the arm stands in a phase
LEAST_SAMPLES = 4
_WINDOW_S = 0.2
_FLOOR = 1e-4  # of a joint's whole range, below which a motion is none
_MOST_STILL = 0.01  # of a joint's whole range in a window, above which nothing stands
_MOVES = 20.0  # ranges in a window that a joint's whole range has at least, where it moves
_APART = 5.0  # ratio of the ranges in motion and at rest
_EDGE_SIGMAS = 4.0  # from where a phase stands, within which its ends have to be
_CALM_SIGMAS = 3.0  # by which smoothed joints may wander in one stop
_CALM_STEPS = 1.5  # the same of a rounded log, in units of its last digit
_REACH_S = 0.35
_MOVED = 0.7  # ways in that time, in units of these, by which the fastest of a move stands out of its stops
_MOVED_USUAL = 4.0  # the same in units of those that are usual at rest
_MOST_CREEP = 8.0  # way in that time of a stop that never settles
_LEAST_RANGE = 1e-6  # of a joint's whole range, its noise at least
_STEP_SIGMA = 0.29  # of a rounded number, standard deviation in units of its last digit
_GAP = 20.0  # time steps without a sample that end a phase


@dataclass(frozen=True)
class Standstill:
    """Standing phases of a recording, as slices of its rows."""

    phases: tuple[slice, ...]
    brief: int  # spans that were too short


def standstill_of(source: str, time_s: Array, values: Array) -> Standstill:
    """Standing phases of joints by time.

    Args:
        source: names the recording in errors.
        time_s: (N,) ascending.
        values: (N, n) joint values in any unit.

    Raises:
        RecordingError: the joints never move, or never stand.
    """
    whole, seconds = np.ptp(values, axis=0), f"{time_s[-1] - time_s[0]:.4g} s"
    step_s = float(np.median(np.diff(time_s)))
    width = max(3, round(_WINDOW_S / step_s) | 1)
    ranges = _ranges(values, width)
    moving = (whole > 0.0) & (whole > _MOVES * np.quantile(ranges, 0.05, axis=0))
    if not moving.any():
        raise RecordingError(f"{source}: no joint moves in these {seconds}; record stops at poses")
    share = np.maximum((ranges[:, moving] / whole[moving]).max(axis=1), _FLOOR)
    threshold = _otsu(np.log10(share))
    threshold = threshold if threshold <= _MOST_STILL else _MOST_STILL / 3.0
    still = share <= threshold
    found_none = RecordingError(
        f"{source}: the arm does not stand still: no phase of {LEAST_S:g} s in which the joints rest was found in "
        f"{seconds}; let the arm stop at each pose while it is measured"
    )
    if still.all() or not still.any() or np.median(share[~still]) < _APART * np.median(share[still]):
        raise found_none
    spans = _spans(still, time_s, _GAP * step_s)
    steps = np.abs(np.diff(values, axis=0))
    digit = np.min(np.where(steps > 0.0, steps, np.inf), axis=0)
    digit[np.isinf(digit)] = 0.0
    jitter = _noise(np.diff(values, axis=0), spans) / np.sqrt(2.0)  # whatever places a span holds
    calm = np.maximum(_FLOOR * whole, np.maximum(_CALM_SIGMAS * jitter, _CALM_STEPS * digit))
    reach = max(2, round(_REACH_S / step_s))
    parts = _parted(values, spans, calm, width, reach)
    least = np.maximum(_LEAST_RANGE * np.maximum(whole, 1e-300), _STEP_SIGMA * digit)
    calmest = [_calmest(values, part, np.maximum(jitter, least)) for part in parts]
    noise = np.maximum(_noise(values, calmest), least)
    parts = _joined(values, parts, noise, calm)
    long = [part for part in parts if time_s[part.stop - 1] - time_s[part.start] >= LEAST_S - 1e-9]
    found = [settled(values, part, noise) for part in long]
    phases = tuple(phase for phase in found if phase is not None)
    if not phases:
        raise found_none
    return Standstill(phases, len(parts) - len(long))


def _ranges(values: Array, width: int) -> Array:
    """Range (N, n) of values (N, n) in a window about each row."""
    return np.asarray(maximum_filter1d(values, width, axis=0) - minimum_filter1d(values, width, axis=0))


def _otsu(values: Array) -> float:
    """Threshold, not as a logarithm, that parts logarithms in two groups with the largest variance between them."""
    counts, edges = np.histogram(values, bins=120)
    centres = 0.5 * (edges[:-1] + edges[1:])
    below = np.cumsum(counts)
    above = below[-1] - below
    sums = np.cumsum(counts * centres)
    between = below * above * (sums / np.maximum(below, 1) - (sums[-1] - sums) / np.maximum(above, 1)) ** 2
    best = np.flatnonzero(between >= between.max() * (1.0 - 1e-9))
    return float(10.0 ** edges[1:][best].mean())


def _spans(still: BoolArray, time_s: Array, gap_s: float) -> list[slice]:
    """Runs of still samples, ended by motion or by a gap in time."""
    rows = np.flatnonzero(still)
    runs = np.split(rows, np.flatnonzero((np.diff(rows) > 1) | (np.diff(time_s[rows]) > gap_s)) + 1)
    return [slice(int(run[0]), int(run[-1]) + 1) for run in runs]


def _noise(values: Array, spans: list[slice]) -> Array:
    """Noise (n,) of the joints at rest: the median over the phases of their standard deviation by the median."""
    each = [mad_sigmas(values[span]) for span in spans if span.stop - span.start >= LEAST_SAMPLES]
    return np.median(each, axis=0) if each else np.zeros(values.shape[1])


def _parted(values: Array, spans: list[slice], calm: Array, width: int, reach: int) -> list[slice]:
    """Stops within spans that small moves part, peaks of the way of smoothed joints in `reach` rows by `calm` (n,).

    Left out are parts in which the arm never calms down.
    """
    smooth = [uniform_filter1d(values[span], width, axis=0) for span in spans]
    ways = [np.max(np.abs(each[reach:] - each[:-reach]) / calm, axis=1, initial=0.0) for each in smooth]
    least = max(_MOVED, _MOVED_USUAL * float(np.quantile(np.concatenate(ways), 0.25)))
    parts = []
    for span, way in zip(spans, ways, strict=True):
        moves = find_peaks(way, prominence=least)[0]
        for a, b in zip([0, *moves], [*moves, len(way)], strict=True):
            if b > a and way[a:b].min() <= _MOST_CREEP:
                ends = (a and a + reach // 2, b + (reach // 2 if b < len(way) else reach))
                parts.append(slice(span.start + int(ends[0]), span.start + int(ends[1])))
    return parts


def _joined(values: Array, spans: list[slice], noise: Array, calm: Array) -> list[slice]:
    """Spans at the same place without a motion between them, as a dropout makes them, as one."""
    out: list[slice] = []
    for span in spans:
        if out:
            before = out[-1]
            middle = np.median(values[before], axis=0)
            between = np.abs(values[before.stop - 1 : span.start + 1] - middle) <= 3.0 * _EDGE_SIGMAS * noise
            if between.all() and np.all(np.abs(np.median(values[span], axis=0) - middle) <= calm):
                out[-1] = slice(before.start, span.stop)
                continue
        out.append(span)
    return out


def settled(values: Array, phase: slice, noise: Array) -> slice | None:
    """Phase without the ends in which a joint still creeps; None for a few samples.

    It stands where it does in its calmest rows.
    """
    if phase.stop - phase.start < LEAST_SAMPLES:
        return None
    inside = values[phase]
    smooth = median_filter(inside, (min(5, len(inside)), 1), mode="nearest")
    own = _calmest(smooth, slice(0, len(smooth)), noise)
    for _ in range(2):
        off = np.max(np.abs(smooth - np.median(inside[own], axis=0)) / noise, axis=1)
        near = np.flatnonzero(off <= max(_EDGE_SIGMAS, float(off[own].max())))
        own = slice(int(near[0]), int(near[-1]) + 1)
    return slice(phase.start + own.start, phase.start + own.stop)


def _calmest(values: Array, span: slice, noise: Array) -> slice:
    """The eighth of a span's rows, a few at least, in which values (N, n) move least in units of the noise."""
    inside = values[span]
    few = min(max(LEAST_SAMPLES, len(inside) // 8), len(inside))
    ranges = np.max(_ranges(inside, few) / noise, axis=1)[few // 2 : len(inside) - (few - 1) // 2]
    first = span.start + int(np.argmin(ranges))
    return slice(first, first + few)


def approach_of(values: Array, first: int, mean: Array, least: Array | float) -> Array:
    """Direction (n,) in which each joint moved last before a row: 1, -1, or 0 where it had not moved.

    values  # (N, n); mean  # (n,) in the phase that begins there; least  # (n,) from which a motion counts
    """
    before = values[:first][::-1]
    away = np.abs(before - mean) > least
    last = np.argmax(away, axis=0) if first else np.zeros(len(mean), dtype=np.int64)
    moved = mean - (before[last, np.arange(len(mean))] if first else mean)
    return np.asarray(np.where(away.any(axis=0), np.sign(moved), 0.0))
