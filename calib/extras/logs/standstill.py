"""Standing phases: the spans of a recording in which no joint moves, by a threshold learned from the recording.

The range of each joint in a sliding window is small where the arm stands (noise, quantisation) and large where it
moves; the logarithms of both form two groups, between which Otsu's threshold lies. Source: N. Otsu, "A threshold
selection method from gray-level histograms", IEEE Trans. SMC 9 (1979).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d, uniform_filter1d

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
_EDGE_SIGMAS = 4.0  # from a phase's median, within which its ends have to be
_CALM_SIGMAS = 3.0  # by which smoothed joints may wander in one stop
_CALM_STEPS = 1.5  # the same of a rounded log, in units of its last digit
_MOST_TRIED = 1000  # places of a phase at which a stop may begin
_LEAST_RANGE = 1e-6  # of a joint's whole range, its noise at least
_STEP_SIGMA = 0.29  # of a rounded number, standard deviation in units of its last digit
_GAP = 20.0  # time steps without a sample that end a phase


@dataclass(frozen=True)
class Phase:
    """A span in which the arm stands: rows first to last of the recording, both included."""

    first: int
    last: int


@dataclass(frozen=True)
class Standstill:
    """Standing phases of a recording, with the largest speed that counts as standing."""

    phases: tuple[Phase, ...]
    threshold: float  # range of a joint in the window, as a share of its whole range
    window_s: float
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
    whole = np.ptp(values, axis=0)
    step_s = float(np.median(np.diff(time_s)))
    width = max(3, round(_WINDOW_S / step_s) | 1)
    ranges = maximum_filter1d(values, width, axis=0) - minimum_filter1d(values, width, axis=0)
    moving = (whole > 0.0) & (whole > _MOVES * np.quantile(ranges, 0.05, axis=0))
    if not moving.any():
        raise RecordingError(f"{source}: no joint moves in these {time_s[-1] - time_s[0]:.4g} s; record stops at poses")
    share = np.maximum((ranges[:, moving] / whole[moving]).max(axis=1), _FLOOR)
    threshold = _otsu(np.log10(share))
    rest, motion = share[share <= threshold], share[share > threshold]
    found_none = (
        f"{source}: the arm does not stand still: no phase of {LEAST_S:g} s in which the joints rest was found in "
        f"{time_s[-1] - time_s[0]:.4g} s; let the arm stop at each pose while it is measured"
    )
    if not len(rest) or not len(motion) or threshold > _MOST_STILL:
        threshold = _MOST_STILL / 3.0
        rest, motion = share[share <= threshold], share[share > threshold]
        if not len(rest) or not len(motion):
            raise RecordingError(found_none)
    if float(np.median(motion)) < _APART * float(np.median(rest)):
        raise RecordingError(found_none)
    spans = _spans(share <= threshold, time_s, _GAP * step_s)
    least_step = _least_step(values)
    jitter = _noise(np.diff(values, axis=0), spans) / np.sqrt(2.0)  # whatever places a span holds
    calm = np.maximum(_FLOOR * whole, np.maximum(_CALM_SIGMAS * jitter, _CALM_STEPS * least_step))
    parts = [part for span in spans for part in _parted(values, span, calm, width, step_s)]
    noise = np.maximum(_noise(values, parts), _LEAST_RANGE * np.maximum(whole, 1e-300))
    noise = np.maximum(noise, _STEP_SIGMA * least_step)
    found = [trimmed(values, phase, noise) for phase in _joined(values, parts, noise, calm)]
    long = [each for each in found if each is not None and _is_long(each, time_s)]
    if not long:
        raise RecordingError(found_none)
    return Standstill(tuple(long), threshold, width * step_s, len(found) - len(long))


def _otsu(values: Array) -> float:
    """Threshold, not as a logarithm, that parts logarithms in two groups with the largest variance between them."""
    counts, edges = np.histogram(values, bins=120)
    centres = 0.5 * (edges[:-1] + edges[1:])
    below = np.cumsum(counts)
    above = below[-1] - below
    sums = np.cumsum(counts * centres)
    mean_below = sums / np.maximum(below, 1)
    mean_above = (sums[-1] - sums) / np.maximum(above, 1)
    between = below * above * (mean_below - mean_above) ** 2
    best = np.flatnonzero(between >= between.max() * (1.0 - 1e-9))
    return float(10.0 ** edges[1:][best].mean())


def _spans(still: BoolArray, time_s: Array, gap_s: float) -> list[Phase]:
    """Runs of still samples, ended by motion or by a gap in time."""
    rows = np.flatnonzero(still)
    if not len(rows):
        return []
    ends = np.flatnonzero((np.diff(rows) > 1) | (np.diff(time_s[rows]) > gap_s))
    starts = [0, *(ends + 1)]
    return [Phase(int(rows[a]), int(rows[b])) for a, b in zip(starts, [*ends, len(rows) - 1], strict=True)]


def _noise(values: Array, spans: list[Phase]) -> Array:
    """Noise (n,) of the joints at rest: the median over the phases of their standard deviation by the median."""
    each = [mad_sigmas(values[span.first : span.last + 1]) for span in spans if span.last - span.first >= LEAST_SAMPLES]
    return np.median(each, axis=0) if each else np.zeros(values.shape[1])


def _least_step(values: Array) -> Array:
    """Least change (n,) of each joint between two samples: the last digit of a rounded log, else next to nothing."""
    steps = np.abs(np.diff(values, axis=0))
    least = np.min(np.where(steps > 0.0, steps, np.inf), axis=0)
    return np.where(np.isfinite(least), least, 0.0)


def _joined(values: Array, spans: list[Phase], noise: Array, calm: Array) -> list[Phase]:
    """Spans at the same place without a motion between them, as a dropout makes them, as one."""
    out: list[Phase] = []
    for span in spans:
        if out:
            before = out[-1]
            between = values[before.last : span.first + 1]
            middle = np.median(values[before.first : before.last + 1], axis=0)
            off = np.median(values[span.first : span.last + 1], axis=0) - middle
            if np.all(np.abs(between - middle) <= 3.0 * _EDGE_SIGMAS * noise) and np.all(np.abs(off) <= calm):
                out[-1] = Phase(before.first, span.last)
                continue
        out.append(span)
    return out


def _parted(values: Array, phase: Phase, calm: Array, width: int, step_s: float) -> list[Phase]:
    """Stops within a phase that small moves part: where smoothed joints stay within `calm` (n,); itself for one.

    The longest such span is taken first, then those before and behind it.
    """
    inside = uniform_filter1d(values[phase.first : phase.last + 1], width, axis=0)
    stride = max(1, width // 4, len(inside) // _MOST_TRIED)
    places = inside[::stride]
    least = max(2, round(LEAST_S / step_s / stride))

    def stops(begin: int, end: int) -> list[tuple[int, int]]:
        best = (begin, begin)
        for first in range(begin, end - least):
            rest = places[first:end]
            away = np.maximum.accumulate(rest) - np.minimum.accumulate(rest) > calm
            last = end if not away.any() else first + int(np.argmax(away.any(axis=1)))
            best = max(best, (first, last), key=lambda span: span[1] - span[0])
            if last == end:
                break
        if best[1] - best[0] < least:
            return []
        return [*stops(begin, best[0]), best, *stops(best[1], end)]

    found = stops(0, len(places))
    if len(found) < 2:
        return [phase]
    return [Phase(phase.first + a * stride, min(phase.first + b * stride - 1, phase.last)) for a, b in found]


def trimmed(values: Array, phase: Phase, noise: Array) -> Phase | None:
    """Phase without the ends in which a joint still creeps or settles; None where little is left."""
    inside = values[phase.first : phase.last + 1]
    if len(inside) < LEAST_SAMPLES:
        return None
    quarter = len(inside) // 4
    middle = np.median(inside[quarter : len(inside) - quarter], axis=0)
    off = np.max(np.abs(median_filter(inside, (min(5, len(inside)), 1), mode="nearest") - middle) / noise, axis=1)
    calm = np.flatnonzero(off <= _EDGE_SIGMAS)
    return None if len(calm) < LEAST_SAMPLES else Phase(phase.first + int(calm[0]), phase.first + int(calm[-1]))


def _is_long(phase: Phase, time_s: Array) -> bool:
    return phase.last - phase.first + 1 >= LEAST_SAMPLES and time_s[phase.last] - time_s[phase.first] >= LEAST_S - 1e-9


def approach_of(values: Array, phase: Phase, mean: Array, least: Array) -> Array:
    """Direction (n,) in which each joint moved last before a phase: 1, -1, or 0 where it had not moved.

    values  # (N, n); mean  # (n,) in the phase; least  # (n,) from which a motion counts
    """
    before = values[: phase.first][::-1]
    out = np.zeros(values.shape[1])
    for k in range(values.shape[1]):
        away = np.flatnonzero(np.abs(before[:, k] - mean[k]) > least[k])
        if len(away):
            out[k] = np.sign(mean[k] - before[away[0], k])
    return out
