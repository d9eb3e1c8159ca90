"""Names of the inputs that a residual may depend on, built and parsed in this module alone.

q3 (a joint's position), torque3 (gravity's torque), approach3, q2+q3 and q2-q3, the conditions of poses.csv, x, y, z
and order, and any further column of poses.csv by its own name. A further column whose name has one of these meanings
(a column q1 beside q1_deg) is the input "column q1".
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from calib.dataset.dataset import Poses

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
_NUMBER = "[1-9][0-9]{0,2}"  # neither 01 nor digits of another script
_OF_JOINT = re.compile(rf"({'|'.join(OF_JOINTS)})({_NUMBER})")
_SUM = re.compile(rf"q({_NUMBER})([+-])q({_NUMBER})")
_COLUMN = "column "


def joint_input(name: str) -> tuple[str, int] | None:
    """Quantity and joint number, from 0, of a joint's input, ("torque", 3) for "torque4"; None for any other name."""
    match = _OF_JOINT.fullmatch(name)
    return None if match is None else (match[1], int(match[2]) - 1)


def quantity_of(name: str) -> str:
    """Quantity of a joint's input, "torque" for "torque4"; "" for any other name."""
    of_joint = joint_input(name)
    return "" if of_joint is None else of_joint[0]


def summed_joints(name: str) -> tuple[int, float, int] | None:
    """Joints, from 0, and sign of a sum of two joints, (1, -1.0, 2) for "q2-q3"; None for any other name."""
    match = _SUM.fullmatch(name)
    return None if match is None else (int(match[1]) - 1, -1.0 if match[2] == "-" else 1.0, int(match[3]) - 1)


def column_input(column: str) -> str:
    """Input name of a further column of poses.csv: its own name, or "column q1" where that name has another meaning."""
    has_meaning = (
        joint_input(column) is not None
        or summed_joints(column) is not None
        or column in (*CONDITIONS, *PLACES, ORDER)
        or column.startswith(_COLUMN)
    )
    return f"{_COLUMN}{column}" if has_meaning else column


def further_inputs(poses: Poses) -> dict[str, str]:
    """Names of the further columns of poses.csv, by input name."""
    return {column_input(column): column for column in poses.extra.names}
