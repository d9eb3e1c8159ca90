"""Uncertainty of the tool's attitude by a fit, which decides whether a correction can include the attitude.

The tool's small turn about the base's axes follows from the fitted parameters, and its covariance from theirs.
Parameters behind the last joint's axis that no measured point determines count with their tolerance. A turn of the base
common to all postures is no error of a target, as the instrument's place is unknown; where full poses were fitted, one
turn of the tool common to all is none either, since the jig's attitude on the tool was fitted with them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Poses
from calib.dataset.trained_range import TrainedRange
from calib.fitting.model import Model

_POSTURES, _SPAN_RAD, _SPAN_MM = 64, 1.0, 100.0  # postures around the targets, over which a turn is common


@dataclass(frozen=True)
class FitKnowledge:
    """What a fit knows about its parameters: covariance, fixed parameters, orientations, and trained range."""

    covariance: Array  # (P, P) of the model's free parameters
    fixed: frozenset[str] = frozenset()  # fixed by the user; others are fixed because no point determines them
    full_poses: bool = False  # whether orientations were measured and fitted
    trained: TrainedRange | None = None

    def attitude_sigma_rad(self, model: Model, x: Array, poses: Poses) -> Array:
        """Standard deviation (N,), rad, of the calibrated tool's attitude (3D turn) at each of N poses."""
        freed = replace(model, fixed=model.fixed & self.fixed)
        values = dict(zip((p.name for p in model.parameters), x.tolist(), strict=True))
        fitted = np.array([p.name in values for p in freed.parameters], dtype=bool)
        covariance = np.diag(freed.scales**2)
        covariance[np.ix_(fitted, fitted)] = self.covariance
        at = np.array([values.get(p.name, 0.0) for p in freed.parameters])
        common, around = self._common(freed, at, poses), self._turns(freed, at, poses)
        turn = around[0] - around[1] @ common
        variance = np.einsum("nip,pq,niq->n", turn, covariance, turn)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def _common(self, model: Model, x: Array, poses: Poses) -> Array:
        """Derivative (3 or 6, P), by the parameters, of the turn of base (and tool) that nearby postures share."""
        rng = np.random.default_rng(0)
        rows = np.resize(np.arange(len(poses)), _POSTURES)
        span = np.where(model.robot.is_revolute, _SPAN_RAD, _SPAN_MM)
        q = poses.q[rows] + span * rng.uniform(-1.0, 1.0, (_POSTURES, model.robot.n_joints))
        turn, columns = self._turns(model, x, replace(poses.select(rows), q=q))
        stacked = columns.reshape(-1, columns.shape[-1])
        return np.asarray(np.linalg.pinv(stacked, rcond=1e-9) @ turn.reshape(len(stacked), -1))

    def _turns(self, model: Model, x: Array, poses: Poses) -> tuple[Array, Array]:
        """Derivatives of the tool's attitude by the parameters (N, 3, P) and by turns of base and tool at all poses."""
        _, attitude, by_x = model.linearise_pose(x, poses)
        of_base = np.broadcast_to(np.eye(3), attitude.shape)
        columns = np.concatenate([of_base, attitude], axis=2) if self.full_poses else of_base
        return by_x[:, 3:], columns
