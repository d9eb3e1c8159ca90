"""Gazebo's SDFormat (.sdf): read as the tree of links and joints that a URDF is, and written as a new plain file.

Poses are `x y z roll pitch yaw` in metres and radians about fixed axes. A link's pose is relative to the model unless
`relative_to` names another frame; a joint's is relative to its child. Source: sdformat.org, specification 1.4 to 1.11,
"Pose frame semantics".
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from calib.array_types import Array
from calib.frames import invert, make_transform, rotation_from_rpy, rpy_from_rotation
from calib.kinematics.robot import Vector
from calib.robot_formats.chain.serial_chain import RobotFileError, SerialChain
from calib.robot_formats.urdf.safe_xml import Element, XmlFile
from calib.robot_formats.urdf.text import GYRATION_M, numbers, standing
from calib.robot_formats.urdf.tree import Inertial, UrdfJoint, UrdfTree

_MODEL, _WORLD = "__model__", "world"
_MOVING = ("revolute", "continuous", "prismatic")
_FIXED = "fixed"
_MOST = 1e6  # of any number
_NO_LIMIT = 1e3  # rad or m
_SAME = 1e-9  # mm or of a rotation's entries: two frames that are one
_TAG = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*?(/?)>""")
_COMMENT = re.compile(rb"\s*<!--.*?-->", re.DOTALL)


def tree_of_sdf(file: XmlFile) -> UrdfTree:
    """Links and joints of the first model of an SDF. Raises RobotFileError in one line with file, line and name."""
    return _Reader(file).tree()


@dataclass
class _Reader:
    """A model with the poses of its frames, each resolved when it is asked for."""

    file: XmlFile
    elements: dict[str, Element] = field(default_factory=dict)  # links, joints and frames, by name
    poses: dict[str, Array] = field(default_factory=dict)  # model_T_frame, mm

    def __post_init__(self) -> None:
        root = self.file.root
        self.version = _version(root.attributes.get("version", "1.7"))
        holder = root.first("world") or root
        model = root if root.tag == "model" else holder.first("model")
        if model is None:
            self.file.fail(root, "the file has no <model>", "an SDF of a robot has one")
        self.model = model
        if model.first("include") is not None or model.first("model") is not None:
            self.file.fail(
                model, "the model includes or nests another", "give that one itself, or `gz sdf -p FILE > FLAT.sdf`"
            )
        for tag in ("link", "joint", "frame"):
            for element in model.all(tag):
                name = element.attributes.get("name", "").strip()
                if not name or name in (_MODEL, _WORLD):
                    self.file.fail(element, f"a <{tag}> has no name of its own", 'add name="..."')
                if name in self.elements:
                    self.file.fail(element, f"{name!r} stands there twice", "rename one")
                self.elements[name] = element
        self.poses[_MODEL] = np.eye(4)
        self.poses[_WORLD] = invert(self._own_pose(model))

    def tree(self) -> UrdfTree:
        """The model as a tree; a link that does not stand in the model's origin hangs on a link of the model."""
        links: dict[str, Inertial | None] = {
            name: self._inertial(name, element) for name, element in self.elements.items() if element.tag == "link"
        }
        if not links:
            self.file.fail(self.model, "the model has no <link>", "an SDF has a link for each body")
        joints = []
        for name, each in self.elements.items():
            if each.tag == "joint":
                found, between = self._joint(name, each, links)
                joints += found
                links |= dict.fromkeys(between)
        joint_of: dict[str, UrdfJoint] = {}
        for joint in joints:
            if joint.child in joint_of:
                self.file.fail(
                    joint.element, f"link {joint.child!r} hangs on two joints: a loop", "only serial chains can be read"
                )
            joint_of[joint.child] = joint
        if any(joint.parent == _WORLD for joint in joints):
            links[_WORLD] = None
        root = self._root(links, joints)
        if root != _WORLD and np.abs(invert(self.poses[_WORLD]) @ self._pose(root, ()) - np.eye(4)).max() > 1e-12:
            standing_on = "world_fixed" if "world_fixed" not in self.elements else "world_fixed_"
            links[_WORLD] = None
            place = invert(self.poses[_WORLD]) @ self._pose(root, ())
            fixed = _tree_joint(standing_on, _FIXED, _WORLD, root, place, self.model)
            joints.append(fixed)
            joint_of[root] = fixed
            root = _WORLD
        on = {name: tuple(joint for joint in joints if joint.parent == name) for name in links}
        name = self.model.attributes.get("name") or self.file.path.stem
        return UrdfTree(self.file, " ".join(name.split()), links, joint_of, on, root)

    def _root(self, links: dict[str, Inertial | None], joints: list[UrdfJoint]) -> str:
        """Link without a joint before it that carries most links."""
        on: dict[str, list[str]] = {}
        for joint in joints:
            on.setdefault(joint.parent, []).append(joint.child)
        children = {joint.child for joint in joints}
        roots = [name for name in links if name not in children]
        if not roots:
            self.file.fail(self.model, "no link is the root: the joints close a loop", "only serial chains can be read")

        def below(link: str) -> int:
            waiting, count = [link], 0
            while waiting:
                count += 1
                waiting += on.get(waiting.pop(), [])
            return count

        return max(roots, key=below)

    def _joint(
        self, name: str, element: Element, links: dict[str, Inertial | None]
    ) -> tuple[list[UrdfJoint], list[str]]:
        """Joint of the tree; where the child's frame is not the joint's, with a link between and a fixed joint."""
        kind = element.attributes.get("type", "").strip()
        if kind not in (*_MOVING, _FIXED):
            expected = f"expected {', '.join((*_MOVING, _FIXED))}"
            self.file.fail(element, f"joint {name!r} is of type {kind[:40]!r}", expected)
        parent, child = (self._end(element, name, tag, links) for tag in ("parent", "child"))
        model_T_joint = self._pose(name, ())
        axis, low, high = self._axis(name, element, kind, model_T_joint)
        parent_T_joint = invert(self._pose(parent, ())) @ model_T_joint
        joint_T_child = invert(model_T_joint) @ self._pose(child, ())
        if np.abs(joint_T_child - np.eye(4)).max() <= _SAME:
            return [_tree_joint(name, kind, parent, child, parent_T_joint, element, axis, low, high)], []
        between = f"{name}__frame"
        moving = _tree_joint(name, kind, parent, between, parent_T_joint, element, axis, low, high)
        return [moving, _tree_joint(f"{name}__fixed", _FIXED, between, child, joint_T_child, element)], [between]

    def _end(self, element: Element, name: str, tag: str, links: dict[str, Inertial | None]) -> str:
        end = element.first(tag)
        link = "" if end is None else self._text(end)
        if link not in links and not (tag == "parent" and link == _WORLD):
            self.file.fail(element, f"the <{tag}> of joint {name!r} is {link[:40]!r}, which is no link", "name a link")
        return link

    def _axis(
        self, name: str, element: Element, kind: str, model_T_joint: Array
    ) -> tuple[Vector, float | None, float | None]:
        axis = element.first("axis")
        if kind == _FIXED:
            return (1.0, 0.0, 0.0), None, None
        if axis is None:
            self.file.fail(element, f"joint {name!r} has no <axis>", "add <axis><xyz>0 0 1</xyz></axis>")
        xyz = axis.first("xyz")
        direction = np.array([0.0, 0.0, 1.0]) if xyz is None else self._numbers(xyz, 3, f"the axis of joint {name!r}")
        within = "" if xyz is None else xyz.attributes.get("expressed_in", "").strip()
        in_model = axis.first("use_parent_model_frame")
        if within:
            direction = model_T_joint[:3, :3].T @ self._pose(within, ())[:3, :3] @ direction
        elif (in_model is not None and self._text(in_model) in ("1", "true")) or self.version < (1, 5):
            direction = model_T_joint[:3, :3].T @ direction
        length = float(np.linalg.norm(direction))
        if length < 1e-6:
            self.file.fail(axis, f"the axis of joint {name!r} has no direction", "give one, such as 0 0 1")
        x, y, z = map(float, direction / length)
        limit, ends = axis.first("limit"), []
        for tag in ("lower", "upper"):
            end = None if limit is None else limit.first(tag)
            ends.append(
                math.inf if end is None else float(self._numbers(end, 1, f"the limit of joint {name!r}", 1e308)[0])
            )
        is_bounded = kind != "continuous" and ends[0] < ends[1] and max(map(abs, ends)) <= _NO_LIMIT
        return (x, y, z), (ends[0] if is_bounded else None), (ends[1] if is_bounded else None)

    def _inertial(self, name: str, element: Element) -> Inertial | None:
        """Mass of a link with its centre in the link's frame."""
        inertial = element.first("inertial")
        mass = None if inertial is None else inertial.first("mass")
        if inertial is None or mass is None:
            return None
        mass_kg = float(self._numbers(mass, 1, f"the mass of link {name!r}")[0])
        if mass_kg < 0.0:
            self.file.fail(mass, f"link {name!r} weighs {mass_kg:g} kg", "a mass is 0 or more")
        x, y, z = map(float, self._own_pose(inertial)[:3, 3])
        return Inertial(mass_kg, (x, y, z))

    def _pose(self, name: str, waiting: tuple[str, ...]) -> Array:
        """Pose model_T_frame (4, 4), mm, of a link, joint or frame; RobotFileError for unknown names and circles."""
        if name in self.poses:
            return self.poses[name]
        element = self.elements.get(name)
        if element is None:
            self.file.fail(self.model, f"there is no frame {name[:40]!r}", "name a link, a joint or a frame")
        if name in waiting:
            self.file.fail(element, f"the pose of {name!r} depends on itself", "give it relative to another frame")
        own = element.first("pose")
        relative = "" if own is None else own.attributes.get("relative_to", own.attributes.get("frame", "")).strip()
        if not relative and element.tag == "frame":
            relative = element.attributes.get("attached_to", "").strip()
        if not relative and element.tag == "joint":
            child = element.first("child")
            relative = "" if child is None else self._text(child)
        self.poses[name] = self._pose(relative or _MODEL, (*waiting, name)) @ self._own_pose(element)
        return self.poses[name]

    def _own_pose(self, element: Element) -> Array:
        """Transform (4, 4), mm, of an element's <pose>; the identity where there is none."""
        pose = element.first("pose")
        if pose is None or not self._text(pose):
            return np.eye(4)
        form = pose.attributes.get("rotation_format", "euler_rpy")
        if form == "quat_xyzw":
            values = self._numbers(pose, 7, "a <pose>")
            x, y, z, w = values[3:] / np.linalg.norm(values[3:])
            turn = np.array([
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ])  # fmt: skip
            return make_transform(turn, 1e3 * values[:3])
        values = self._numbers(pose, 6, "a <pose>")
        angles = np.radians(values[3:]) if pose.attributes.get("degrees") in ("1", "true") else values[3:]
        return make_transform(rotation_from_rpy(angles), 1e3 * values[:3])

    def _numbers(self, element: Element, count: int, what: str, most: float = _MOST) -> Array:
        text = self._text(element)
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = []
        is_endless = most > _MOST and all(map(math.isinf, values))  # as a joint without limits has them
        if "_" in text or len(values) != count or not (is_endless or all(abs(value) <= most for value in values)):
            self.file.fail(element, f"{what} is {text[:60]!r}", f"{count} numbers of at most {most:g} are needed")
        return np.array(values)

    def _text(self, element: Element) -> str:
        """Text of an element before its first child, without comments."""
        content = self.file.content
        tag = _TAG.match(content, element.start)
        if tag is None or tag[1]:
            return ""
        at = tag.end()
        while (comment := _COMMENT.match(content, at)) is not None:
            at = comment.end()
        return " ".join(content[at : content.find(b"<", at)].decode("utf-8", "replace").split())


def _tree_joint(
    name: str, kind: str, parent: str, child: str, place: Array, element: Element,
    axis: Vector = (1.0, 0.0, 0.0), low: float | None = None, high: float | None = None,
) -> UrdfJoint:  # fmt: skip
    return UrdfJoint(name, kind, parent, child, place, axis, low, high, None, 1.0, 0.0, element)


def _version(text: str) -> tuple[int, int]:
    found = re.match(r"(\d+)\.(\d+)", text.strip())
    return (int(found[1]), int(found[2])) if found else (1, 7)


def plain_sdf(chain: SerialChain) -> str:
    """An SDF model of the chain's links and joints. Raises RobotFileError where names would be the same."""
    names = [joint.name for joint in chain.joints]
    base, tip = chain.base or "base_link", chain.tip or "tool0"
    links = [f"{name}_link" for name in names]
    taken = [*names, *links, base, tip, "tool_fixed"]
    if len(set(taken)) < len(taken):
        raise RobotFileError(f"robot {chain.name}: its joints have the same names; an SDF needs one for each")
    stands = standing(chain)
    lines = ['<?xml version="1.0"?>', '<sdf version="1.9">', f"  <model name={quoteattr(chain.name)}>"]
    if stands is not None:
        lines.append(f"    <pose>{_pose_text(stands)}</pose>")
    lines.append(f"    <link name={quoteattr(base)}/>")
    before = base
    for joint, link in zip(chain.joints, links, strict=True):
        lines += [f"    <link name={quoteattr(link)}>", f"      <pose relative_to={quoteattr(joint.name)}/>"]
        if joint.mass_kg and joint.com_mm is not None:
            inertia = joint.mass_kg * GYRATION_M**2
            com = numbers(1e-3 * np.array(joint.com_mm))
            moments = "".join(f"<{axis}>{inertia!r}</{axis}>" for axis in ("ixx", "iyy", "izz"))
            lines.append(f"      <inertial><pose>{com} 0 0 0</pose><mass>{joint.mass_kg!r}</mass>")
            lines.append(f"        <inertia>{moments}</inertia></inertial>")
        lines.append("    </link>")
        lines += _joint_lines(joint.name, joint.type, before, link, joint.before_T_joint)
        lines.append(f"      <axis><xyz>{numbers(np.array(joint.axis))}</xyz>")
        if joint.min is not None and joint.max is not None:
            scale = 1.0 if joint.is_revolute else 1e-3
            low, high = scale * joint.min, scale * joint.max
            lines.append(f"        <limit><lower>{low!r}</lower><upper>{high!r}</upper></limit>")
        lines += ["      </axis>", "    </joint>"]
        before = link
    ends = [("tool_fixed", before, tip, chain.last_T_tip)]
    if chain.tool_point_mm is not None:
        ends.append(("tool_point_fixed", tip, "tool_point", make_transform(np.eye(3), chain.tool_point_mm)))
    for name, parent, child, place in ends:
        lines += [f"    <link name={quoteattr(child)}>", f"      <pose relative_to={quoteattr(name)}/>", "    </link>"]
        lines += [*_joint_lines(name, _FIXED, parent, child, place), "    </joint>"]
    return "\n".join([*lines, "  </model>", "</sdf>", ""])


def _joint_lines(name: str, kind: str, parent: str, child: str, place: Array) -> list[str]:
    return [
        f"    <joint name={quoteattr(name)} type={quoteattr(kind)}>",
        f"      <pose relative_to={quoteattr(parent)}>{_pose_text(place)}</pose>",
        f"      <parent>{escape(parent)}</parent>",
        f"      <child>{escape(child)}</child>",
    ]


def _pose_text(place: Array) -> str:
    return f"{numbers(1e-3 * place[:3, 3])} {numbers(rpy_from_rotation(place[:3, :3]))}"
