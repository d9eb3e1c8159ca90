"""Candidate poses that can be measured, spread over the whole work space of an arm, by goals for where it points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.array_types import Array, BoolArray, IndexArray
from calib.errors import CalibError
from calib.frames import apply, invert
from calib.kinematics.chain import Chain, joint_jacobian, nominal_chain
from calib.kinematics.inverse import StepRule, solve_inverse
from calib.kinematics.joint_range import wrapped
from calib.kinematics.robot import Robot
from calib.kinematics.tool_point import tip_T_last
from calib.workcell.measurable import counted, measurable
from calib.workcell.scan_field import tilted
from calib.workcell.workcell import Workcell

_LEVER_MM = 300.0  # weighs one radian of the direction against millimetres
_REACHED_MM, _REACHED_RAD = 1.0, 0.02


@dataclass(frozen=True)
class PointingGoals:
    """N goals: a point of the flange at a place, and a direction along another; the turn about it is free.

    Each of the four is one vector (3,) for all goals, or one for each (N, 3).
    """

    robot: Robot
    point_mm: Array  # flange frame
    direction: Array  # unit, flange frame
    place_mm: Array  # base frame
    outward: Array | None  # unit, base frame: where the direction shall point; None: anywhere
    prismatic_unit_mm: float = 1.0  # that counts as much as a radian

    @property
    def joint_units(self) -> Array:
        """(n,) unit of each joint: 1 rad, or the equivalent length in mm."""
        return np.where(self.robot.is_revolute, 1.0, self.prismatic_unit_mm)

    def linearise(self, q: Array, rows: IndexArray) -> tuple[Array, Array]:
        """Errors of place (mm) and direction, and their Jacobian by the joints.

        The direction's error is its sine times `_LEVER_MM`; rotations about the direction are taken out.
        """
        chain = nominal_chain(self.robot, q)
        point_mm, pointing = self._carried(chain, rows)
        moved, axes = joint_jacobian(chain, self.robot.is_revolute, point_mm)
        off_mm = _of(self.place_mm, rows) - point_mm
        if self.outward is None:
            return off_mm, moved * self.joint_units
        outward = _of(self.outward, rows)
        turn = np.cross(pointing, outward)
        # Where it points the wrong way round the sine vanishes too: any turn leads on.
        turn += np.where(np.sum(pointing * outward, axis=1) < -0.99, 0.1, 0.0)[:, None]
        axes = axes - pointing[:, :, None] * np.einsum("ki,kin->kn", pointing, axes)[:, None]
        error = np.concatenate([off_mm, _LEVER_MM * turn], axis=1)
        return error, np.concatenate([moved, _LEVER_MM * axes], axis=1) * self.joint_units

    def reached(self, chain: Chain) -> BoolArray:
        """Mask (N,): whether place and direction are met at the poses of a chain, to 1 mm and 0.02 rad."""
        point_mm, pointing = self._carried(chain, slice(None))
        near = np.linalg.norm(point_mm - self.place_mm, axis=1) < _REACHED_MM
        if self.outward is None:
            return np.asarray(near)
        return near & (np.sum(pointing * self.outward, axis=1) > np.cos(_REACHED_RAD))

    def _carried(self, chain: Chain, rows: IndexArray | slice) -> tuple[Array, Array]:
        """Point (K, 3), mm, and direction (K, 3) at each pose, base frame."""
        direction = _of(self.direction, rows)[..., None]
        pointing = (chain.base_T_flange[:, :3, :3] @ direction)[..., 0]
        return apply(chain.base_T_flange, _of(self.point_mm, rows)), pointing


def _of(vectors: Array, rows: IndexArray | slice) -> Array:
    """Vectors of some goals: the one of all goals (3,), or (K, 3)."""
    return vectors if vectors.ndim == 1 else vectors[rows]


_BATCH = 1024
_STARTS = 4  # random joint vectors for each goal, of which the nearest is taken
_MOST_TRIES = 40  # for each pose that is wanted
_FEWEST_TRIES, _TRIES_FOR_ONE = 16 * _BATCH, 4 * _BATCH
_PRISMATIC_UNIT_MM = 300.0
_TILT_DEG = 25.0  # a cube's corner that leans farther from the line of sight has a face steeper than 70 deg
_TOWARDS = StepRule(iterations=14, constant_damping_mm2=400.0, longest_step=0.5, by_normal_equations=True)


def candidate_poses(cell: Workcell, count: int, *, rng: np.random.Generator) -> Array:
    """(count, n) joint vectors, rad or mm, that can be measured in the cell.

    Where the scanner's pose and field are known, apexes and axes of the jig are drawn in it, and the joints are solved
    for them from random ones of the whole range; they need not arrive, only end where the jig is seen. Otherwise joints
    are drawn within their range.

    Raises:
        CalibError: too few exist, with the reasons that refused the others.
    """
    accepted: list[Array] = []
    reasons: list[NDArray[np.str_]] = []
    total = tried = 0
    while total < count:
        if tried >= (max(_MOST_TRIES * count, _FEWEST_TRIES) if total else _TRIES_FOR_ONE):
            raise CalibError(
                f"robot {cell.robot.name}: found {total} of {count} poses that can be measured; of {tried} tries "
                f"{counted(reasons)}; move the scanner, widen its field or the joints' limits, or correct [cell]"
            )
        q = likely_poses(cell, rng)
        judged = measurable(cell, q)
        accepted.append(q[judged.ok])
        reasons.append(judged.reason)
        tried += len(q)
        total += len(accepted[-1])
    return np.concatenate(accepted)[:count]


def likely_poses(cell: Workcell, rng: np.random.Generator) -> Array:
    """Joint vectors (1024, n) that are likely to bring the jig into the field."""
    low, high = cell.low, cell.high
    if cell.field is None or (cell.base_T_scanner is None and cell.room_target is None):
        return rng.uniform(low, high, (_BATCH, len(low)))
    goals = _goals(cell, rng)
    starts = rng.uniform(low, high, (_STARTS, _BATCH, len(low)))
    every = np.arange(_BATCH)
    off = np.array([np.linalg.norm(goals.linearise(q, every)[0], axis=1) for q in starts])
    start = starts[np.argmin(off, axis=0), every]
    anywhere = np.full_like(start, np.inf)
    turns = cell.robot.is_revolute
    lowest = np.where(turns, -anywhere, low)
    q = solve_inverse(goals, start, lowest, np.where(turns, anywhere, high), _TOWARDS)
    return np.where(turns, wrapped(q, low), q)


def _goals(cell: Workcell, rng: np.random.Generator) -> PointingGoals:
    """Goals for the jig: apexes in the field and axes within a tilt that keeps the jig's faces visible.

    For a scanner on the flange: a target of the room at points of its field, seen from within its cone.
    """
    assert cell.field is not None
    apex_mm = cell.field.draw(_BATCH, rng)
    sight = apex_mm / np.linalg.norm(apex_mm, axis=1, keepdims=True)
    if cell.room_target is not None:
        assert cell.flange_T_scanner is not None
        axis = tilted(sight, cell.room_target.within_deg, rng) @ cell.flange_T_scanner[:3, :3].T
        target = cell.room_target
        point_mm, place_mm, outward = apply(cell.flange_T_scanner, apex_mm), target.place_mm, -target.outward
        return PointingGoals(cell.robot, point_mm, axis, place_mm, outward, _PRISMATIC_UNIT_MM)
    assert cell.base_T_scanner is not None
    towards = None if cell.jig is None else -tilted(sight, _TILT_DEG, rng) @ cell.base_T_scanner[:3, :3].T
    flange_T_jig = invert(tip_T_last(cell.robot)) @ cell.tool_T_jig
    apex_mm = apply(cell.base_T_scanner, apex_mm)
    return PointingGoals(cell.robot, flange_T_jig[:3, 3], -flange_T_jig[:3, 2], apex_mm, towards, _PRISMATIC_UNIT_MM)
