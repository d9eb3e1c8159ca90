"""Jacobian of the quantities that a kind of residual compares, for the nominal robot at given joint vectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib import frames
from calib.array_types import Array, IndexArray
from calib.errors import FitError
from calib.fitting.residual_kinds import require_kind_for
from calib.fitting.scanner_frame import orthonormal
from calib.kinematics import chain as kinematics
from calib.kinematics.robot import Robot, Target
from calib.options import RESIDUAL_KINDS

MM_PER_RADIAN = 500.0
"""The weight of turns against lengths where no covariance gives one: 0.05 mm against 0.1 mrad."""


def columns_of(
    robot: Robot,
    q: Array,
    setup: NDArray[np.str_],
    residual: str,
    *,
    frame_known: bool,
    targets: tuple[Target, ...] = (),
    of_target: IndexArray | None = None,
) -> tuple[Array, Array]:
    """Jacobian (R, P) of the compared quantities, unknowns projected out, and column norms (P,) before projection.

    q  # (N, n); setup  # (N,), distances are from the first pose of each
    of_target  # (N,) index of the target measured in each row, -1 for the tool point; None: the tool point in all
    """
    if residual not in RESIDUAL_KINDS:
        raise FitError(f"no residual named {residual!r}; there are {', '.join(RESIDUAL_KINDS)}")
    require_kind_for(robot, residual)
    chain = kinematics.nominal_chain(robot, q)
    points_mm = chain.target_mm
    if robot.carries_scanner:
        of_target = np.zeros(len(q), dtype=np.int64) if of_target is None else of_target
        points_mm, columns = _columns_of_world_targets(chain, targets, of_target)
    elif of_target is None:
        columns = kinematics.point_jacobian(chain, points_mm).reshape(len(q), 3, -1)
    else:
        points_mm, columns = _columns_of_targets(chain, targets, of_target)
    setups = [np.flatnonzero(setup == name) for name in np.unique(setup)]
    if residual == "distance":
        distances = [_distance_columns(points_mm[rows], columns[rows]) for rows in setups]
        return np.concatenate(distances), np.linalg.norm(columns, axis=(0, 1))
    absorbed = []
    if not frame_known or residual == "pairs":
        absorbed = [_motion(points_mm, rows) for rows in setups]
    if residual == "pose":
        by_table, orientation = kinematics.turn_jacobian(chain), chain.base_T_frame[:, -1, :3, :3]
        if robot.carries_scanner:
            by_table = kinematics.flange_turn_jacobian(chain)
            orientation = np.swapaxes(chain.base_T_flange[:, :3, :3], 1, 2)
        turn = MM_PER_RADIAN * by_table.reshape(len(q), 3, -1)
        turn = np.concatenate([turn, np.zeros((len(q), 3, columns.shape[-1] - turn.shape[-1]))], axis=2)
        columns = np.concatenate([columns, turn], axis=1)
        by_jig_rotation = np.zeros((len(q), 6, 3))  # unknown on the tool, or in the world
        by_jig_rotation[:, 3:] = MM_PER_RADIAN * orientation
        absorbed.append(by_jig_rotation)
        if of_target is not None:  # further targets have no orientation
            jig = [k for k, target in enumerate(targets) if target.name == "jig"]  # only where it is in the world
            for block in (columns, *absorbed):
                block[~np.isin(of_target, [-1, *jig]), 3:] = 0.0
    norms = np.linalg.norm(columns, axis=(0, 1))
    columns = np.asarray(columns.reshape(-1, columns.shape[-1]), dtype=np.float64)
    if absorbed:
        height = len(columns) // len(q)  # 3 rows a position, 6 a full pose
        basis = orthonormal(np.concatenate([a[:, :height] for a in absorbed], axis=2).reshape(len(columns), -1))
        columns = columns - basis @ (basis.T @ columns)
    return columns, norms


def _columns_of_targets(
    chain: kinematics.Chain, targets: tuple[Target, ...], of_target: IndexArray
) -> tuple[Array, Array]:
    """Points (N, 3) of the measured targets, mm, and their derivative (N, 3, P) by table and target positions."""
    points_mm = chain.target_mm.copy()
    by_table = kinematics.point_jacobian(chain, points_mm)
    by_position = np.zeros((len(of_target), 3, len(targets), 3))
    for k, target in enumerate(targets):
        rows = of_target == k
        link = chain.base_T_link(target.joint)
        points_mm[rows] = (link[:, :3, :3] @ np.array(target.xyz_mm) + link[:, :3, 3])[rows]
        by_table[rows] = kinematics.link_point_jacobian(chain, points_mm, target.joint)[rows]
        by_position[rows, :, k] = link[rows, :3, :3]
    return points_mm, np.concatenate([part.reshape(len(of_target), 3, -1) for part in (by_table, by_position)], axis=2)


def _columns_of_world_targets(
    chain: kinematics.Chain, targets: tuple[Target, ...], of_target: IndexArray
) -> tuple[Array, Array]:
    """Points (N, 3) of world-fixed targets in the flange's frame, mm, and their derivative (N, 3, P)."""
    positions_mm = np.array([target.xyz_mm for target in targets])[of_target]
    points_mm, by_table, by_position = kinematics.seen_from_flange(chain, positions_mm)
    by_positions = np.zeros((len(of_target), 3, len(targets), 3))
    by_positions[np.arange(len(of_target)), :, of_target] = by_position
    return points_mm, np.concatenate([part.reshape(len(of_target), 3, -1) for part in (by_table, by_positions)], axis=2)


def _motion(points_mm: Array, rows: IndexArray) -> Array:
    """Derivative (N, 6, 6) of positions and orientations by a small shift and turn of a setup's scanner frame."""
    motion = np.zeros((len(points_mm), 6, 6))
    motion[rows, :3] = frames.frame_motion(points_mm[rows], points_mm[rows].mean(axis=0))
    motion[rows, 3:, 3:] = MM_PER_RADIAN * np.eye(3)
    return motion


def _distance_columns(points_mm: Array, by_parameter: Array) -> Array:
    """Derivatives (N - 1, P) of distances from the first point: Phi of Jang eq (14) over twice the distance."""
    along = points_mm[1:] - points_mm[0]
    length = np.linalg.norm(along, axis=1)
    keep = length > 1e-6
    columns = np.einsum("ki,kip->kp", along[keep] / length[keep, None], (by_parameter[1:] - by_parameter[0])[keep])
    return np.asarray(columns)
