"""Links and joints of a URDF (wiki.ros.org/urdf/XML), checked: metres, radians and kilograms become mm, rad and kg."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, Vector
from calib.frames import make_transform, rotation_from_rpy
from calib.robot_formats.urdf.safe_xml import Element, XmlFile

_MOST_LINKS = 5000
_NO_LIMIT = 1e3  # rad or m
_MOST = 1e6  # of any number: m, rad, kg
_MOST_LIMIT = 1e308  # but of limits
_HARMLESS = ("xacro:property", "xacro:arg")
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of a URDF."""

    name: str
    type: str
    parent: str
    child: str
    parent_T_joint: Array  # (4, 4) mm
    axis: Vector  # unit vector
    low: float | None  # rad, or m
    high: float | None
    mimics: str | None  # the joint that it follows, as multiplier x its value + offset
    multiplier: float
    offset: float  # rad, or m
    element: Element

    @property
    def moves(self) -> bool:
        return self.type != "fixed"


@dataclass(frozen=True)
class Inertial:
    """Mass and centre of mass of a link."""

    mass_kg: float
    com_mm: Vector  # in the link's frame


@dataclass(frozen=True)
class UrdfTree:
    """Links and joints of a URDF; every link but the root hangs on one joint."""

    file: XmlFile
    name: str
    links: Mapping[str, Inertial | None]  # in the order of the file
    joint_of: Mapping[str, UrdfJoint]  # by child link
    joints_on: Mapping[str, tuple[UrdfJoint, ...]]  # by parent link
    root: str


def read_tree(file: XmlFile) -> UrdfTree:
    """Read links and joints of a URDF. Raises RobotFileError in one line with file, line and name."""
    robot = file.root
    if robot.tag == "mujoco":
        file.fail(robot, "a MuJoCo model, not a URDF", "the extra robot_forms reads it, by the suffix .xml")
    if robot.tag != "robot":
        file.fail(robot, f"the file begins with <{robot.tag[:40]}>", "a URDF begins with <robot>")
    _refuse_xacro(file)
    links: dict[str, Inertial | None] = {}
    for element in robot.all("link"):
        name = _required(file, element, "name", "link")
        if name in links:
            file.fail(element, f"link {name!r} stands there twice", "rename one")
        links[name] = _inertial(file, element, name)
    if len(links) > _MOST_LINKS:
        file.fail(robot, f"the robot has {len(links)} links", f"at most {_MOST_LINKS} are read")
    if not links:
        file.fail(robot, "the robot has no <link>", "a URDF has a link for each body")
    joints = [_joint(file, element, links) for element in robot.all("joint")]
    joint_of: dict[str, UrdfJoint] = {}
    names: set[str] = set()
    for joint in joints:
        if joint.name in names:
            file.fail(joint.element, f"joint {joint.name!r} stands there twice", "rename one")
        names.add(joint.name)
        if joint.child in joint_of:
            file.fail(
                joint.element,
                f"link {joint.child!r} hangs on joints {joint_of[joint.child].name!r} and {joint.name!r}: a loop",
                "only serial chains can be read",
            )
        joint_of[joint.child] = joint
    roots = [name for name in links if name not in joint_of]
    if not roots:
        file.fail(robot, "no link is the root: the joints close a loop", "only serial chains can be read")
    joints_on = {name: tuple(joint for joint in joints if joint.parent == name) for name in links}
    name = robot.attributes.get("name") or file.path.stem
    return UrdfTree(file, " ".join(name.split()), links, joint_of, joints_on, _root(roots, joints_on))


def _root(roots: list[str], joints_on: Mapping[str, tuple[UrdfJoint, ...]]) -> str:
    """Root link of the largest tree; links without any joint are ignored."""

    def below(link: str) -> int:
        waiting, count = [link], 0
        while waiting:
            count += 1
            waiting += [joint.child for joint in joints_on[waiting.pop()]]
        return count

    return max(roots, key=below)


def _refuse_xacro(file: XmlFile) -> None:
    """Raise RobotFileError for a macro; what only defines a name is left over where all names were filled in."""
    for element in file.root.with_all_below():
        if element.tag.startswith("xacro:") and element.tag not in _HARMLESS:
            file.fail(
                element,
                f"found <{element.tag[:40]}>, a macro that is not expanded",
                "give `inspector convert` the file with the suffix .xacro, or run `xacro FILE.xacro > FILE.urdf`, and "
                "give FILE.urdf",
            )


def _joint(file: XmlFile, element: Element, links: Mapping[str, object]) -> UrdfJoint:
    name = _required(file, element, "name", "joint")
    type_ = _required(file, element, "type", f"joint {name!r}")
    if type_ not in JOINT_TYPES:
        file.fail(element, f"joint {name!r} is of type {type_[:40]!r}", "expected " + ", ".join(JOINT_TYPES))
    ends = []
    for tag in ("parent", "child"):
        end = element.first(tag)
        if end is None:
            file.fail(element, f"joint {name!r} has no <{tag}>", f'add <{tag} link="..."/>')
        link = _required(file, end, "link", f"<{tag}> of joint {name!r}")
        if link not in links:
            file.fail(end, f"joint {name!r} names link {link!r}, which the file does not have", "correct the name")
        ends.append(link)
    limit, mimic = element.first("limit"), element.first("mimic")
    low = high = None
    followed = f"<mimic> of joint {name!r}"
    if limit is not None and type_ in ("revolute", "prismatic"):
        low = _number(file, limit, "lower", f"<limit> of joint {name!r}", 0.0, _MOST_LIMIT)
        high = _number(file, limit, "upper", f"<limit> of joint {name!r}", 0.0, _MOST_LIMIT)
        if low >= high or max(-low, high) > _NO_LIMIT:  # both 0 or +-1e16 stand where there are none to tell
            low = high = None
    return UrdfJoint(
        name=name,
        type=type_,
        parent=ends[0],
        child=ends[1],
        parent_T_joint=origin_of(file, element, f"joint {name!r}"),
        axis=_axis(file, element, name, type_),
        low=low,
        high=high,
        mimics=None if mimic is None else _required(file, mimic, "joint", followed),
        multiplier=1.0 if mimic is None else _number(file, mimic, "multiplier", followed, 1.0),
        offset=0.0 if mimic is None else _number(file, mimic, "offset", followed, 0.0),
        element=element,
    )


def origin_of(file: XmlFile, element: Element, what: str) -> Array:
    """Transform (4, 4), mm, of an element's <origin>; the identity where there is none."""
    origin = element.first("origin")
    if origin is None:
        return np.eye(4)
    if "quat_xyzw" in origin.attributes:
        file.fail(origin, f"the <origin> of {what} has quat_xyzw", "give its turn as rpy")
    xyz_m = _vector(file, origin, "xyz", f"<origin> of {what}", (0.0, 0.0, 0.0))
    rpy_rad = _vector(file, origin, "rpy", f"<origin> of {what}", (0.0, 0.0, 0.0))
    return make_transform(rotation_from_rpy(rpy_rad), 1e3 * np.array(xyz_m))


def _axis(file: XmlFile, element: Element, name: str, type_: str) -> Vector:
    axis = element.first("axis")
    if axis is None:
        return (1.0, 0.0, 0.0)  # URDF's default
    x, y, z = _vector(file, axis, "xyz", f"<axis> of joint {name!r}", (1.0, 0.0, 0.0))
    length = math.hypot(x, y, z)
    if length < 1e-6:
        if type_ not in ("revolute", "continuous", "prismatic"):
            return (1.0, 0.0, 0.0)
        file.fail(axis, f"the axis of joint {name!r} has no direction", 'give one, such as xyz="0 0 1"')
    return (x / length, y / length, z / length)


def _inertial(file: XmlFile, element: Element, name: str) -> Inertial | None:
    inertial = element.first("inertial")
    mass = None if inertial is None else inertial.first("mass")
    if inertial is None or mass is None:
        return None
    mass_kg = _number(file, mass, "value", f"<mass> of link {name!r}", None)
    if mass_kg < 0.0:
        file.fail(mass, f"link {name!r} weighs {mass_kg:g} kg", "a mass is 0 or more")
    x, y, z = map(float, origin_of(file, inertial, f"<inertial> of link {name!r}")[:3, 3])
    return Inertial(mass_kg, (x, y, z))


def _required(file: XmlFile, element: Element, key: str, what: str) -> str:
    value = element.attributes.get(key, "").strip()
    if not value:
        file.fail(element, f"the {what} has no {key}", f'add {key}="..."')
    return " ".join(value.split())


def _number(file: XmlFile, element: Element, key: str, what: str, default: float | None, most: float = _MOST) -> float:
    if default is None:
        _required(file, element, key, what)
    return _numbers(file, element, key, what, [default or 0.0], most)[0]


def _vector(file: XmlFile, element: Element, key: str, what: str, default: Vector) -> Vector:
    x, y, z = _numbers(file, element, key, what, default)
    return (x, y, z)


def _numbers(
    file: XmlFile, element: Element, key: str, what: str, default: Sequence[float], most: float = _MOST
) -> Sequence[float]:
    """Numbers of an attribute, as many as its default has. Raises RobotFileError."""
    text = element.attributes.get(key)
    if text is None:
        return default
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if "_" in text or len(values) != len(default) or not all(abs(value) <= most for value in values):
        found = " ".join(text.split())[:60]
        needed = "a number" if len(default) == 1 else f"{len(default)} numbers"
        file.fail(element, f"{key} in the {what} is {found!r}", f"{needed} of at most {most:g} are needed")
    return values
