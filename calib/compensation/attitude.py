"""Uncertainty of the tool's attitude and place by a fit; the former decides whether a correction can include it.

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
from calib.fitting.discrepancy import Discrepancy
from calib.fitting.model import Model
from calib.frames import frame_motion
from calib.kinematics.robot import TOOL_POINT

_POSTURES, _SPAN_RAD, _SPAN_MM = 64, 1.0, 100.0  # postures around the targets, over which a turn is common


@dataclass(frozen=True)
class FitKnowledge:
    """What a fit knows about its parameters: covariance, fixed parameters, orientations, and trained range."""

    covariance: Array  # (P, P) of the model's free parameters
    fixed: frozenset[str] = frozenset()  # fixed by the user; others are fixed because no point determines them
    full_poses: bool = False  # whether orientations were measured and fitted
    trained: TrainedRange | None = None
    residual_mm: float = 0.0  # sigma per coordinate that the fit left; 0 where it is not known
    discrepancy: Discrepancy | None = None  # what the model is known to miss

    def position_sigma_mm(self, model: Model, x: Array, poses: Poses) -> Array:
        """Standard deviation (N,) per coordinate, mm, promised for the measured tool point at each of N poses.

        As for a pose that no fit saw: noise, parameters, and what the model misses, which grows beyond the training
        poses. A motion of the base common to all postures is no error, as the instrument's place is unknown.
        """
        common, (moves, columns) = self._common_motion(model, x, poses), self._moves(model, x, poses)
        rows = moves - columns @ common
        variance = np.einsum("nip,pq,niq->n", rows, self.covariance, rows) / 3.0 + self.residual_mm**2
        if self.discrepancy is not None:
            variance = variance + self.discrepancy.variance_mm2(poses.q)
        return np.sqrt(np.maximum(variance, 0.0))

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
        return np.sqrt(np.maximum(variance, 0.0))

    def _common(self, model: Model, x: Array, poses: Poses) -> Array:
        """Derivative (3 or 6, P), by the parameters, of the turn of base (and tool) that nearby postures share."""
        return _shared(*self._turns(model, x, _around(model, poses)))

    def _common_motion(self, model: Model, x: Array, poses: Poses) -> Array:
        """Derivative (6, P), by the parameters, of the base's motion that the trained postures share.

        The instrument's frame was fitted to these; where they are unknown, to postures around the targets.
        """
        around = _around(model, poses)
        if self.trained is not None:
            low, high = np.array(self.trained.low), np.array(self.trained.high)
            share = np.random.default_rng(0).random((_POSTURES, len(low)))
            around = replace(around, q=low + share * (high - low))
        return _shared(*self._moves(model, x, around))

    def _moves(self, model: Model, x: Array, poses: Poses) -> tuple[Array, Array]:
        """Derivatives of the tool point by the parameters (N, 3, P) and by a motion of the base (N, 3, 6)."""
        at_mm, by_x = model.at_tool.linearise(x, poses, TOOL_POINT)
        return by_x, frame_motion(at_mm, np.zeros(3))

    def _turns(self, model: Model, x: Array, poses: Poses) -> tuple[Array, Array]:
        """Derivatives of the tool's attitude by the parameters (N, 3, P) and by turns of base and tool at all poses."""
        _, attitude, by_x = model.linearise_pose(x, poses)
        of_base = np.broadcast_to(np.eye(3), attitude.shape)
        columns = np.concatenate([of_base, attitude], axis=2) if self.full_poses else of_base
        return by_x[:, 3:], columns


def _around(model: Model, poses: Poses) -> Poses:
    """Postures around those of some poses."""
    rng = np.random.default_rng(0)
    rows = np.resize(np.arange(len(poses)), _POSTURES)
    span = np.where(model.robot.is_revolute, _SPAN_RAD, _SPAN_MM)
    q = poses.q[rows] + span * rng.uniform(-1.0, 1.0, (_POSTURES, model.robot.n_joints))
    return replace(poses.select(rows), q=q)


def _shared(moves: Array, columns: Array) -> Array:
    """Derivatives (K, P) of the K shared motions with `columns` (N, 3, K) that best follow `moves` (N, 3, P)."""
    stacked = columns.reshape(-1, columns.shape[-1])
    return np.linalg.pinv(stacked, rcond=1e-9) @ moves.reshape(len(stacked), -1)
