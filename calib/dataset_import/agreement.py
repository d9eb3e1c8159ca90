"""How well a nominal arm and measured points belong together, wherever the scanner stands and the tool ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.frames import apply, best_fit_transform
from calib.kinematics.chain import forward
from calib.kinematics.robot import Robot

LEAST_POSES = 16  # nine numbers are fitted; with fewer poses than this anything seems to agree
_MOST_POSES = 150  # a share of a large table says the same
_TURNS = 6  # of frame and tool point, each fitted beside the other
_HOPELESS = 0.4  # of the points' spread that is left after two turns: nothing agrees there
_TOOL_REACH = 1.0  # of the points' spread that a tool point may be off


@dataclass(frozen=True)
class Sample:
    """Poses that were measured once each, all from one place and of one target."""

    q: Array  # (N, n) rad, mm
    points_mm: Array  # (N, 3)

    @property
    def spread_mm(self) -> float:
        """Root mean square distance of the points from their middle."""
        away = self.points_mm - self.points_mm.mean(axis=0)
        return float(np.sqrt(np.mean(np.sum(away**2, axis=1))))

    @property
    def is_enough(self) -> bool:
        """Whether it can tell anything."""
        return len(self.q) >= LEAST_POSES and self.spread_mm > 0.0


def sample_of(q: Array, points_mm: Array) -> Sample:
    """The poses with finite values, thinned evenly. q: (N, n), points_mm: (N, 3), beside each other."""
    known = np.flatnonzero(np.isfinite(q).all(axis=1) & np.isfinite(points_mm).all(axis=1))
    if len(known) > _MOST_POSES:
        known = known[np.linspace(0, len(known) - 1, _MOST_POSES).astype(int)]
    return Sample(q[known], points_mm[known])


def misfit_mm(robot: Robot, q: Array, points_mm: Array) -> float:
    """Root mean square distance that is left between the nominal arm's tool and the points, (N, n) and (N, 3).

    The scanner's frame and the tool's point, which users know least, are fitted in turn, each in closed form: minimise
    over R, s, t the sum of |R (p_i + A_i t) + s - m_i|^2, with p_i and A_i the nominal tool's place and attitude.
    """
    ends = forward(robot.table, q, robot.is_revolute, robot.base_T_first).base_T_frame[:, -1]
    place, attitude = ends[:, :3, 3], ends[:, :3, :3]
    away = points_mm - points_mm.mean(axis=0)
    spread = float(np.sqrt(np.mean(np.sum(away**2, axis=1))))
    steps = (attitude - attitude.mean(axis=0)).reshape(-1, 3)
    inverse = np.linalg.pinv(steps.T @ steps, rcond=1e-9, hermitian=True) @ steps.T
    offset, best = np.zeros(3), np.inf
    for turn in range(_TURNS):
        if turn == 2 and best > _HOPELESS * spread:
            break
        mine = place + attitude @ offset
        frame = best_fit_transform(mine, points_mm)
        best = min(best, float(np.sqrt(np.mean(np.sum((apply(frame, mine) - points_mm) ** 2, axis=1)))))
        seen = away @ frame[:3, :3]  # in the arm's frame
        offset = inverse @ (seen - (place - place.mean(axis=0))).ravel()
        length = float(np.linalg.norm(offset))
        if length > _TOOL_REACH * spread:
            offset = offset * (_TOOL_REACH * spread / length)
    return best
