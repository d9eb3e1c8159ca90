"""What MoveIt's files tell of a URDF's arm: the chain of an SRDF's group, and limits of joints in a joint_limits.yaml.

A group is a chain (base_link, tip_link), or a list of joints or of links that lie on one way. Limits are
`has_position_limits`, `min_position` and `max_position` of each joint, rad or m, which replace those of the URDF.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from calib.robot_formats.chain.serial_chain import RobotFileError
from calib.robot_formats.origin_yaml import YamlFile, YamlNode, number_of, read_yaml
from calib.robot_formats.urdf.chain import ArmPath
from calib.robot_formats.urdf.safe_xml import Element, XmlFile
from calib.robot_formats.urdf.tree import UrdfTree

_NAMESPACE = "robot_description_planning"


@dataclass(frozen=True)
class Group:
    """A group of an SRDF that is one chain of the robot."""

    name: str
    base: str
    tip: str


def group_of(srdf: XmlFile, tree: UrdfTree, name: str | None = None) -> Group:
    """The group of a name, or the only one that is a chain of the robot. Raises RobotFileError."""
    if srdf.root.tag != "robot":
        srdf.fail(srdf.root, f"the file begins with <{srdf.root.tag[:40]}>", "an SRDF begins with <robot>")
    groups = chains(srdf, tree)
    if name is not None:
        groups = tuple(group for group in groups if group.name == name)
    if len(groups) == 1:
        return groups[0]
    known = ", ".join(group.name for group in chains(srdf, tree)) or "none"
    found = f"no group {name!r} is a chain" if name is not None else f"{len(groups)} groups are chains"
    srdf.fail(srdf.root, f"{found} of {tree.file.path.name}", f"name one as --srdf FILE#GROUP ({known})")


def chains(srdf: XmlFile, tree: UrdfTree) -> tuple[Group, ...]:
    """Groups of an SRDF that are one chain of the robot each, with joints that move."""
    found = []
    for element in srdf.root.all("group"):
        ends = _ends(element, tree)
        name = element.attributes.get("name", "")
        if name and ends is not None:
            found.append(Group(name, *ends))
    return tuple(found)


def _ends(group: Element, tree: UrdfTree) -> tuple[str, str] | None:
    """Base and tip link of a group; None where it is no single chain."""
    chain = group.first("chain")
    if chain is not None:
        base, tip = chain.attributes.get("base_link", ""), chain.attributes.get("tip_link", "")
        return (base, tip) if _way(tree, base, tip) else None
    joints = {each.attributes.get("name") for each in group.all("joint")}
    links = {each.attributes.get("name") for each in group.all("link")}
    of_group = [joint for joint in tree.joint_of.values() if joint.name in joints or joint.child in links]
    ways = ((first.parent, last.child) for first in of_group for last in of_group)
    return next((ends for ends in ways if {joint.name for joint in of_group} <= _way(tree, *ends)), None)


def _way(tree: UrdfTree, base: str, tip: str) -> set[str]:
    """Names of the joints from a base to a tip link, at least one of which moves; else none."""
    names: set[str] = set()
    moves, at = False, tip
    while at != base and at in tree.joint_of and len(names) < len(tree.links):
        joint = tree.joint_of[at]
        names.add(joint.name)
        moves |= joint.moves
        at = joint.parent
    return names if moves and at == base else set()


def with_limits(arm: ArmPath, path: Path) -> tuple[ArmPath, str]:
    """Arm with the limits of a joint_limits.yaml, and a note on whose they are. Raises RobotFileError."""
    file = read_yaml(path)
    top = file.root.children.get(_NAMESPACE, file.root)
    given = top.children.get("joint_limits", top).children
    joints, changed = [], []
    for joint in arm.joints:
        node = given.get(joint.name)
        low, high = (None, None) if node is None or not joint.moves else _limits(file, joint.name, node)
        if low is not None or high is not None:
            joint = replace(joint, low=joint.low if low is None else low, high=joint.high if high is None else high)
            changed.append(joint.name)
            if joint.low is not None and joint.high is not None and joint.low >= joint.high:
                file.fail(
                    node.line if node else 1, f"{joint.name} is from {joint.low:g} to {joint.high:g}", "turn them"
                )
        joints.append(joint)
    if not any(joint.name in given for joint in arm.moving):
        names = ", ".join(joint.name for joint in arm.moving)
        raise RobotFileError(f"{path}: line 1: found none of the arm's joints ({names}); name its joint_limits.yaml")
    words = f"limits of {', '.join(changed)} are those of {path.name}" if changed else f"{path.name} limits no position"
    return replace(arm, joints=tuple(joints)), words


def _limits(file: YamlFile, name: str, node: YamlNode) -> tuple[float | None, float | None]:
    has = node.children.get("has_position_limits")
    if has is not None and has.text.lower() in ("false", "no", "off"):
        return None, None
    ends: list[float | None] = []
    for key in ("min_position", "max_position"):
        at = node.children.get(key)
        ends.append(None if at is None else number_of(file, name, key, at))
    return ends[0], ends[1]
