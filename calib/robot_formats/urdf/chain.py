"""Serial arm in a URDF: the joints from a base link to a tip link, fixed ones joined, masses lumped.

Joints that follow others (<mimic>) become a matrix from commanded to joint values. A follower's value is multiplier x
its master's + offset; the offset goes into the joint's origin, and its own commanded value, what it does beyond that,
is 0."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, Vector
from calib.frames import apply, invert, make_transform, rotation_from_rotvec
from calib.rendering import numbers
from calib.robot_formats.chain.serial_chain import ChainJoint, SerialChain
from calib.robot_formats.urdf.safe_xml import XmlFile
from calib.robot_formats.urdf.tree import UrdfJoint, UrdfTree

_FLANGE = "tool0"  # end of the name of the link that ROS keeps for the controller's flange
_MOST_LISTED = 30  # names of links in a message
_LEAST_MULTIPLIER, _LARGEST_MULTIPLIER = 1e-3, 1e3  # of a multiplier; robot.toml takes a matrix that has an inverse


@dataclass(frozen=True)
class Following:
    """Dependence of a mimic joint's value on the commanded joint values, in the units of the file."""

    row: tuple[float, ...]  # (n,)
    offset: float
    joint_T_offset: Array  # (4, 4) the motion of the joint by its offset, mm
    words: str = ""  # for a follower


def followings(file: XmlFile, moving: Sequence[UrdfJoint]) -> tuple[Following, ...]:
    """Dependence of each mimic joint on others. Raises RobotFileError for cycles, mixed types, joints off the arm."""
    by_name = {joint.name: i for i, joint in enumerate(moving)}
    return tuple(_following(file, moving, by_name, i) for i in range(len(moving)))


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
        if at.multiplier and not _LEAST_MULTIPLIER <= abs(at.multiplier) <= _LARGEST_MULTIPLIER:
            file.fail(
                at.element,
                f"the multiplier of joint {at.name!r} is {at.multiplier:g}",
                f"one between {_LEAST_MULTIPLIER:g} and {_LARGEST_MULTIPLIER:g} is needed",
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


_GRAVITY_M_S2 = np.array([0.0, 0.0, -9.81])  # a URDF's root stands upright


@dataclass(frozen=True)
class ArmPath:
    """The joints of a URDF between a base link and a tip link."""

    tree: UrdfTree
    base: str
    tip: str
    joints: tuple[UrdfJoint, ...]  # all of them, fixed ones too, from the base on

    @property
    def moving(self) -> tuple[UrdfJoint, ...]:
        """The joints that are not fixed, in order."""
        return tuple(joint for joint in self.joints if joint.moves)

    @property
    def following(self) -> tuple[Following, ...]:
        """Dependence of the moving joints on each other. Raises RobotFileError where one follows a joint elsewhere."""
        return followings(self.tree.file, self.moving)


def find_arm(tree: UrdfTree, tip: str | None = None, base: str | None = None) -> ArmPath:
    """Find the arm from a base link (None: the root) to a tip link (None: the only one in the file).

    Raises RobotFileError in one sentence: several tips, unknown links, joints that no serial arm has.
    """
    file = tree.file
    for name in (tip, base):
        if name is not None and name not in tree.links:
            file.fail(file.root, f"there is no link {name!r}", f"the tips are {_listed(tip_links(tree))}")
    if tip is None:
        tips = tip_links(tree)
        if not tips:
            file.fail(file.root, "no joint moves", "a robot has one at least")
        if len(tips) > 1:
            file.fail(file.root, "several tips", f"choose one with --tip: {_listed([*_branches(tree), *tips])}")
        tip = before_jaw(tree, tips[0])
    joints: list[UrdfJoint] = []
    at = tip
    while at in tree.joint_of and at != base:
        joint = tree.joint_of[at]
        if len(joints) > len(tree.links):
            tree.file.fail(joint.element, f"joint {joint.name!r} is part of a loop", "only serial chains can be read")
        joints.append(joint)
        at = joint.parent
    if base is not None and at != base:
        file.fail(
            tree.joint_of[tip].element if tip in tree.joint_of else file.root,
            f"link {base!r} is not on the way from {at!r} to {tip!r}",
            "name another base",
        )
    arm = ArmPath(tree, at, tip, tuple(reversed(joints)))
    _refuse_unserial(arm)
    return arm


def chain_of_arm(arm: ArmPath) -> SerialChain:
    """Chain of an arm from the base link's frame to the tip link's frame."""
    joints: list[ChainJoint] = []
    notes: list[str] = []
    whole = tip_links(arm.tree)
    if len(whole) == 1 and arm.tip == before_jaw(arm.tree, whole[0]) != whole[0]:
        notes.append(f"the arm ends at {arm.tip}, before the jaw of its gripper; --tip {whole[0]} takes the jaw along")
    before = np.eye(4)
    last_T_flange: Array | None = None
    following = iter(arm.following)
    weighed = [inertial for inertial in arm.tree.links.values() if inertial is not None and inertial.mass_kg > 0.0]
    for joint in arm.joints:
        before = before @ joint.parent_T_joint
        if not joint.moves:
            last_T_flange = before if joint.child.endswith(_FLANGE) else last_T_flange
            continue
        last_T_flange = None
        mass_kg, com_mm = _lump(arm, joint.child) if weighed else (None, None)
        scale = 1e3 if joint.type == "prismatic" else 1.0
        follows = next(following)
        joints.append(
            ChainJoint(
                name=joint.name,
                before_T_joint=before @ follows.joint_T_offset,
                axis=joint.axis,
                type="prismatic" if joint.type == "prismatic" else "revolute",
                min=None if joint.low is None else (joint.low - follows.offset) * scale,
                max=None if joint.high is None else (joint.high - follows.offset) * scale,
                mass_kg=mass_kg,
                com_mm=com_mm,
            )
        )
        before = np.eye(4)
    notes += [follows.words for follows in arm.following if follows.words]
    massless = [joint.name for joint in joints if joint.mass_kg == 0.0]
    if massless:
        notes.append(f"the file gives no mass to what {', '.join(massless)} carries up to the next joint")
    beside = sorted({joint.name for joint in _beside(arm)})
    if beside:
        notes.append(f"joints beside the arm are taken at zero for their masses: {', '.join(beside)}")
    gravity, moving = _gravity_at(arm)
    if moving:
        notes.append(f"gravity at {arm.base} is that with {', '.join(moving)} at zero")
    return SerialChain(
        name=arm.tree.name,
        joints=tuple(joints),
        last_T_tip=before,
        gravity_m_s2=gravity,
        base=arm.base,
        tip=arm.tip,
        coupling=tuple(each.row for each in arm.following) if any(each.words for each in arm.following) else (),
        notes=tuple(notes),
        tip_T_flange=None if last_T_flange is None else invert(before) @ last_T_flange,
    )


_JAW = re.compile(r"jaw|finger|claw", re.IGNORECASE)
_GRIPS = re.compile(r"jaw|finger|claw|gripper(?!.*(base|rot|roll|turn|wrist))", re.IGNORECASE)


def tip_links(tree: UrdfTree) -> list[str]:
    """End links behind at least one moving joint, the links behind most moving joints first."""
    behind = {link: _moving_before(tree, link) for link, on in tree.joints_on.items() if not on}
    return sorted((link for link, count in behind.items() if count), key=lambda link: -behind[link])


def before_jaw(tree: UrdfTree, tip: str) -> str:
    """Link before a gripper's jaw that a way to a tip ends with; the tip where it ends with none."""
    at = tip
    while at in tree.joint_of and not tree.joint_of[at].moves:
        at = tree.joint_of[at].parent
    joint = tree.joint_of.get(at)
    if joint is None or not (_JAW.search(joint.child) or _GRIPS.search(joint.name)):
        return tip
    return joint.parent if _moving_before(tree, joint.parent) else tip


def _branches(tree: UrdfTree) -> list[str]:
    """Links behind a moving joint from which several ways lead on, as a wrist that carries two fingers."""
    return [link for link, on in tree.joints_on.items() if len(on) > 1 and _moving_before(tree, link)]


def _moving_before(tree: UrdfTree, link: str) -> int:
    count, steps = 0, 0
    while link in tree.joint_of and steps <= len(tree.links):
        count += tree.joint_of[link].moves
        link, steps = tree.joint_of[link].parent, steps + 1
    return count


def _listed(names: list[str]) -> str:
    return numbers.in_short(names, _MOST_LISTED) or "none"


def _refuse_unserial(arm: ArmPath) -> None:
    file = arm.tree.file
    for joint in arm.joints:
        if joint.type in ("floating", "planar"):
            file.fail(joint.element, f"joint {joint.name!r} is {joint.type}", "name a base behind it with --base")
    if not arm.moving:
        file.fail(
            file.root,
            f"no joint moves between {arm.base!r} and {arm.tip!r}",
            f"name another tip: {_listed(tip_links(arm.tree))}",
        )
    followings(file, arm.moving)


def carried_links(arm: ArmPath, link: str) -> Iterator[tuple[str, Array, UrdfJoint | None]]:
    """Links carried by a link up to the arm's next joints: name, transform in the first link's frame, joint."""
    of_arm = {joint.name for joint in arm.moving}
    waiting: list[tuple[str, Array, UrdfJoint | None]] = [(link, np.eye(4), None)]
    while waiting:
        name, place, by = waiting.pop()
        yield name, place, by
        waiting += [
            (joint.child, place @ joint.parent_T_joint, joint)
            for joint in arm.tree.joints_on[name]
            if joint.name not in of_arm
        ]


def _lump(arm: ArmPath, link: str) -> tuple[float, Vector]:
    """Mass and centre of mass, in the link's frame, of a link and all parts carried up to the arm's next joint."""
    mass_kg, moment = 0.0, np.zeros(3)
    for name, place, _ in carried_links(arm, link):
        inertial = arm.tree.links[name]
        if inertial is not None:
            mass_kg += inertial.mass_kg
            moment += inertial.mass_kg * apply(place, inertial.com_mm)
    x, y, z = map(float, moment / mass_kg if mass_kg > 0.0 else moment)
    return mass_kg, (x, y, z)


def _beside(arm: ArmPath) -> Iterator[UrdfJoint]:
    """Moving joints carried by the arm that are not part of the arm, such as a gripper's."""
    for joint in arm.moving:
        yield from (by for _, _, by in carried_links(arm, joint.child) if by is not None and by.moves)


def _gravity_at(arm: ArmPath) -> tuple[Vector, list[str]]:
    """Gravity, m/s^2, in the base link's frame, and the moving joints before that link, which are taken at zero."""
    moving: list[str] = []
    place, at = np.eye(4), arm.base
    while at in arm.tree.joint_of:
        joint = arm.tree.joint_of[at]
        place, at = joint.parent_T_joint @ place, joint.parent
        if joint.moves:
            moving.insert(0, joint.name)
    x, y, z = map(float, place[:3, :3].T @ _GRAVITY_M_S2)
    return (x, y, z), moving
