"""Joints that follow others of the same arm (<mimic>): a matrix from what is commanded to joint values, and offsets.

A follower's value is multiplier x its master's + offset. The offset goes into the place of the joint; what is commanded
of the follower itself is what it does beyond that: 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.frames import make_transform, rotation_from_rotvec
from calib.robot_formats.urdf.safe_xml import XmlFile
from calib.robot_formats.urdf.tree import UrdfJoint

_LEAST, _MOST = 1e-3, 1e3  # of a multiplier; robot.toml takes a matrix that has an inverse


@dataclass(frozen=True)
class Following:
    """How a joint's value follows from the commanded ones, in the units of the file."""

    row: tuple[float, ...]  # (n,)
    offset: float
    joint_T_offset: Array  # (4, 4) the motion of the joint by its offset, mm
    words: str = ""  # for a follower


def followings(file: XmlFile, moving: Sequence[UrdfJoint]) -> tuple[Following, ...]:
    """How each joint follows others. Raises RobotFileError: a master beside the arm, a circle, unlike kinds."""
    by_name = {joint.name: i for i, joint in enumerate(moving)}
    return tuple(_following(file, moving, by_name, i) for i in range(len(moving)))


def coupling_of(following: Sequence[Following]) -> tuple[tuple[float, ...], ...]:
    """(n, n) joint values by commanded ones; () where no joint follows another."""
    return tuple(each.row for each in following) if any(each.words for each in following) else ()


def _following(file: XmlFile, moving: Sequence[UrdfJoint], by_name: dict[str, int], i: int) -> Following:
    row, offset, factor, at, seen = np.zeros(len(moving)), 0.0, 1.0, moving[i], {i}
    row[i] = 1.0
    while at.mimics is not None:
        master = by_name.get(at.mimics)
        if master is None:
            file.fail(
                at.element,
                f"joint {at.name!r} mimics {at.mimics!r}, which is no joint between the base and the tip",
                "name a tip before it, or a base before its master",
            )
        if master in seen:
            file.fail(at.element, f"joint {at.name!r} mimics itself by way of others", "command one of them")
        seen.add(master)
        if (at.type == "prismatic") != (moving[master].type == "prismatic"):
            file.fail(
                at.element,
                f"joint {at.name!r} mimics {at.mimics!r}, one of which turns and one slides",
                "only joints of one kind can be coupled in robot.toml",
            )
        if at.multiplier and not _LEAST <= abs(at.multiplier) <= _MOST:
            file.fail(
                at.element,
                f"the multiplier of joint {at.name!r} is {at.multiplier:g}",
                f"one between {_LEAST:g} and {_MOST:g} is needed",
            )
        offset += factor * at.offset
        factor *= at.multiplier
        row[master] = factor
        at = moving[master]
    joint = moving[i]
    return Following(tuple(map(float, row)), offset, _motion(joint, offset), _words(joint))


def _words(joint: UrdfJoint) -> str:
    if joint.mimics is None:
        return ""
    return (
        f"joint {joint.name} follows {joint.mimics} ({joint.multiplier:g} x its value + {joint.offset:g}), by "
        "`coupling` of robot.toml: its own column in poses.csv is what it does beyond that, 0"
    )


def _motion(joint: UrdfJoint, value: float) -> Array:
    along = value * np.array(joint.axis)
    if joint.type == "prismatic":
        return make_transform(np.eye(3), 1e3 * along)
    return make_transform(rotation_from_rotvec(along), np.zeros(3))
