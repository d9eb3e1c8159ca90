"""Names of the inputs that a residual may depend on, built and parsed in this module alone.

q3 (a joint's position), torque3 (gravity's torque), approach3, q2+q3 and q2-q3, the conditions of poses.csv, x, y, z
and order, and any further column of poses.csv by its own name. A further column whose name has one of these meanings
(a column q1 beside q1_deg) is the input "column q1". Of the way that a joint came: travel3 (from the pose before),
direction3 (its sign), previous3 (where it was), travelled3 (all of its way so far), crept3_200s and lagged3_200s (what
gravity's torque and its position were in the last 200 s), crept3_5poses.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from calib.dataset.dataset import Poses
from calib.kinematics.robot import Robot

OF_JOINTS = ("q", "torque", "approach")  # inputs that every joint has, its number behind the name
CONDITIONS: Mapping[str, tuple[float, float]] = {
    "payload_kg": (0.0, 1e5),
    "temperature_c": (-273.15, 5e3),
    "time_s": (-1e11, 1e11),
}
"""Fields of `Poses` with a value for each pose, of the same name in poses.csv, and their limits; values beyond are in
another unit, such as grams or milliseconds since 1970."""
PLACES = ("x", "y", "z")  # in the scanner's frame
ORDER = "order"
OF_HISTORY = ("travel", "direction", "previous", "travelled")  # inputs of the way that a joint came
OF_MEMORY = ("crept", "lagged")  # averages of the last time or poses: gravity's torque, the joint's position
_NUMBER = "[1-9][0-9]{0,2}"  # neither 01 nor digits of another script
_OF_JOINT = re.compile(rf"({'|'.join(OF_JOINTS)})({_NUMBER})")
_SUM = re.compile(rf"q({_NUMBER})([+-])q({_NUMBER})")
_HISTORY = re.compile(rf"({'|'.join(OF_HISTORY)})({_NUMBER})")
_MEMORY = re.compile(rf"({'|'.join(OF_MEMORY)})({_NUMBER})_([1-9][0-9]{{0,5}})(s|poses)")
_COLUMN = "column "


@dataclass(frozen=True)
class HistoryInput:
    """Input that follows from the way a joint came: what of it, the joint, and how far back it reaches."""

    quantity: str  # of OF_HISTORY or OF_MEMORY
    joint: int  # from 0
    reach: int = 0  # time constant of an average; 0 where there is none
    unit: str = ""  # of that: "s" or "poses"


def joint_input(name: str) -> tuple[str, int] | None:
    """Quantity and joint number, from 0, of a joint's input, ("torque", 3) for "torque4"; None for any other name."""
    match = _OF_JOINT.fullmatch(name)
    return None if match is None else (match[1], int(match[2]) - 1)


def quantity_of(name: str) -> str:
    """Quantity of a joint's input, "torque" for "torque4"; "" for any other name."""
    of_joint = joint_input(name)
    return "" if of_joint is None else of_joint[0]


def history_input(name: str) -> HistoryInput | None:
    """Parts of the name of an input of a joint's way, "travel3" or "crept2_200s"; None for any other name."""
    if (plain := _HISTORY.fullmatch(name)) is not None:
        return HistoryInput(plain[1], int(plain[2]) - 1)
    if (memory := _MEMORY.fullmatch(name)) is not None:
        return HistoryInput(memory[1], int(memory[2]) - 1, int(memory[3]), memory[4])
    return None


def summed_joints(name: str) -> tuple[int, float, int] | None:
    """Joints, from 0, and sign of a sum of two joints, (1, -1.0, 2) for "q2-q3"; None for any other name."""
    match = _SUM.fullmatch(name)
    return None if match is None else (int(match[1]) - 1, -1.0 if match[2] == "-" else 1.0, int(match[3]) - 1)


def column_input(column: str) -> str:
    """Input name of a further column of poses.csv: its own name, or "column q1" where that name has another meaning."""
    has_meaning = (
        joint_input(column) is not None
        or summed_joints(column) is not None
        or history_input(column) is not None
        or column in (*CONDITIONS, *PLACES, ORDER)
        or column.startswith(_COLUMN)
    )
    return f"{_COLUMN}{column}" if has_meaning else column


def further_inputs(poses: Poses) -> dict[str, str]:
    """Names of the further columns of poses.csv, by input name."""
    return {column_input(column): column for column in poses.extra.names}


def input_unit(name: str, robot: Robot) -> str:
    """Unit in which people read an input: deg, mm, Nm, C, s, kg; "" for a side, the order and a user's own column."""
    if (way := history_input(name)) is not None:
        of_joint = "deg" if robot.joints[way.joint].is_revolute else "mm"
        return {"direction": "", "crept": "Nm"}.get(way.quantity, of_joint)
    if (found := joint_input(name)) is not None:
        quantity, joint = found
        return {"q": "deg" if robot.joints[joint].is_revolute else "mm", "torque": "Nm"}.get(quantity, "")
    units = {"temperature_c": "C", "time_s": "s", "payload_kg": "kg", **dict.fromkeys(PLACES, "mm")}
    return units.get(name, "" if summed_joints(name) is None else "deg")  # sums are of angles only
