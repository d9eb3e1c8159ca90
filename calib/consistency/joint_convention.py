"""Search for the convention of a table's joint columns by the points that the nominal arm reaches.

A controller's joints need not be the robot file's: a sign or a zero differs, or a value is a sum of neighbours, as
whole numbers combine them. A pendant may count the forearm from the horizontal (J3 - J2), a palletiser's parallelogram
its arms, a coupled wrist its motors. Every candidate's arm is brought to the points by the instrument's frame and a
tool point, batched over candidates; rows that disagree count little (weights of Cauchy's distribution), and a candidate
is judged by the three fifths of the rows that agree best, so that a third of bad rows neither makes nor hides one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from calib.array_types import Array, IndexArray
from calib.consistency.joint_reading import JointReading, edits, with_signs
from calib.frames import nearest_rotation, skew
from calib.kinematics.chain import forward
from calib.kinematics.robot import Robot
from calib.statistics import rms_length

FEWEST_POSES = 5  # nine numbers are fitted; of fewer poses almost any convention agrees
_MANY_POSES = 16
_AGREES = {True: 0.1, False: 0.03}  # of the points' spread that a convention may leave, of many poses and of few
_GAIN = 5.0  # times what the columns as they are leave
_RIVAL = 3.0  # times what the best leaves, up to which a convention that is as simple may be it as well
_JUDGED = 0.6  # of the rows
_ROUGH_ROWS, _MOST_ROWS = 10, 40
_BEAM, _NEARBY, _SHORTLIST = 120, 3, 14
_DEEPEST = 3  # changes of the columns beside signs
_FEW_JOINTS = 4  # up to which sums of any columns are tried at every step
_LARGEST_PITCH_MM, _PITCHES, _ZOOMS = 64.0, 16, 3  # of a screw, tried in so many steps, which three times get finer
_CHUNK = 1500  # candidates at once
_ROUGH_TURNS, _TURNS, _MANY_TURNS = 5, 12, 60  # of frame and tool
_CAUCHY = 4.0  # squared, times the last judged row's distance, at which a row counts half
_RIDGE = 1e-6  # of what poses that hardly turn leave open
_REACH_MM = 2000.0  # of a tool point
_ROW_FLOOR = 1e-4  # of the points' spread, below which rows agree alike


@dataclass(frozen=True)
class JointConvention:
    """Conventions that fit the points, the simplest; several where these poses do not tell which."""

    readings: tuple[JointReading, ...]  # () where none is needed, or none fits
    left_mm: float  # by the rows that agree best, with the first of them
    as_it_is_mm: float  # the same with the columns as they are


@dataclass(frozen=True)
class RobustAgreement:
    """The nominal arm brought to points by the frame and the tool point with which most rows agree."""

    left_mm: float  # root mean square of the rows that agree best
    tool_mm: Array  # (3,) of the tool point, beyond the nominal one, in the tool's frame
    off_mm: Array  # (N,) distances of all rows


def best_agreement(robot: Robot, q: Array, points_mm: Array) -> RobustAgreement:
    """Agreement of the nominal arm at joint values q (N, n) with points (N, 3) of one instrument, or of one place."""
    left, tool_mm, off_mm = _of_chunk(robot, [JointReading.plain(robot.n_joints)], q, points_mm, _MANY_TURNS)
    return RobustAgreement(float(left[0]), tool_mm[0], off_mm[0])


def likely_conventions(robot: Robot, q: Array, points_mm: Array) -> tuple[JointReading, ...]:
    """Readings of joint values q (N, n) that come nearest to the points (N, 3), the best first."""
    return tuple(reading for _, reading in _ranked(robot, q, points_mm)[:_SHORTLIST] if reading.edits)


def joint_convention(robot: Robot, q: Array, points_mm: Array) -> JointConvention:
    """Convention in which joint values q (N, n), rad and mm, bring the arm to points (N, 3), mm, of one instrument.

    Claimed only where it leaves a small part of what the columns as they are leave, and no other as simple one is near.
    """
    if len(q) < FEWEST_POSES:
        return JointConvention((), np.inf, np.inf)
    ranked = _ranked(robot, q, points_mm)
    as_it_is = next(left for left, reading in ranked if not reading.edits)
    best = ranked[0][0]
    spread = rms_length(points_mm - np.median(points_mm, axis=0))
    if best > _AGREES[len(q) >= _MANY_POSES] * spread or as_it_is < _GAIN * best:
        return JointConvention((), best, as_it_is)
    near = [(left, reading) for left, reading in ranked if left < _RIVAL * best]
    least = min(reading.rank for _, reading in near)
    simplest = [(left, reading) for left, reading in near if reading.rank == least]
    return JointConvention(tuple(reading for _, reading in simplest), simplest[0][0], as_it_is)


def _ranked(robot: Robot, q: Array, points_mm: Array) -> list[tuple[float, JointReading]]:
    """Candidates with what they leave, mm, the best first; the columns as they are among them."""
    turns, plain = robot.is_revolute, JointReading.plain(robot.n_joints)
    rows = _spread_rows(len(q), _ROUGH_ROWS)
    tried: dict[JointReading, float] = {}
    summed = [reading for reading in edits(plain, turns) if reading.added]
    backwards = [replace(plain, order=plain.order[::-1])] if turns.all() else []
    wanted = [*with_signs([plain, *backwards, *edits(plain, turns, far=True)], robot.n_joints)]
    twice = [again for once in summed for again in edits(once, turns) if len(again.added) > 1]
    wanted += [*twice, *(solved for reading in twice if (solved := reading.solved) is not None)]
    for _ in range(_DEEPEST):
        new = [reading for reading in dict.fromkeys(wanted) if reading not in tried]
        tried |= zip(new, _left_mm(robot, new, q[rows], points_mm[rows], _ROUGH_TURNS).tolist(), strict=True)
        best = sorted(tried, key=lambda reading: tried[reading])[:_BEAM]
        wanted = [edit for reading in best for edit in edits(reading, turns, far=robot.n_joints <= _FEW_JOINTS)]
    rows = _spread_rows(len(q), _MOST_ROWS)
    nearby = [edit for reading in best[:_NEARBY] for edit in edits(reading, turns)]  # a change less among them
    screws = [_screwed(robot, reading, q[rows], points_mm[rows]) for reading in (plain, *best[:_NEARBY])]
    finalists = list(dict.fromkeys([plain, *best, *nearby, *(one for each in screws for one in each)]))
    left = _left_mm(robot, finalists, q[rows], points_mm[rows], _TURNS)
    return sorted(zip(left.tolist(), finalists, strict=True), key=lambda pair: pair[0])


def _screwed(robot: Robot, reading: JointReading, q: Array, points_mm: Array) -> list[JointReading]:
    """The reading with each slide moved by each turn, as on a SCARA's ball screw, by the pitch that fits best."""
    out = []
    turns = robot.is_revolute
    for k, j in product(np.flatnonzero(~turns).tolist(), np.flatnonzero(turns).tolist()):
        pitch_mm, step_mm = 0.0, _LARGEST_PITCH_MM / _PITCHES
        for _ in range(_ZOOMS):
            pitches = pitch_mm + step_mm * np.arange(-_PITCHES, _PITCHES + 1)
            tried = [replace(reading, added=(*reading.added, (k, j, mm / (2.0 * np.pi)))) for mm in pitches.tolist()]
            best = int(np.argmin(_left_mm(robot, tried, q, points_mm, _TURNS)))
            pitch_mm, step_mm = float(pitches[best]), step_mm / _PITCHES
        out.append(tried[best])
    return out


def _spread_rows(count: int, most: int) -> IndexArray:
    """At most so many row numbers, evenly spread over all."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


# ---- fits ----------------------------------------------------------------------------------------------------------


def _left_mm(robot: Robot, readings: Sequence[JointReading], q: Array, points_mm: Array, turns: int) -> Array:
    """What each reading leaves, mm: root mean square over the rows that agree best, at the best frame and tool."""
    parts = [
        _of_chunk(robot, readings[first : first + _CHUNK], q, points_mm, turns)[0]
        for first in range(0, len(readings), _CHUNK)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def _of_chunk(
    robot: Robot, readings: Sequence[JointReading], q: Array, points_mm: Array, turns: int
) -> tuple[Array, Array, Array]:
    """What K readings leave (K,), the tool point beyond the nominal one (K, 3), and distances (K, N); mm."""
    each = np.stack([reading.of(q) for reading in readings])
    count, rows, n = each.shape
    ends = forward(robot.table, each.reshape(-1, n), robot.is_revolute).base_T_frame[:, -1]
    place, attitude = ends[:, :3, 3].reshape(count, rows, 3), ends[:, :3, :3].reshape(count, rows, 3, 3)
    judged = max(int(np.ceil(_JUDGED * rows)), min(rows, FEWEST_POSES))
    floor_mm = _ROW_FLOOR * rms_length(points_mm - points_mm.mean(axis=0))
    eye = np.broadcast_to(np.eye(3), (count, rows, 3, 3))
    weight, tool_mm = np.ones((count, rows)), np.zeros((count, 3))
    best, best_tool, best_off = np.full(count, np.inf), tool_mm, np.zeros((count, rows))
    for _ in range(turns):
        mine = place + np.einsum("bnij,bj->bni", attitude, tool_mm)
        share = weight / weight.sum(axis=1, keepdims=True)
        middle, seen = np.einsum("bn,bni->bi", share, mine), share @ points_mm
        turn = nearest_rotation(
            np.einsum("bn,bni,bnj->bij", share, points_mm - seen[:, None], mine - middle[:, None], optimize=True)
        )
        turned = np.einsum("bij,bnj->bni", turn, mine - middle[:, None])
        off = points_mm - seen[:, None] - turned
        square = np.sum(off**2, axis=-1)
        ordered = np.sort(square, axis=1)[:, :judged]
        left = ordered.mean(axis=1)
        better = left < best
        best = np.where(better, left, best)
        best_tool = np.where(better[:, None], tool_mm, best_tool)
        best_off = np.where(better[:, None], np.sqrt(square), best_off)
        weight = 1.0 / (1.0 + square / (_CAUCHY * ordered[:, -1:] + floor_mm**2))
        columns = np.concatenate([-skew(turned), eye, turn[:, None] @ attitude], axis=-1)
        weighed = columns * weight[..., None, None]
        normal = np.einsum("bnki,bnkj->bij", weighed, columns, optimize=True) + _RIDGE * np.eye(9)
        step = np.linalg.solve(normal, np.einsum("bnki,bnk->bi", weighed, off)[..., None])[..., 0]
        tool_mm = np.clip(tool_mm + step[:, 6:], -_REACH_MM, _REACH_MM)
    return np.sqrt(best), best_tool, best_off
