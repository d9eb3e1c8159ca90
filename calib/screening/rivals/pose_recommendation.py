"""Which poses to measure next to tell two causes apart: what each predicts there, refitted with all it could absorb."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.screening.candidates import MIN_RIVAL_OVERLAP, Candidate, Screening
from calib.screening.rivals.further_poses import TRIED, further_poses
from calib.screening.rivals.predictions import Rival
from calib.screening.rivals.split import Split, split


@dataclass(frozen=True)
class DiscriminatingPose:
    """A joint vector, and how far apart the causes put the tool there: the least difference of any two.

    What a refit at this pose absorbs is no part of it.
    """

    q: Array  # (n,) rad or mm, as it is commanded
    separation_mm: float


def discriminating_poses(
    calibration: Calibration, causes: Sequence[Candidate], *, count: int = 5, tried: int = TRIED
) -> tuple[DiscriminatingPose, ...]:
    """Poses that together tell causes beyond a calibration's model apart, as `split` chooses them.

    They can be measured, as far as the cell is known, under conditions that the measured ones had. () for
    fewer than two causes that show at all.

    Raises FitError where no degree of freedom is left.
    """
    candidates = further_poses(calibration, tried=tried)
    found = split(calibration, [Rival.of(cause) for cause in causes], candidates, count, most_shots=1)
    return () if found is None else poses_of(found, calibration)


def poses_of(found: Split, calibration: Calibration) -> tuple[DiscriminatingPose, ...]:
    """The poses of a split as they are commanded, those that differ most first."""
    commanded = calibration.dataset.robot.commands_of(found.poses.q)
    order = np.argsort(-found.separation_mm, kind="stable")
    return tuple(DiscriminatingPose(commanded[i], float(found.separation_mm[i])) for i in order)


def nearest_rival(screening: Screening, name: str) -> Candidate | None:
    """The candidate to tell this one from: the best that could make most of what it explains, else the best of all."""
    ranked = screening.candidates
    chosen = next((c for c in ranked if c.name == name), None)
    if chosen is None or not chosen.members:
        return None
    others = [c for c in ranked if c.name != name and c.members]
    likely = [c for c in others if chosen.overlaps.get(c.name, 0.0) > MIN_RIVAL_OVERLAP]
    return next(iter((*likely, *others)), None)
