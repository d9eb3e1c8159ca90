"""Candidate poses that can be measured, spread over the whole work space of an arm."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.array_types import Array
from calib.errors import CalibError
from calib.frames import apply
from calib.kinematics.inverse import StepRule, solve_inverse
from calib.kinematics.joint_range import wrapped
from calib.workcell.jig_on_tool import JigGoals
from calib.workcell.measurable import counted, measurable
from calib.workcell.scan_field import tilted
from calib.workcell.view_of_target import RoomTarget, ViewGoals
from calib.workcell.workcell import Workcell

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


def _goals(cell: Workcell, rng: np.random.Generator) -> JigGoals | ViewGoals:
    """Goals for the jig: apexes in the field and axes within a tilt that keeps the jig's faces visible."""
    assert cell.field is not None
    apex_mm = cell.field.draw(_BATCH, rng)
    if cell.room_target is not None:
        return _view_goals(cell, cell.room_target, apex_mm, rng)
    assert cell.base_T_scanner is not None
    outward = None
    if cell.jig is not None:
        sight = apex_mm / np.linalg.norm(apex_mm, axis=1, keepdims=True)
        outward = -tilted(sight, _TILT_DEG, rng) @ cell.base_T_scanner[:3, :3].T
    open_side = -cell.tool_T_jig[:3, 2]
    return JigGoals(cell.robot, open_side, apply(cell.base_T_scanner, apex_mm), outward, _PRISMATIC_UNIT_MM)


def _view_goals(cell: Workcell, target: RoomTarget, seen_mm: Array, rng: np.random.Generator) -> ViewGoals:
    """Goals for a scanner on the flange: a target of the room at points of its field, seen from within its cone."""
    assert cell.flange_T_scanner is not None
    sight = seen_mm / np.linalg.norm(seen_mm, axis=1, keepdims=True)
    axis = tilted(sight, target.within_deg, rng) @ cell.flange_T_scanner[:3, :3].T
    point_mm = apply(cell.flange_T_scanner, seen_mm)
    return ViewGoals(cell.robot, point_mm, axis, target.place_mm, -target.outward, _PRISMATIC_UNIT_MM)
