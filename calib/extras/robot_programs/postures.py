"""Postures of the nominal arm that bring its flange to places, by what a program tells of them.

A place alone does not tell the arm's posture: a six-joint arm has up to eight, each again with whole turns of its
joints. A configuration tells it where one posture alone has it; else joints tell it to which the nearest is taken, or
the way there: on a linear motion the controller keeps the posture of its start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray, IndexArray
from calib.compensation.target_correction import plain_poses
from calib.compensation.tool_problem import ToolProblem
from calib.extras.robot_programs.program_text.targets import NO_CONFIGURATION, Configuration
from calib.fitting.model import geometric_model
from calib.kinematics import chain as kinematics
from calib.kinematics.flange import flange_frames, flange_T_tip
from calib.kinematics.inverse import FROM_ANYWHERE, solve_inverse
from calib.kinematics.joint_range import joint_limits
from calib.kinematics.robot import Robot

REACHED_MM, REACHED_RAD = 1e-6, 1e-9
_STARTS = (64, 160)  # of each place; the second count for those that the first left open
_AT_ONCE = 100  # places
_NEAR_MM = 30.0  # that the search from anywhere has to come to
_SAME_RAD = 1e-4  # joints of one posture, found twice
_RANGE_TOLERANCE_DEG = 0.2  # of a configuration's bounds, which rounded numbers may cross
_TURNS = 2.0 * np.pi * np.arange(-2, 3)
_ROUGH = replace(FROM_ANYWHERE, by_normal_equations=True)
_STEP_MM, _STEP_RAD = 25.0, 0.1  # of a linear motion that is followed
_MOST_STEPS, _ITERATIONS = 400, 8
_MEETS_MM = 2.0  # within which the axes of a wrist meet, and a wrist is on neither side of a line


@dataclass(frozen=True)
class Place:
    """A place of the flange, and what is known of the posture there."""

    base_T_flange: Array  # (4, 4) mm
    configuration: Configuration = NO_CONFIGURATION
    near: Array | None = None  # (n,) joints to which the nearest posture is taken, of several that fit


@dataclass(frozen=True)
class Posture:
    """Joints that bring the flange to a place; None with the reason where there are none or several."""

    q: Array | None
    reason: str = ""
    several: bool = False


def along(robot: Robot, start: Array, goal: Array) -> Array | None:
    """Joints (n,) at the end of a straight motion of the flange from joints (n,) to a place (4, 4).

    None where the way passes a singular posture, behind which the arm may go on in another one.
    """
    first = flange_frames(robot, start[None])[0]
    way = frames.invert(first) @ goal
    turn = frames.rotvec_from_rotation(way[:3, :3])
    far = float(np.hypot(np.linalg.norm(way[:3, 3]) / _STEP_MM, np.linalg.norm(turn) / _STEP_RAD))
    q, side = start, 0.0
    for share in np.linspace(0.0, 1.0, min(int(far) + 1, _MOST_STEPS) + 1):
        place = first @ frames.make_transform(frames.rotation_from_rotvec(share * turn), share * way[:3, 3])
        for _ in range(_ITERATIONS):
            left_mm, jacobian = _left(robot, q, place)
            sign = np.linalg.slogdet(jacobian)[0]
            if np.linalg.norm(left_mm) <= 0.1 * REACHED_MM or sign == 0.0:
                break
            q = q + np.linalg.solve(jacobian, left_mm)
        if np.linalg.norm(left_mm) > REACHED_MM or side * sign < 0.0:
            return None
        side = sign
    return q


def _left(robot: Robot, q: Array, place: Array) -> tuple[Array, Array]:
    """What is left (6,) to a place of the flange, mm, turns at a length of 1 m, and its derivative (6, n)."""
    chain = kinematics.nominal_chain(robot, q[None])
    at = chain.base_T_flange[0] @ robot.flange.transform
    moved, axes = kinematics.joint_jacobian(chain, robot.is_revolute, at[None, :3, 3])
    turn = at[:3, :3] @ frames.rotvec_from_rotation(at[:3, :3].T @ place[:3, :3])
    length_mm = REACHED_MM / REACHED_RAD
    left_mm = np.concatenate([place[:3, 3] - at[:3, 3], length_mm * turn])
    return left_mm, np.concatenate([moved[0], length_mm * axes[0]])


def same_posture(one: Array, other: Array) -> bool:
    """Whether joints (n,) differ by no more than whole turns."""
    return bool(np.abs(np.sin(0.5 * (one - other))).max() <= 0.5 * _SAME_RAD)


def postures_at(robot: Robot, places: Sequence[Place]) -> list[Posture]:
    """Posture of the nominal arm, of revolute joints alone, at each place; the same for the same input."""
    rng = np.random.default_rng(0)
    limits = joint_limits(robot)
    found = [np.empty((0, robot.n_joints))] * len(places)  # by place, (M, n)
    chosen = [Posture(None)] * len(places)
    for count in _STARTS:
        open_ = [k for k, posture in enumerate(chosen) if posture.q is None]
        for first in range(0, len(open_), _AT_ONCE):
            part = open_[first : first + _AT_ONCE]
            starts = np.array([_starts(places[k], limits, count, rng) for k in part])
            for k, q in zip(part, _solved(robot, [places[k] for k in part], starts), strict=True):
                found[k] = _distinct(np.concatenate([found[k], q]))
                chosen[k] = _choice(robot, places[k], found[k], limits)
    return chosen


def _starts(place: Place, limits: tuple[Array, Array], count: int, rng: np.random.Generator) -> Array:
    """Starts (count, n): random ones, half of them within the configuration, and known joints."""
    low, high = (np.clip(limit, -np.pi, np.pi) for limit in limits)
    starts = rng.uniform(low, high, (count, len(low)))
    if place.configuration.ranges_deg:
        first, last = np.radians(place.configuration.ranges_deg).T
        starts[::2] = rng.uniform(np.clip(first, low, high), np.clip(last, low, high), starts[::2].shape)
    if place.near is not None:
        starts[0] = place.near
    return starts


def _solved(robot: Robot, places: Sequence[Place], starts: Array) -> list[Array]:
    """Joints (M, n) that bring the flange to each of N places, found from starts (N, S, n)."""
    _, each, n = starts.shape
    goals = np.array([place.base_T_flange for place in places]) @ flange_T_tip(robot)
    model, flat = geometric_model(robot).at_tool, starts.reshape(-1, n)
    x = np.zeros(len(model.parameters))
    problem = ToolProblem(model, x, plain_poses(flat), np.repeat(goals, each, axis=0), True)
    unlimited = np.full(flat.shape, np.inf)
    q = solve_inverse(problem, flat, -unlimited, unlimited, _ROUGH)
    error_mm, turn_rad = problem.errors(q)
    near = np.flatnonzero((error_mm < _NEAR_MM) & (turn_rad * problem.length_mm < _NEAR_MM))
    q[near] = solve_inverse(problem.of(near), q[near], -unlimited[near], unlimited[near])
    error_mm, turn_rad = problem.errors(q)
    reached = (error_mm <= REACHED_MM) & (turn_rad <= REACHED_RAD)
    return [q[k : k + each][reached[k : k + each]] for k in range(0, len(q), each)]


def _distinct(q: Array) -> Array:
    """Postures (M, n) that differ by more than whole turns, with joints in -pi to pi."""
    kept: list[Array] = []
    for one in q - 2.0 * np.pi * np.round(q / (2.0 * np.pi)):
        if not any(same_posture(one, other) for other in kept):
            kept.append(one)
    return np.array(kept).reshape(-1, q.shape[1])


def _choice(robot: Robot, place: Place, found: Array, limits: tuple[Array, Array]) -> Posture:
    """The one posture within limits and configuration, or of several the nearest to known joints."""
    if not len(found):
        return Posture(None, "no joints of the nominal arm bring the tool there")
    options = found[:, None] + _TURNS[:, None]  # (M, 5, n)
    usable = (options >= limits[0] - 1e-9) & (options <= limits[1] + 1e-9)
    within = _with_all(usable)
    if place.configuration.ranges_deg:
        commanded = np.degrees(robot.commands_of(found)[:, None] + _TURNS[:, None])
        low, high = np.array(place.configuration.ranges_deg).T
        usable &= (commanded >= low - _RANGE_TOLERANCE_DEG) & (commanded <= high + _RANGE_TOLERANCE_DEG)
    fits = _with_all(usable)
    if len(fits) > 1:
        fits = fits[_on_sides(robot, found[fits], place.configuration)]
    few_turns = usable & (np.abs(options) <= np.pi)
    plain = fits[_with_all(few_turns[fits])]
    if len(fits) > 1 and len(plain) and place.near is None:  # of a joint without limits whole turns are not meant
        fits, usable = plain, few_turns
    near = np.zeros(found.shape[1]) if place.near is None else place.near
    if len(fits) == 1 or (len(fits) > 1 and place.near is not None):
        away = np.where(usable[fits], np.abs(options[fits] - near), np.inf)
        k = int(np.argmin(np.linalg.norm(away.min(axis=1), axis=1)))
        return Posture(found[fits[k]] + _TURNS[np.argmin(away[k], axis=0)])
    if len(fits):
        return Posture(None, f"the program does not tell which of {len(fits)} postures the arm has there", True)
    if not len(within):
        return Posture(None, "the joints that bring the tool there are beyond the limits in robot.toml")
    other = ", ".join(f"{v:.0f}°" for v in np.degrees(robot.commands_of(found[within][0])))
    return Posture(None, f"no posture of robot.toml's arm has the program's configuration there; another is {other}")


def _with_all(usable: BoolArray) -> IndexArray:
    """Postures (K,), of which each joint is usable with some whole turns (M, 5, n)."""
    return np.flatnonzero(np.all(np.any(usable, axis=1), axis=1))


def _on_sides(robot: Robot, q: Array, configuration: Configuration) -> BoolArray:
    """Which postures (M,) have the wrist and axis 5 on the sides that are told; all where these mean nothing.

    Only arms whose last three axes meet have such sides. If all or none of them fit, nothing is taken to be told.
    """
    fits = np.ones(len(q), dtype=bool)
    if configuration.axis_5_negative is not None:
        fits &= (robot.commands_of(q)[:, 4] < 0.0) == configuration.axis_5_negative
    ahead_mm, elbow_mm = _sides(robot, np.concatenate([np.zeros((1, q.shape[1])), q]))
    for told, side_mm in (
        (None if configuration.behind is None else not configuration.behind, ahead_mm[1:] * np.sign(ahead_mm[0])),
        (configuration.elbow, elbow_mm[1:]),
        (configuration.elbow_as_at_zero, elbow_mm[1:] * np.sign(elbow_mm[0])),
    ):
        if told is not None:
            fits &= ~(np.abs(side_mm) > _MEETS_MM) | ((side_mm > 0.0) == told)
    return fits if fits.any() else ~fits


def _sides(robot: Robot, q: Array) -> tuple[Array, Array]:
    """Distances (M,), mm, of the wrist ahead of axis 1 and, as joint 3 turns, of the line from axis 2 to axis 3.

    nan for an arm of other than six joints, or whose last three axes do not meet.
    """
    if robot.n_joints == 6:
        at = kinematics.nominal_chain(robot, q).base_T_frame[:, :6]
        z, o = at[..., :3, 2], at[..., :3, 3]
        across = np.eye(3) - z[:, 3:, :, None] * z[:, 3:, None, :]  # what of a vector is across the axes of the wrist
        wrist = (np.linalg.pinv(across.sum(axis=1)) @ (across @ o[:, 3:, :, None]).sum(axis=1))[
            ..., 0
        ]  # nearest to all
        if np.linalg.norm(across @ (wrist[:, None] - o[:, 3:])[..., None], axis=2).max() <= _MEETS_MM:
            ahead = np.einsum("mi,mi->m", wrist - o[:, 0], np.cross(z[:, 1], z[:, 0]))
            line = o[:, 2] - o[:, 1]
            side = np.einsum("mi,mi->m", np.cross(line, wrist - o[:, 2]), z[:, 2])
            return ahead, side / np.maximum(np.linalg.norm(line, axis=1), 1e-9)
    none = np.full(len(q), np.nan)
    return none, none
