"""Ways of an arm to planned poses, past obstacles and to sides of approach, and what a person does at some of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray
from calib.dataset.dataset import Poses
from calib.kinematics.robot import Robot
from calib.workcell.measurable import collides
from calib.workcell.order import clear_between, way_around
from calib.workcell.pose_conditions import come_from
from calib.workcell.workcell import Workcell


@dataclass(frozen=True)
class JointTarget:
    """A joint target with the user's name for it."""

    name: str
    q: Array  # (n,) rad or mm, as it is commanded


@dataclass(frozen=True)
class MeasuringStep:
    """A pose to measure, with the way to it from the pose before."""

    target: JointTarget
    way: tuple[JointTarget, ...] = ()  # points that the arm passes at rest, in this order
    ask: str = ""  # what a person has to do or look at before the arm moves; "": nothing


@dataclass(frozen=True)
class JointPath:
    """Straight pieces in joint space that lead to a pose from the one before."""

    vias: Array  # (k, n) points that lead past obstacles; (0, n) where the straight way is clear, or none was found
    starts_from: Array | None  # (n,) point before the pose, from which it is approached from the wanted sides
    clear: bool  # whether every piece avoids the known obstacles; to the first pose, those behind `starts_from` alone


def ways_to(cell: Workcell, poses: Poses) -> tuple[JointPath, ...]:
    """The way to each pose in the order of measuring, checked for collisions piece by piece."""
    q, starts = poses.q, None
    last = np.ones(len(q), dtype=bool)
    if poses.approach is not None:
        starts, last = _free_starts(cell, q, poses.approach)
    arrive = q if starts is None else starts
    straight = np.ones(len(q), dtype=bool)
    straight[1:] = clear_between(cell, q[:-1], arrive[1:])
    ways = []
    for k in range(len(q)):
        vias, clear = np.zeros((0, q.shape[1])), bool(straight[k])
        if not clear:
            around = way_around(cell, q[k - 1], arrive[k], np.random.default_rng(k))
            vias, clear = (vias, False) if around is None else (around, True)
        ways.append(JointPath(vias, None if starts is None else starts[k], clear and bool(last[k])))
    return tuple(ways)


def _free_starts(cell: Workcell, q: Array, approach: Array) -> tuple[Array, BoolArray]:
    """Points (N, n) from which poses are approached, as far away as obstacles allow, and whether these are free."""
    starts, free = q, np.zeros(len(q), dtype=bool)
    for share in _SHARES:
        nearer = come_from(q, approach, cell.robot.is_revolute, cell.low, cell.high, share=share)
        starts = np.where(free[:, None], starts, nearer)
        free = free | (~collides(cell, nearer) & clear_between(cell, nearer, q))
    return starts, free


_SHARES = (1.0, 0.6, 0.3)  # of the usual distance from which a pose is approached: 3 deg, 1.8 deg, 0.9 deg


def via_names(pose_id: str, way: JointPath) -> tuple[str, ...]:
    """Names of the points that the arm passes on the way to a pose, in their order."""
    vias = tuple(f"{pose_id}_via{k + 1}" for k in range(len(way.vias)))
    return vias if way.starts_from is None else (*vias, f"{pose_id}_from")


def passed(way: JointPath) -> Array:
    """Joints (k, n) of the points that the arm passes on a way, in their order."""
    return way.vias if way.starts_from is None else np.vstack([way.vias, way.starts_from])


def steps_of(robot: Robot, poses: Poses, ways: tuple[JointPath, ...]) -> list[MeasuringStep]:
    """Poses with their ways, as commanded, and what a person has to see to before each."""
    steps = []
    for k, (name, way) in enumerate(zip(poses.ids, ways, strict=True)):
        points = zip(via_names(name, way), robot.commands_of(passed(way)), strict=True)
        between = tuple(JointTarget(via, q) for via, q in points)
        ask = _conditions(poses, k)
        if k == 0:
            ask.append(f"The way to {name} from where the arm stands was not checked: see that it is free")
        target = JointTarget(name, robot.commands_of(poses.q[[k]])[0])
        steps.append(MeasuringStep(target, between, ". ".join(ask)))
    return steps


def _conditions(poses: Poses, k: int) -> list[str]:
    """What to change of the conditions before a pose."""
    columns: Mapping[str, Array | None] = {
        "payload_kg": poses.payload_kg,
        "temperature_c": poses.temperature_c,
        **{name: _numbers(column) for name, column in poses.extra.by_name.items()},
    }
    lines = []
    for name, values in columns.items():
        if values is None or not np.isfinite(values[k]) or (k and values[k] == values[k - 1]):
            continue
        if k == 0 and not (name == "payload_kg" or _varies(values)):
            continue
        lines.append(_PHRASES.get(name, "Set {name} to {value:g}").format(name=name, value=float(values[k])))
    return lines


_PHRASES = {
    "payload_kg": "The arm has to carry {value:g} kg",
    "temperature_c": "The arm is to be at {value:g} C, or as near as it gets",
}


def _varies(values: Array) -> bool:
    finite: BoolArray = np.isfinite(values)
    return bool(finite.any() and np.ptp(values[finite]) > 0.0)


def _numbers(values: object) -> Array | None:
    column = np.asarray(values)
    return column.astype(float) if column.dtype.kind in "iuf" else None
