"""Which poses to measure next: those at which the causes in doubt predict the most different places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.calibrate import calibrate
from calib.calibration.result import Calibration
from calib.fitting.observations import conditions_at
from calib.screening.candidates import MIN_RIVAL_OVERLAP, Candidate, Screening


@dataclass(frozen=True)
class DiscriminatingPose:
    """A joint vector, and how far apart the causes put the tool there: the least difference of any two."""

    q: Array  # (n,) rad or mm, as it is commanded
    separation_mm: float


def discriminating_poses(
    calibration: Calibration, causes: Sequence[Candidate], *, count: int = 5, tried: int = 400
) -> tuple[DiscriminatingPose, ...]:
    """Poses at which causes beyond a calibration's model differ most, far from each other.

    Each cause is fitted by itself, as was asked of the calibration; at `tried` random joint vectors within the range of
    the measured ones, the fitted models predict where the tool is, seen from the scanner. Payload, temperature and the
    like are as at the first pose. () for fewer than two causes that show at all.

    Raises CalibError where the poses are too few to fit a cause.
    """
    doubted = [c for c in causes if c.members]
    if len(doubted) < 2:
        return ()
    rng = np.random.default_rng(0)
    measured = calibration.dataset.poses.q
    q = rng.uniform(measured.min(axis=0), measured.max(axis=0), (tried, measured.shape[1]))
    places = [_places(calibration, candidate, q) for candidate in doubted]
    apart = np.min([np.linalg.norm(a - b, axis=1) for a, b in combinations(places, 2)], axis=0)
    commands_of = calibration.dataset.robot.commands_of
    return tuple(replace(pose, q=commands_of(pose.q)) for pose in _spread(q, apart, count))


def nearest_rival(screening: Screening, name: str) -> Candidate | None:
    """The candidate to tell this one from: the best that could make most of what it explains, else the best of all."""
    ranked = screening.candidates
    chosen = next((c for c in ranked if c.name == name), None)
    if chosen is None or not chosen.members:
        return None
    others = [c for c in ranked if c.name != name and c.members]
    likely = [c for c in others if chosen.overlaps.get(c.name, 0.0) > MIN_RIVAL_OVERLAP]
    return next(iter((*likely, *others)), None)


def _places(calibration: Calibration, candidate: Candidate, q: Array) -> Array:
    """Where a model with one more cause puts the tool (N, 3), in the first setup's scanner frame."""
    fitted = calibrate(
        calibration.dataset,
        calibration.options,
        effects=[*calibration.model.added_effects, *candidate.members],
        prior_sigmas={**calibration.model.prior_sigmas, **candidate.prior_sigmas},
    )
    scanner_T_base = next(iter(fitted.after.scanner_T_base.values()))
    poses = conditions_at(calibration.dataset.poses, q)
    return frames.apply(scanner_T_base, fitted.model.predict(fitted.fit.x, poses))


def _spread(q: Array, apart: Array, count: int) -> tuple[DiscriminatingPose, ...]:
    """The best poses, each at least a tenth of the joints' range from those before it."""
    span = np.maximum(np.ptp(q, axis=0), 1e-9)
    chosen: list[int] = []
    for i in np.argsort(-apart):
        if all(np.max(np.abs((q[i] - q[j]) / span)) > 0.1 for j in chosen):
            chosen.append(int(i))
        if len(chosen) == count:
            break
    return tuple(DiscriminatingPose(q[i], float(apart[i])) for i in chosen)
