"""The next poses that settle which of several rivals is true: which, measured how often, and how surely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.blas_threads import one_blas_thread
from calib.calibration.result import Calibration
from calib.dataset.dataset import Poses
from calib.screening.rivals.pose_choice import choose_poses, grown
from calib.screening.rivals.predictions import Predictions, Rival, predict
from calib.screening.rivals.settling import (
    expected_gaps,
    inseparable,
    separations_mm,
    settled_probability,
)

# Measurements of a pose that are asked for at the most: where most poses were measured once, a fit counts the mean of
# several as one (`calib.dataset.repeats`), so that more would promise what a diagnosis does not take.
MOST_SHOTS = 1
ENOUGH = 0.9  # probability of being settled, from which no more is asked for
MOST_POSES = 20  # that are looked at for how many would be enough


@dataclass(frozen=True)
class Split:
    """Poses to measure next, by which rivals are told apart."""

    rivals: tuple[str, ...]
    poses: Poses  # (K) with their conditions, in the order chosen
    shots: int  # measurements of each pose, of which the mean counts
    separation_mm: Array  # (K,) of the two rivals that are least apart there, beyond what a refit absorbs
    gap: float  # the least log evidence that a true rival would have over another
    settles: float  # probability that the true rival then leads by the margin that a diagnosis asks for
    curve: tuple[float, ...]  # the same after none, the first, the first two, ... of the poses
    twins: tuple[tuple[str, str], ...]  # pairs that no poses of this kind tell apart
    enough: int | None  # poses of this kind that would do (`ENOUGH`); None where no number is known that would


@one_blas_thread()
def split(
    calibration: Calibration,
    rivals: Sequence[Rival],
    candidates: Poses,
    count: int,
    *,
    most_shots: int = MOST_SHOTS,
) -> Split | None:
    """The poses among candidates by which rivals are told apart; None for fewer than two rivals, or no candidates.

    Args:
        calibration: a fit; rivals in its model are taken out of it.
        rivals: of which one is true, each with members.
        candidates: poses that can be measured, with their conditions.
        count: how many poses.
        most_shots: of one pose; fewer are asked for where they are enough.

    Raises FitError where no degree of freedom is left.
    """
    rivals = [rival for rival in rivals if rival.members]
    if len(rivals) < 2 or not len(candidates):
        return None
    predictions = predict(calibration, rivals, candidates)
    chosen = choose(predictions, candidates, count, most_shots=most_shots)
    return judged(predictions, candidates, chosen, most_shots=most_shots)


def choose(predictions: Predictions, candidates: Poses, count: int, *, most_shots: int = MOST_SHOTS) -> IndexArray:
    """The candidates (count,) by which rivals are told apart, the most telling first."""
    apart = _told_apart(inseparable(predictions))
    chosen = choose_poses(predictions, count, places=candidates.q, apart=apart)
    shots = _shots(predictions, chosen, most_shots)
    if shots == 1:
        return chosen
    return choose_poses(predictions.with_shots(shots), count, places=candidates.q, apart=apart)


def _shots(predictions: Predictions, chosen: IndexArray, most: int) -> int:
    """How often to measure each of the chosen: once, or twice as often until it is enough, `most` times at the most."""
    shots = 1
    while shots < most and settled_probability(predictions.with_shots(shots), chosen) < ENOUGH:
        shots = min(2 * shots, most)
    return shots


def judged(
    predictions: Predictions,
    candidates: Poses,
    chosen: IndexArray,
    *,
    most_shots: int = MOST_SHOTS,
    look_on: bool = False,
) -> Split:
    """What chosen candidates do for telling rivals apart, each measured as often as is needed.

    Args:
        predictions: at the candidates.
        candidates: to choose from.
        chosen: (K,) of these.
        most_shots: of one pose.
        look_on: whether to find how many more poses would be enough, where these are not.
    """
    shots = _shots(predictions, chosen, most_shots)
    shown = predictions.with_shots(shots)
    together = inseparable(predictions)
    apart = _told_apart(together)
    names = [rival.name for rival in predictions.rivals]
    curve = tuple(settled_probability(shown, chosen[:k]) for k in range(len(chosen) + 1))
    gaps = expected_gaps(shown, chosen)
    return Split(
        rivals=tuple(names),
        poses=candidates.select(chosen),
        shots=shots,
        separation_mm=separations_mm(shown, chosen, apart),
        gap=float(gaps[~np.eye(len(names), dtype=bool)].min()),
        settles=curve[-1],
        curve=curve,
        twins=tuple((names[i], names[j]) for i, j in combinations(range(len(names)), 2) if together[i, j]),
        enough=_enough(shown, chosen, curve, candidates.q, apart, look_on and not together.any()),
    )


def _told_apart(together: BoolArray) -> BoolArray:
    """(I, I) the pairs that poses may tell apart; all where they may none."""
    others = ~np.eye(len(together), dtype=bool)
    return others & ~together if (others & ~together).any() else others


def _enough(
    predictions: Predictions,
    chosen: IndexArray,
    curve: Sequence[float],
    places: Array,
    apart: BoolArray,
    look_on: bool,
) -> int | None:
    """How many poses settle the set with probability `ENOUGH`, those that are chosen first."""
    within = next((k for k, probability in enumerate(curve) if probability >= ENOUGH), None)
    if within is not None or not look_on:
        return within
    while len(chosen) < MOST_POSES:
        more = grown(chosen.tolist(), predictions, len(chosen) + 1, places=places, apart=apart)
        if len(more) == len(chosen):
            return None
        chosen = more
        if settled_probability(predictions, chosen) >= ENOUGH:
            return len(chosen)
    return None
