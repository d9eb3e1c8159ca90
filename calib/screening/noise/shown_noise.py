"""Whether the noise has another shape than was declared: by repeats, else by what a search left over in the end.

A slow wander of the instrument is held against every effect that was added: it is a rival of drifts, and an effect that
does not lead it clearly is not to be claimed in its place.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import BoolArray
from calib.dataset.dataset import Dataset
from calib.noise_shape import NoiseShape
from calib.screening.noise.find_shape import find_shape
from calib.screening.noise.from_repeats import scatter_of_repeats
from calib.screening.noise.likelihood import LinearResidual
from calib.screening.noise.properties import wander_property
from calib.screening.projected_residual import ProjectedResidual

MIN_LEAD = 3.0  # in log evidence, of an effect over a wander
MIN_RIVAL_GAIN = 3.0  # of a wander, from which it is a rival


@dataclass(frozen=True)
class ShownNoise:
    """The shape of the noise that data show."""

    shape: NoiseShape
    rival: str = ""  # an effect that was added first, which a wander explains as well
    from_repeats: bool = False  # else from what a fit left over; a wander always is


@dataclass(frozen=True)
class AddedEffect:
    """An effect that a search added: by which evidence, to explain what."""

    effect: str
    log_evidence: float
    left: ProjectedResidual


def noise_of_repeats(dataset: Dataset) -> ShownNoise | None:
    """The shape that repeated measurements show, which are believed before any fit; None where they show none."""
    scatter = scatter_of_repeats(dataset)
    if scatter is None:
        return None
    shown = find_shape(scatter, np.zeros(len(scatter.rows), dtype=bool), slow=False)
    return None if shown is None else ShownNoise(shown.shape, from_repeats=True)


def first_unproven(added: Sequence[AddedEffect], outliers: Collection[str]) -> AddedEffect | None:
    """The first effect that does not lead a slow wander of the instrument; None where each does.

    Args:
        added: by a search, one after the other.
        outliers: ids of poses that stand out, which do not count.
    """
    return next((one for one in added if _lead_over_wander(one, outliers) < MIN_LEAD), None)


def noise_of_residual(
    dataset: Dataset, beaten: AddedEffect | None, left: ProjectedResidual, outliers: Collection[str]
) -> ShownNoise | None:
    """The shape that what is left over asks for; None where the noise as it was taken does.

    Where repeated measurements tell the shape, only its course in time is asked for.

    Args:
        dataset: that was fitted, with the noise as it was taken.
        beaten: the effect that does not lead a wander: then what is left without it counts, and the wander is there.
        left: in the end.
        outliers: ids of poses that stand out.
    """
    rest = left if beaten is None else beaten.left
    residual, outlier = LinearResidual.of(rest), _of_poses(rest, outliers)
    wander = None if beaten is None else wander_property(residual.select(np.flatnonzero(~outlier)), NoiseShape())
    shown = find_shape(
        residual,
        outlier,
        points=scatter_of_repeats(dataset) is None,
        start=NoiseShape() if wander is None else wander.shape,
    )
    if shown is None:
        return None
    shape = shown.shape if dataset.noise is None else replace(dataset.noise, wander=shown.shape.wander)
    rival = "" if beaten is None else beaten.effect
    return ShownNoise(shape, rival, from_repeats=dataset.noise is not None)


def _lead_over_wander(added: AddedEffect, outliers: Collection[str]) -> float:
    """Log evidence of the effect over a wander; inf where a wander is worth nothing."""
    kept = np.flatnonzero(~_of_poses(added.left, outliers))
    wander = wander_property(LinearResidual.of(added.left).select(kept), NoiseShape())
    return np.inf if wander is None or wander.gain < MIN_RIVAL_GAIN else added.log_evidence - wander.gain


def _of_poses(left: ProjectedResidual, pose_ids: Collection[str]) -> BoolArray:
    """(M,) the points of these poses."""
    poses, row = left.residuals.observed.used_poses
    return np.asarray(np.isin(np.array(poses.ids), list(pose_ids))[row])
