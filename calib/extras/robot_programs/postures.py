"""Postures of the nominal arm that bring its flange to places, and the choice among them.

All postures are looked for, from many starts, since a place alone does not tell the arm's: a six-joint arm has up to
eight, each again with whole turns of its joints. Which one a program means is told by its configuration, where it has
one, and else taken as the nearest to known joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, BoolArray
from calib.compensation.target_correction import plain_poses
from calib.compensation.tool_problem import ToolProblem
from calib.fitting.model import geometric_model
from calib.kinematics.flange import flange_T_tip
from calib.kinematics.inverse import FROM_ANYWHERE, solve_inverse
from calib.kinematics.joint_range import joint_limits
from calib.kinematics.robot import Robot

REACHED_MM, REACHED_RAD = 1e-6, 1e-9
_STARTS = (32, 160)  # of each place; the second count for those that the first left open
_AT_ONCE = 100  # places
_NEAR_MM = 30.0  # that the search from anywhere has to come to
_SAME_RAD = 1e-4  # joints of one posture, found twice
_RANGE_TOLERANCE_DEG = 0.2  # of a configuration's bounds, which rounded numbers may cross
_TURNS = 2.0 * np.pi * np.arange(-2, 3)
_ROUGH = replace(FROM_ANYWHERE, by_normal_equations=True)


@dataclass(frozen=True)
class Place:
    """A place of the flange, and what is known of the posture there."""

    base_T_flange: Array  # (4, 4) mm
    ranges_deg: tuple[tuple[float, float], ...]  # of each commanded joint; () without a configuration
    near: Array  # (K, n) joints, of which the nearest counts
    bind: bool = True  # whether no other configuration will do


@dataclass(frozen=True)
class Posture:
    """Joints that bring the flange to a place; None with the reason where there are none."""

    q: Array | None
    reason: str = ""


def postures_at(robot: Robot, places: Sequence[Place]) -> list[Posture]:
    """Posture of the nominal arm, of revolute joints alone, at each place; the same for the same input."""
    rng = np.random.default_rng(0)
    limits = joint_limits(robot)
    at: list[Array] = []
    for start in range(0, len(places), _AT_ONCE):
        part = places[start : start + _AT_ONCE]
        reached = _candidates(robot, part, limits, _STARTS[0], rng)
        missing = [k for k, q in enumerate(reached) if _choice(robot, part[k], q, limits, False).q is None]
        for k, again in zip(
            missing, _candidates(robot, [part[k] for k in missing], limits, _STARTS[1], rng), strict=True
        ):
            reached[k] = _distinct(np.concatenate([reached[k], again]))
        at += reached
    return [_choice(robot, place, q, limits) for place, q in zip(places, at, strict=True)]


def _candidates(
    robot: Robot, places: Sequence[Place], limits: tuple[Array, Array], count: int, rng: np.random.Generator
) -> list[Array]:
    """Postures (M, n) that lead to each place, found from a count of starts."""
    if not places:
        return []
    starts = np.array([_starts(place, limits, count, rng) for place in places])
    q, reached = _solved(robot, places, starts)
    return [_distinct(q[k][reached[k]]) for k in range(len(places))]


def _starts(place: Place, limits: tuple[Array, Array], count: int, rng: np.random.Generator) -> Array:
    """Starts (count, n): known joints, and random ones, half of them within the configuration."""
    low, high = (np.clip(limit, -np.pi, np.pi) for limit in limits)
    n = len(low)
    starts = rng.uniform(low, high, (count, n))
    if place.ranges_deg:
        first, last = np.radians(np.array(place.ranges_deg)).T
        inner_low, inner_high = np.maximum(low, first), np.minimum(high, last)
        usable = inner_low < inner_high
        starts[::2] = rng.uniform(
            np.where(usable, inner_low, low), np.where(usable, inner_high, high), (len(starts[::2]), n)
        )
    known = place.near[: count // 4]
    starts[: len(known)] = known
    return starts


def _solved(robot: Robot, places: Sequence[Place], starts: Array) -> tuple[Array, BoolArray]:
    """Joints (N, S, n) found from starts (N, S, n), and whether they bring the flange to the place."""
    count, each, n = starts.shape
    goals = np.array([place.base_T_flange for place in places]) @ flange_T_tip(robot)
    problem = ToolProblem(
        geometric_model(robot).at_tool,
        np.zeros(len(geometric_model(robot).at_tool.parameters)),
        plain_poses(starts.reshape(-1, n)),
        np.repeat(goals, each, axis=0),
        True,
    )
    unlimited = np.full((count * each, n), np.inf)
    q = solve_inverse(problem, starts.reshape(-1, n), -unlimited, unlimited, _ROUGH)
    error_mm, turn_rad = problem.errors(q)
    near = np.flatnonzero((error_mm < _NEAR_MM) & (turn_rad * problem.length_mm < _NEAR_MM))
    q[near] = solve_inverse(problem.of(near), q[near], -unlimited[near], unlimited[near])
    error_mm, turn_rad = problem.errors(q)
    reached = (error_mm <= REACHED_MM) & (turn_rad <= REACHED_RAD)
    return q.reshape(count, each, n), reached.reshape(count, each)


def _distinct(q: Array) -> Array:
    """Postures (M, n) that differ by more than whole turns, with joints in -pi to pi."""
    kept: list[Array] = []
    for one in q - 2.0 * np.pi * np.round(q / (2.0 * np.pi)):
        if all(np.abs(np.sin(0.5 * (one - other))).max() > 0.5 * _SAME_RAD for other in kept):
            kept.append(one)
    return np.array(kept).reshape(-1, q.shape[1])


def _choice(robot: Robot, place: Place, found: Array, limits: tuple[Array, Array], otherwise: bool = True) -> Posture:
    """Posture within limits and configuration that is nearest to known joints, whole turns included.

    otherwise: whether another configuration is taken where the controller would.
    """
    if not len(found):
        return Posture(None, "no joints of the nominal arm bring the tool there")
    best: tuple[float, Array] | None = None
    within_limits = False
    for q in found:
        options = q + _TURNS[:, None]  # (5, n)
        usable = (options >= limits[0] - 1e-9) & (options <= limits[1] + 1e-9)
        within_limits |= bool(usable.any(axis=0).all())
        if place.ranges_deg:
            commanded = np.degrees(robot.commands_of(q) + _TURNS[:, None])
            low, high = np.array(place.ranges_deg).T
            usable &= (commanded >= low - _RANGE_TOLERANCE_DEG) & (commanded <= high + _RANGE_TOLERANCE_DEG)
        if not usable.any(axis=0).all():
            continue
        away = np.where(usable, np.abs(options - place.near[:, None]), np.inf)  # (K, 5, n)
        turn = np.argmin(away, axis=1)
        distance = np.linalg.norm(np.min(away, axis=1), axis=1)
        k = int(np.argmin(distance))
        if best is None or distance[k] < best[0] - 1e-9:
            best = (float(distance[k]), q + _TURNS[turn[k]])
    if best is not None:
        return Posture(best[1])
    if within_limits:
        other = _choice(robot, replace(place, ranges_deg=()), found, limits).q
        assert other is not None
        if otherwise and not place.bind:
            return Posture(other)
        joints = ", ".join(f"{v:.0f}°" for v in np.degrees(robot.commands_of(other)))
        return Posture(
            None, f"no posture of robot.toml's arm has the program's configuration there; the nearest other is {joints}"
        )
    return Posture(None, "the joints that bring the tool there are beyond the limits in robot.toml")
