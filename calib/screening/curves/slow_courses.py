"""What a step in time displaces may have moved slowly instead: crept, settled, swayed. No effect is named for that."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib.array_types import Array
from calib.effects.catalogue.order_steps import Step
from calib.screening.candidates import Candidate
from calib.screening.evidence import evidence_of
from calib.screening.member_columns import displacement_columns
from calib.screening.projected_residual import ProjectedResidual

_SETTLING = (0.1, 0.2, 0.4, 0.8)  # time constants, of the whole session
_SWAYING = (0.1, 0.2, 0.4, 1.0)  # correlation lengths
_MOST = 100  # moments that a smooth course is spanned by


def slow_course(projected: ProjectedResidual, step: Candidate) -> float:
    """Log evidence that what a step displaces took a slow course: the best of all, which are equally likely.

    An even one, settling with one of four time constants, or any smooth one of four correlation lengths. 0 where the
    candidate is no step.
    """
    members = [member for member in step.members if isinstance(member, Step)]
    if not members:
        return 0.0
    columns = displacement_columns(projected, members)  # (M, 3, W)
    row = projected.residuals.observed.used_poses[1]
    values = []
    for course in _courses(_moments(projected)):
        moved = course[row][:, None, :, None] * columns[:, :, None, :]
        visible = projected.visible(moved.reshape(3 * len(row), -1))
        values.append(evidence_of(-projected.residual, visible, projected.freedom))
    return max(values) - float(np.log(len(values)))


def _moments(projected: ProjectedResidual) -> Array:
    """(N,) when each used pose was measured, from 0 to 1; by its place in the order where times are not known."""
    poses = projected.residuals.observed.used_poses[0]
    when = poses.order.astype(float) if poses.time_s is None else poses.time_s
    return np.asarray((when - when.min()) / max(float(np.ptp(when)), 1e-300))


def _courses(moment: Array) -> Iterator[Array]:
    """Each (N, L): its functions of time, of which white coefficients of unit variance make the course."""
    yield moment[:, None]
    for settling in _SETTLING:
        yield (1.0 - np.exp(-moment / settling))[:, None]
    anchors = np.sort(moment)[np.unique(np.linspace(0, len(moment) - 1, min(len(moment), _MOST)).astype(int))]
    for length in _SWAYING:
        values, vectors = np.linalg.eigh(_alike(anchors, anchors, length))
        kept = values > 1e-3 * values[-1]
        yield _alike(moment, anchors, length) @ (vectors[:, kept] / np.sqrt(values[kept]))


def _alike(left: Array, right: Array, length: float) -> Array:
    return np.asarray(np.exp(-0.5 * ((left[:, None] - right[None]) / length) ** 2))
