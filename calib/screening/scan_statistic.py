"""Scan statistic of the residual tests: correlation of the residual with smooth bumps over each input.

Where the residual has a systematic pattern, the largest response is larger than that of noise.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from calib.array_types import Array, BoolArray
from calib.calibration.pose_errors import inputs_at
from calib.dataset.input_names import PLACES, joint_input
from calib.screening.projected_residual import ProjectedResidual, joint_directions
from calib.statistics import rms

_WIDTHS = (0.04, 0.12, 0.35)  # of the bumps, in shares of an input's range
_CENTRES = 25


LENGTH = "length"


@dataclass(frozen=True)
class Channel:
    """Component of the residual that is tested: along an axis of the scanner's frame, or a joint's apparent motion."""

    joint: int | None = None  # from 0; None for an axis
    axis: str = ""  # "x", "y" or "z", or that along measured lengths; "" for a joint

    @property
    def name(self) -> str:
        """Name of the channel: "joint 3" or "x"."""
        return self.axis if self.joint is None else f"joint {self.joint + 1}"


@dataclass(frozen=True)
class ScanStatistic:
    """Scan statistic: responses of a residual to smooth bumps over each input, by component of the residual."""

    of_pose: csr_matrix  # (N, M)
    kept: Array  # (R, 1) 0 at outliers
    directions: dict[Channel, Array]  # (M, C) of a channel at each point
    bumps: dict[str, list[Array]]  # by input, for each width (C, N)
    channels_of: dict[str, list[Channel]]  # by input

    @classmethod
    def at(cls, projected: ProjectedResidual, outlier: BoolArray) -> ScanStatistic:
        """Statistic for the residual of a fit, without the outlying points (M,)."""
        directions: dict[Channel, Array] = {}
        axes = "xyz" if projected.coordinates == len("xyz") else (LENGTH,)
        for axis, name in zip(np.eye(len(axes)), axes, strict=True):
            directions[Channel(axis=name)] = np.broadcast_to(axis, (len(outlier), len(axes)))
        for j, direction in enumerate(joint_directions(projected)):
            size = max(rms(direction), 1e-300)
            directions[Channel(joint=j)] = direction / size
        inputs = inputs_of(projected)
        return cls(
            sum_by_pose(projected),
            np.where(np.repeat(outlier, projected.coordinates), 0.0, 1.0)[:, None],
            directions,
            {name: _bumps(values) for name, values in inputs.items()},
            {name: _relevant(name, directions) for name in inputs},
        )

    def scores(self, values: Array) -> dict[str, Array]:
        """Responses (S, D) by input, for S channels times bump widths, of D residuals (R, D) scaled to length 1."""
        values = values * self.kept
        values /= np.maximum(np.linalg.norm(values, axis=0), 1e-300)
        rows = values.reshape(self.of_pose.shape[1], -1, values.shape[1])
        seen = {name: self.of_pose @ np.einsum("mi,mid->md", d, rows) for name, d in self.directions.items()}
        return {
            name: np.stack([_squares(bump @ seen[c]) for c in channels for bump in self.bumps[name]])
            for name, channels in self.channels_of.items()
        }


def _bumps(values: Array) -> list[Array]:
    """Gaussian bumps over an input's range, for each width as few rows (C, N) with nearly the same Gram matrix.

    Wide bumps are much alike, so that a few rows do; what is dropped adds less than 1e-12 to a sum of squares.
    """
    low, high = float(values.min()), float(values.max())
    u = (values - low) / (high - low)
    levels = np.unique(u)
    centres = levels if len(levels) <= _CENTRES else np.linspace(0.0, 1.0, _CENTRES)
    out = []
    for width in _WIDTHS if len(levels) > 4 else (1e-3,):
        bump = np.exp(-0.5 * ((u[:, None] - centres) / width) ** 2)
        bump = bump[:, bump.sum(axis=0) > 0.3]
        left, s, _ = np.linalg.svd(bump / np.linalg.norm(bump, axis=0), full_matrices=False)
        shown = s > 1e-6 * s[0]
        out.append(s[shown, None] * left[:, shown].T)
    return out


def _squares(values: Array) -> Array:
    """Sum of squares (D,) of each column of an array (C, D)."""
    return np.einsum("cd,cd->d", values, values)


def _relevant(name: str, channels: Iterable[Channel]) -> list[Channel]:
    """Components of the residual tested over an input: the axes, and the motions of the joints concerned."""
    of_joint = joint_input(name)
    if of_joint is not None:
        return [channel for channel in channels if channel.joint in (None, of_joint[1])]
    return [channel for channel in channels if channel.joint is None or name not in PLACES]


def inputs_of(projected: ProjectedResidual) -> dict[str, Array]:
    """Values (N,) at the used poses of every input that a residual may depend on, by name."""
    poses, _ = projected.residuals.observed.used_poses
    return inputs_at(projected.residuals.model.robot, poses, projected.state)


def sum_by_pose(projected: ProjectedResidual) -> csr_matrix:
    """Sparse matrix (N, M) that sums values at points over the points of each pose."""
    poses, row = projected.residuals.observed.used_poses
    points = np.arange(len(row))
    return csr_matrix((np.ones(len(row)), (row, points)), shape=(len(poses), len(row)))
