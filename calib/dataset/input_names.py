"""The names of what a residual may depend on, and the one place where such a name is taken apart.

q3 (a joint's position), torque3 (gravity's torque), approach3, q2+q3 and q2-q3, the conditions of poses.csv, x, y, z
and order, and any further column of poses.csv by its own name. A further column that is called like one of the others
(a column q1 beside q1_deg) is offered as "column q1", so that no column ever stands for what it is not.
"""

from __future__ import annotations

import re

from calib.dataset.dataset import Poses

OF_JOINTS = ("q", "torque", "approach")  # inputs that every joint has, its number behind the name
CONDITIONS = ("payload_kg", "temperature_c", "time_s")
PLACES = ("x", "y", "z")  # in the scanner's frame
ORDER = "order"
_NUMBER = "[1-9][0-9]{0,2}"  # as the project writes it: neither 01 nor a figure of another script
_OF_JOINT = re.compile(rf"({'|'.join(OF_JOINTS)})({_NUMBER})")
_SUM = re.compile(rf"q({_NUMBER})([+-])q({_NUMBER})")
_COLUMN = "column "


def joint_input(name: str) -> tuple[str, int] | None:
    """("torque", 3) for "torque4": one of `OF_JOINTS` and the joint, from 0; None for any other name."""
    found = _OF_JOINT.fullmatch(name)
    return None if found is None else (found[1], int(found[2]) - 1)


def quantity_of(name: str) -> str:
    """Which of `OF_JOINTS` an input is of; "" for any other name."""
    of_joint = joint_input(name)
    return "" if of_joint is None else of_joint[0]


def summed_joints(name: str) -> tuple[int, float, int] | None:
    """(1, -1.0, 2) for "q2-q3": two joints, from 0, and the sign of the second; None for any other name."""
    found = _SUM.fullmatch(name)
    return None if found is None else (int(found[1]) - 1, -1.0 if found[2] == "-" else 1.0, int(found[3]) - 1)


def column_input(column: str) -> str:
    """The input that a further column of poses.csv is: its own name, or "column q1" where that name has a meaning."""
    has_meaning = (
        joint_input(column) is not None
        or summed_joints(column) is not None
        or column in (*CONDITIONS, *PLACES, ORDER)
        or column.startswith(_COLUMN)
    )
    return f"{_COLUMN}{column}" if has_meaning else column


def further_inputs(poses: Poses) -> dict[str, str]:
    """The further columns of poses.csv by the name of the input that each is."""
    return {column_input(str(column)): str(column) for column in poses.extra.columns}
