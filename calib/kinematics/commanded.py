"""Commanded values in words: what the columns of a user's files are, by the joints of the arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.array_types import Array, BoolArray
from calib.kinematics.robot import Robot

_NONE = 1e-9  # of a joint, or of a zero in deg and mm


def commands_in_words(robot: Robot, names: Sequence[str] = ()) -> tuple[str, ...]:
    """What each commanded value is that is not its joint's own: "J3 of the table is J3 - J2 of the robot".

    names: (n,) of the table's columns; J1, J2 ... where empty.
    """
    by_joint = np.linalg.inv(np.array(robot.coupling)) if robot.coupling else np.eye(robot.n_joints)
    told = sums_in_words(by_joint, robot.is_revolute, -by_joint @ robot.zeros)
    names = names or [f"J{k + 1}" for k in range(robot.n_joints)]
    return tuple(
        f"{names[k]} of the table is {text} of the robot" for k, text in enumerate(told) if text != f"J{k + 1}"
    )


def sums_in_words(shares: Array, turns: BoolArray, constants: Array | None = None, letter: str = "J") -> list[str]:
    """Sums of joints, such as "J3 - J2" or "-J4 + 90 deg", of shares (n, n) by rows and constants (n,), rad or mm.

    A row's own joint comes first. A slide's share of an angle, mm per rad, is told in mm a turn.
    """
    out = []
    for k, row in enumerate(shares):
        terms = []
        for j in sorted(range(len(row)), key=lambda j: (j != k, j)):
            share, name = row[j], f"{letter}{j + 1}"
            if turns[j] and not turns[k]:
                share, name = 2.0 * np.pi * share, f"mm a turn of {name}"
            if abs(share) > _NONE:
                terms.append((share, name if abs(abs(share) - 1.0) < _NONE else f"{abs(share):.4g} {name}"))
        if constants is not None and abs(constants[k]) > _NONE:
            size, unit = (np.degrees(constants[k]), "deg") if turns[k] else (constants[k], "mm")
            terms.append((size, f"{abs(size):.4g} {unit}"))
        (first, text), *further = terms
        signed = [f" {'-' if share < 0.0 else '+'} {words}" for share, words in further]
        out.append(f"{'-' if first < 0.0 else ''}{text}{''.join(signed)}")
    return out
