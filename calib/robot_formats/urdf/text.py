"""Writing of URDF: the user's own text with changed origins, every other byte unchanged, or a new plain file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np

from calib.array_types import Array, Vector
from calib.frames import invert, make_transform, rpy_from_rotation
from calib.robot_formats.chain.serial_chain import ChainJoint, RobotFileError, SerialChain, axis_frame
from calib.robot_formats.urdf.chain import ArmPath
from calib.robot_formats.urdf.safe_xml import Element
from calib.robot_formats.urdf.tree import UrdfJoint

TOOL_POINT_LINK = "tool_point"
"""The link that holds the measured point of the tool, where that is not the tip itself; its axes are the tip's."""
GYRATION_M = 0.05  # robot.toml has no inertias, readers of URDF ask for some; gravity and places do not depend on it
_SAME = 5e-13  # m or rad: what degrees in 15 digits and products of transforms may lose
_TAG_END = re.compile(rb"""(?:[^"'>]|"[^"]*"|'[^']*')*?(/?)>""")


@dataclass(frozen=True)
class UrdfText:
    """New text of a URDF, with the changed joints."""

    content: bytes
    changed: tuple[str, ...]  # joints with another origin than before
    tip_written: bool  # False: no fixed joint holds the tip, so its place cannot be told


def with_origins(arm: ArmPath, chain: SerialChain, comment: str = "") -> UrdfText:
    """Text of the arm's file with the origins of a chain of the same joints; fixed joints keep theirs.

    Each joint that moves takes its own change; the tip's goes into the last fixed joint before it. A measured point of
    its own becomes a link on the tip. If an origin changes, the comment is put behind the first
    line of <robot>.
    """
    wanted = iter([*(joint.before_T_joint for joint in chain.joints), chain.last_T_tip])
    edits: list[tuple[int, int, bytes]] = []
    changed: list[str] = []
    fixed: list[UrdfJoint] = []
    following = iter(arm.following)
    for joint in arm.joints:
        if joint.moves:
            before = _product(fixed)
            fixed = []
            place = next(wanted) @ invert(next(following).joint_T_offset)
            edits += _edit(arm, joint, invert(before) @ place, changed)
        else:
            fixed.append(joint)
    last = next(wanted)
    tip_written = True
    if fixed:
        edits += _edit(arm, fixed[-1], invert(_product(fixed[:-1])) @ last, changed)
    else:
        tip_written = bool(np.abs(last - np.eye(4)).max() < 1e-9)
    content = arm.tree.file.content
    added = ""
    if changed and comment:
        words = comment.replace("--", "- -").rstrip("-")
        added = f"\n  <!-- {words} -->"
    if chain.tool_point_mm is not None:
        place = make_transform(np.eye(3), chain.tool_point_mm)
        standing = arm.tree.joint_of.get(TOOL_POINT_LINK)
        if standing is not None and standing.parent == arm.tip and not standing.moves:
            edits += _edit(arm, standing, place, changed)
        else:
            names = {*arm.tree.links, *(joint.name for joint in arm.tree.joint_of.values())}
            added += "".join(f"\n{line}" for line in _tool_point_lines(arm.tip, place, names))
    if added:
        end = _tag_end(content, arm.tree.file.root.start)
        edits.append((end, end, added.encode()))
    for start, end, new in sorted(edits, reverse=True):
        content = content[:start] + new + content[end:]
    return UrdfText(content, tuple(changed), tip_written)


def _product(joints: list[UrdfJoint]) -> Array:
    out = np.eye(4)
    for joint in joints:
        out = out @ joint.parent_T_joint
    return out


def _edit(arm: ArmPath, joint: UrdfJoint, parent_T_joint: Array, changed: list[str]) -> list[tuple[int, int, bytes]]:
    """Replacements (start, end, new bytes) in the file's bytes for another origin; none where it is the same."""
    new = {}
    if np.abs(parent_T_joint[:3, 3] - joint.parent_T_joint[:3, 3]).max() > 1e3 * _SAME:
        new["xyz"] = numbers(1e-3 * parent_T_joint[:3, 3])
    if np.abs(parent_T_joint[:3, :3] - joint.parent_T_joint[:3, :3]).max() > _SAME:
        new["rpy"] = numbers(rpy_from_rotation(parent_T_joint[:3, :3]))
    if not new:
        return []
    changed.append(joint.name)
    content, origin = arm.tree.file.content, joint.element.first("origin")
    if origin is None:
        return [_inserted(content, joint.element, new)]
    start, end = origin.start, _tag_end(content, origin.start)
    tag = content[start:end]
    for key, value in new.items():
        tag = _with_attribute(tag, key, value)
    return [(start, end, tag)]


def _inserted(content: bytes, element: Element, new: dict[str, str]) -> tuple[int, int, bytes]:
    """Insertion of an <origin> behind the joint's start tag, indented like the next element."""
    end = _tag_end(content, element.start)
    space = re.match(rb"\s*", content[end:])
    attributes = "".join(f' {key}="{value}"' for key, value in new.items())
    return end, end, (space.group() if space else b"") + f"<origin{attributes}/>".encode()


def _with_attribute(tag: bytes, key: str, value: str) -> bytes:
    """Start tag with a new value of an attribute, which is added where it is missing."""
    found = re.search(rb"\s" + key.encode() + rb"""\s*=\s*("[^"]*"|'[^']*')""", tag)
    if found:
        return tag[: found.start(1)] + f'"{value}"'.encode() + tag[found.end(1) :]
    name = re.match(rb"<[^\s/>]+", tag)
    assert name is not None
    return tag[: name.end()] + f' {key}="{value}"'.encode() + tag[name.end() :]


def _tag_end(content: bytes, start: int) -> int:
    """End position of the start tag that begins at `start`."""
    found = _TAG_END.match(content, start)
    assert found is not None, "expat has read this tag"
    return found.end()


def numbers(values: Array) -> str:
    """Numbers as text, in the fewest digits that read back to the same bits."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def plain_urdf(chain: SerialChain) -> str:
    """A URDF with the chain's links and joints only. Raises RobotFileError where names would be the same."""
    names = [joint.name for joint in chain.joints]
    base, tip = chain.base or "base_link", chain.tip or "tool0"
    links = [f"{name}_link" for name in names]
    if len({*names, "tool_fixed"}) <= len(names) or len({base, tip, *links}) < len(links) + 2:
        raise RobotFileError(f"robot {chain.name}: its joints have the same names; a URDF needs one for each")
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(chain.name)}>"]
    stands = standing(chain)
    if stands is not None:  # a URDF's root is upright
        if "world" in (base, tip, *links) or "world_fixed" in names:
            raise RobotFileError(f"robot {chain.name}: has a link world of its own, which its leaning base would need")
        lines.append('  <link name="world"/>')
    lines.append(f"  <link name={quoteattr(base)}/>")
    for joint, link in zip(chain.joints, links, strict=True):
        lines += _link(link, joint.mass_kg, joint.com_mm)
    lines.append(f"  <link name={quoteattr(tip)}/>")
    if stands is not None:
        lines += [*_joint_lines("world_fixed", "fixed", "world", base, stands), "  </joint>"]
    before = base
    for joint, link in zip(chain.joints, links, strict=True):
        scale = 1.0 if joint.is_revolute else 1e-3
        bounded = joint.min is not None and joint.max is not None
        kind = joint.type if bounded or not joint.is_revolute else "continuous"
        lines += _joint_lines(joint.name, kind, before, link, joint.before_T_joint)
        lines.append(f'    <axis xyz="{numbers(np.array(joint.axis))}"/>')
        if joint.min is not None and joint.max is not None:
            low, high = scale * joint.min, scale * joint.max
            lines.append(f'    <limit lower="{low!r}" upper="{high!r}" effort="0" velocity="0"/>')
        lines.append("  </joint>")
        before = link
    lines += [*_joint_lines("tool_fixed", "fixed", before, tip, chain.last_T_tip), "  </joint>"]
    if chain.tool_point_mm is not None:
        taken = {*names, *links, base, tip}
        lines += _tool_point_lines(tip, make_transform(np.eye(3), chain.tool_point_mm), taken)
    lines += ["</robot>", ""]
    return "\n".join(lines)


def standing(chain: SerialChain) -> Array | None:
    """Pose world_T_base (4, 4) in a world with gravity along -z; None where the base is upright or has no gravity."""
    down = np.array(chain.gravity_m_s2)
    if not down.any() or (down[2] < 0.0 and not down[:2].any()):
        return None
    frame = axis_frame(ChainJoint("", np.eye(4), _unit(-down)))  # its z axis points up, in the base's frame
    return invert(frame)


def _unit(vector: Array) -> Vector:
    x, y, z = map(float, vector / np.linalg.norm(vector))
    return (x, y, z)


def _link(name: str, mass_kg: float | None, com_mm: Vector | None) -> list[str]:
    if not mass_kg or com_mm is None:
        return [f"  <link name={quoteattr(name)}/>"]
    inertia = mass_kg * GYRATION_M**2
    return [
        f"  <link name={quoteattr(name)}>",
        "    <inertial>",
        f'      <origin xyz="{numbers(1e-3 * np.array(com_mm))}"/>',
        f'      <mass value="{mass_kg!r}"/>',
        f'      <inertia ixx="{inertia!r}" ixy="0" ixz="0" iyy="{inertia!r}" iyz="0" izz="{inertia!r}"/>',
        "    </inertial>",
        "  </link>",
    ]


def _tool_point_lines(tip: str, place: Array, taken: set[str]) -> list[str]:
    """URDF lines of a link on the tip at the measured point, under names that are not taken yet."""
    names = [TOOL_POINT_LINK, *(f"{TOOL_POINT_LINK}_{k}" for k in range(2, len(taken) + 3))]
    link = next(name for name in names if name not in taken and f"{name}_fixed" not in taken)
    return [
        f"  <link name={quoteattr(link)}/>",
        *_joint_lines(f"{link}_fixed", "fixed", tip, link, place),
        "  </joint>",
    ]


def _joint_lines(name: str, kind: str, parent: str, child: str, origin: Array) -> list[str]:
    xyz, rpy = numbers(1e-3 * origin[:3, 3]), numbers(rpy_from_rotation(origin[:3, :3]))
    return [
        f"  <joint name={quoteattr(name)} type={quoteattr(kind)}>",
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>',
        f"    <parent link={quoteattr(parent)}/>",
        f"    <child link={quoteattr(child)}/>",
    ]
