"""The tool point and the scanner's frames by themselves, the rest of the table as robot.toml has it.

    s_i = Q (o_i + R_i p) + t

with the measured point s_i, the last joint's frame (R_i, o_i) of the nominal arm, the scanner's frame (Q, t) of each
setup, and the tool point p in the last joint's frame. Link errors of millimetres leave p a few millimetres off, which
is near enough to start a fit from where robot.toml is wrong by more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib import frames
from calib.array_types import Array, IndexArray
from calib.fitting.observations import Observations
from calib.fitting.scanner_frame import frame_columns, orthonormal
from calib.kinematics import chain as kinematics
from calib.kinematics.robot import Robot

_STEPS = 50
_LEAST_DOF = 12  # equations beyond the unknowns; fewer say little of how sure the point is
_WIDEST_MM = 1000.0  # sigma that holds p in the directions of which the points tell nothing


@dataclass(frozen=True)
class SolvedToolPoint:
    """A tool point by the measured points alone."""

    point_mm: Array  # (3,) in the last joint's frame
    covariance_mm2: Array  # (3, 3) by what is left over, as if that were white


@dataclass(frozen=True)
class ToolPointProblem:
    """M points of the tool, by what the nominal arm predicts and by where they were measured."""

    flange_mm: Array  # (M, 3) origin of the last joint's frame, base frame
    base_R_flange: Array  # (M, 3, 3)
    scanner_mm: Array  # (M, 3) measured
    setups: list[IndexArray]  # rows of each
    nominal_mm: Array  # (3,)
    directions: Array  # (3, K) orthonormal: along which p may move

    @classmethod
    def of(cls, observed: Observations, robot: Robot, nominal_mm: Array, directions: Array) -> ToolPointProblem:
        """The problem for the tool's points: further targets, in the last joint's frame, do not depend on p."""
        poses, row = observed.used_poses
        is_tool = observed.points.target == "jig"
        flange = kinematics.forward(robot.table, poses.q, robot.is_revolute, robot.base_T_first).base_T_flange[
            row[is_tool]
        ]
        setup = observed.setup[is_tool]
        return cls(
            flange_mm=flange[:, :3, 3],
            base_R_flange=flange[:, :3, :3],
            scanner_mm=observed.points.xyz_mm[is_tool],
            setups=[np.flatnonzero(setup == name) for name in np.unique(setup)],
            nominal_mm=nominal_mm,
            directions=directions,
        )

    @property
    def dof(self) -> int:
        """Degrees of freedom: equations beyond the unknowns."""
        return 3 * len(self.scanner_mm) - 6 * len(self.setups) - self.directions.shape[1]

    def at(self, moved_mm: Array) -> tuple[Array, Array]:
        """Residual (3 M,), and its derivative (3 M, K) beside free frames, with p moved along the directions (K,)."""
        base_mm = self.flange_mm + self.base_R_flange @ (self.nominal_mm + self.directions @ moved_mm)
        residual = np.empty_like(base_mm)
        columns = np.empty((*base_mm.shape, len(moved_mm)))
        for rows in self.setups:
            scanner_T_base = frames.best_fit_transform(base_mm[rows], self.scanner_mm[rows], np.ones(len(rows)))
            at_mm = frames.apply(scanner_T_base, base_mm[rows])
            residual[rows] = at_mm - self.scanner_mm[rows]
            block = scanner_T_base[:3, :3] @ self.base_R_flange[rows] @ self.directions
            block = block.reshape(3 * len(rows), -1)
            basis = orthonormal(frame_columns(at_mm, np.broadcast_to(np.eye(3), (len(rows), 3, 3))))
            columns[rows] = (block - basis @ (basis.T @ block)).reshape(len(rows), 3, -1)
        return residual.ravel(), columns.reshape(-1, len(moved_mm))


def solve_tool_point(problem: ToolPointProblem) -> SolvedToolPoint | None:
    """Gauss-Newton from the nominal point, frames in closed form; None where too few points are measured."""
    count = problem.directions.shape[1]
    if count == 0 or problem.dof < _LEAST_DOF:
        return None
    moved = np.zeros(count)
    residual, columns = problem.at(moved)
    hold = 0.0
    for _ in range(_STEPS):
        cost = float(residual @ residual)
        hold = cost / problem.dof / _WIDEST_MM**2
        # Least squares of columns and hold together: exact points hold nothing, and may tell nothing of a direction.
        stacked = np.concatenate([columns, np.sqrt(hold) * np.eye(count)])
        step = -np.linalg.lstsq(stacked, np.concatenate([residual, np.sqrt(hold) * moved]), rcond=1e-12)[0]
        for share in 0.5 ** np.arange(8):
            residual, columns = problem.at(moved + share * step)
            if float(residual @ residual) <= cost:
                break
        moved = moved + share * step
        if np.linalg.norm(share * step) < 1e-3:
            break
    noise2 = float(residual @ residual) / problem.dof
    _, size, turn = np.linalg.svd(columns, full_matrices=False)
    sigma_mm = 1.0 / np.sqrt(size**2 / max(noise2, 1e-12) + 1.0 / _WIDEST_MM**2)
    root = problem.directions @ turn.T * sigma_mm
    covariance = root @ root.T
    return SolvedToolPoint(problem.nominal_mm + problem.directions @ moved, covariance)
