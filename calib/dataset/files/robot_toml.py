"""robot.toml, read, checked and written; angles are degrees in the file and rad in `Robot`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from calib.array_types import Vector
from calib.errors import DatasetError
from calib.kinematics.robot import TARGET_TOLERANCE_MM, TOOL_POINT, FixedFrame, Joint, Robot, Target, Tool
from calib.options import BUILTIN_ROBOTS
from calib.text_files.toml_table import TomlTable

_MOST_CONDITION = 1e6  # of the coupling; beyond it commands do not follow from joints
_ROW_KEYS = ("a_mm", "alpha_deg", "d_mm", "theta_deg", "beta_deg")


def builtin_robot(name: str) -> Robot:
    """A robot that comes with the package: "rb5" (RB5-850, Jang 2025 Table 2) or "panda" (Franka Panda)."""
    if name not in BUILTIN_ROBOTS:
        raise DatasetError(f"no built-in robot {name!r}; there are {', '.join(BUILTIN_ROBOTS)}, or give a robot.toml")
    with resources.as_file(resources.files("calib") / "robots" / f"{name}.toml") as path:
        return load_robot_toml(path)


def load_robot_toml(path: Path) -> Robot:
    """Read a robot.toml. Raises DatasetError that names the key and a remedy."""
    top = TomlTable.load(path)
    joints = tuple(_joint(table, number + 1) for number, table in enumerate(top.tables("joints")))
    if not joints:
        raise DatasetError(f"{path}: found no [[joints]]; a robot needs one [[joints]] table a joint, in order")
    tool = _tool(top.table("tool"))
    targets: list[Target] = []
    for table in top.tables("targets"):
        name, xyz_mm = table.required_text("name"), table.vector("xyz_mm")
        if xyz_mm is None:
            raise table.error("xyz_mm", "the key is missing", "add xyz_mm = [x, y, z] in the last joint's frame")
        if name in {target.name for target in targets}:
            raise table.error("name", f"found {name!r} a second time", "each target needs its own")
        if name == TOOL_POINT and _joint_of(table, len(joints)) is not None:
            raise table.error("joint", f"found one for {name!r}", "the tool's measured point is on the last link")
        tolerance_mm = table.number("tolerance_mm", TARGET_TOLERANCE_MM, positive=True) or TARGET_TOLERANCE_MM
        targets.append(Target(name, xyz_mm, tolerance_mm, _joint_of(table, len(joints))))
    robot = Robot(
        name=top.text("name") or path.stem,
        joints=joints,
        tool=tool,
        gravity_m_s2=top.vector("gravity_m_s2") or (0.0, 0.0, -9.81),
        targets=tuple(targets),
        coupling=_coupling(top, joints),
        base=_fixed_frame(top.table("base"), "base"),
        flange=_fixed_frame(top.table("flange"), "flange"),
        is_cartesian=top.flag("cartesian", False),
    )
    _refuse_metres(robot, path)
    return replace(robot, extra=top.unread())


def _fixed_frame(table: TomlTable, name: str) -> FixedFrame:
    """The frame before the first row, [base], or behind the last joint, [flange]; the identity where it is absent."""
    xyz_mm, rpy_deg = table.vector("xyz_mm"), table.vector("rpy_deg")
    for key in table.unread():
        raise table.error(key, "no such key", f"[{name}] has xyz_mm = [x, y, z] and rpy_deg = [roll, pitch, yaw]")
    roll, pitch, yaw = map(math.radians, rpy_deg or (0.0, 0.0, 0.0))
    return FixedFrame(xyz_mm or (0.0, 0.0, 0.0), (roll, pitch, yaw))


def _joint_of(table: TomlTable, joints: int) -> int | None:
    """Number, from 1, of the joint whose link carries a target; None for the last joint or an absent key."""
    number = table.number("joint")
    if number is None or number == joints:
        return None
    if number != int(number) or not 1 <= number <= joints:
        raise table.error("joint", f"found {number:g}", f"a joint's number is 1 to {joints}")
    return int(number)


def _coupling(top: TomlTable, joints: tuple[Joint, ...]) -> tuple[tuple[float, ...], ...]:
    """Matrix (n, n) from commanded values to joint values; () where the joints are not coupled."""
    coupling = top.square_matrix("coupling", len(joints))
    if not coupling:
        return ()
    if np.linalg.cond(np.array(coupling)) > _MOST_CONDITION:
        raise top.error(
            "coupling",
            f"found {[list(row) for row in coupling]}, which has no inverse",
            "row i says how joint i follows from what is commanded, such as [0, 1, 1] for q3 = q2 + q3'",
        )
    return _scaled_coupling(coupling, joints, math.degrees(1.0))


def _scaled_coupling(
    coupling: tuple[tuple[float, ...], ...], joints: tuple[Joint, ...], per_turning: float
) -> tuple[tuple[float, ...], ...]:
    """Coupling with its entries of a slide by an angle multiplied by a number, those of an angle by a slide divided.

    In the file a screw is in mm per degree.
    """
    scale = np.where([joint.is_revolute for joint in joints], per_turning, 1.0)
    return tuple(map(tuple, (np.array(coupling) * scale / scale[:, None]).tolist()))


def _refuse_metres(robot: Robot, path: Path) -> None:
    lengths_mm = [abs(v) for link in (*robot.joints, robot.tool) for v in (link.a_mm, link.d_mm)]
    longest_mm = max(lengths_mm)
    if 0 < longest_mm < 5.0:
        raise DatasetError(
            f"{path}: the longest of all a_mm and d_mm is {longest_mm:g} mm, which looks like metres; "
            "multiply the lengths by 1000"
        )


def _link(table: TomlTable) -> dict[str, Any]:
    return {
        "a_mm": table.required_number("a_mm"),
        "alpha_rad": math.radians(table.required_number("alpha_deg")),
        "d_mm": table.required_number("d_mm"),
        "theta_rad": math.radians(table.required_number("theta_deg")),
        "beta_rad": math.radians(table.number("beta_deg", 0.0) or 0.0),
    }


def _joint(table: TomlTable, number: int) -> Joint:
    type_ = table.text("type", "revolute", choices=("revolute", "prismatic")) or "revolute"
    unit, scale = ("deg", math.radians(1.0)) if type_ == "revolute" else ("mm", 1.0)
    low, high = table.number(f"min_{unit}"), table.number(f"max_{unit}")
    if low is not None and high is not None and low >= high:
        raise table.error(f"max_{unit}", f"found {high:g}, not above min_{unit} = {low:g}", "swap or mend the limits")
    mass_kg = table.number("mass_kg")
    if mass_kg is not None and mass_kg < 0:
        raise table.error("mass_kg", f"found {mass_kg:g}", "a mass is 0 or more")
    return Joint(
        **_link(table),
        name=table.text("name") or f"J{number}",
        type=type_,
        min=None if low is None else low * scale,
        max=None if high is None else high * scale,
        mass_kg=mass_kg,
        com_mm=table.vector("com_mm"),
        gear_ratio=table.number("gear_ratio", positive=True),
        zero=(table.number(f"zero_{unit}") or 0.0) * scale,
        mesh=table.text("mesh"),
        extra=table.unread(),
    )


def _tool(table: TomlTable) -> Tool:
    if not table.data:
        raise DatasetError(
            f"{table.file}: found no [tool]; the measured point needs its own row (a_mm, alpha_deg, d_mm, theta_deg), "
            "or xyz_mm = [x, y, z] in the last joint's frame"
        )
    xyz_mm = table.vector("xyz_mm")
    return Tool(
        **(_link(table) if xyz_mm is None else _link_to(table, xyz_mm)),
        mass_kg=table.number("mass_kg"),
        com_mm=table.vector("com_mm"),
        payload_com_mm=table.vector("payload_com_mm"),
        extra=table.unread(),
    )


def _link_to(table: TomlTable, xyz_mm: Vector) -> dict[str, Any]:
    """Parameters of a tool row that ends at xyz_mm in the last joint's frame: x = a cos theta, y = a sin theta, z = d.

    Without y its axes stay parallel to the last joint's; with it they turn by theta, at most a quarter turn, about z.
    """
    for key in _ROW_KEYS:
        if key in table.data:
            raise table.error(key, "found beside xyz_mm", "give the point or the row, not both")
    x, y, z = xyz_mm
    return {
        "a_mm": math.copysign(math.hypot(x, y), x) if x != 0.0 else y,
        "alpha_rad": 0.0,
        "d_mm": z,
        "theta_rad": math.atan(y / x) if x != 0.0 else math.pi / 2 if y != 0.0 else 0.0,
        "beta_rad": 0.0,
    }


def degrees(angle_rad: float) -> float:
    """An angle converted to degrees, rounded to 15 digits, so that 90.012 is written as 90.012."""
    return float(f"{math.degrees(angle_rad):.15g}")


def robot_to_toml(robot: Robot) -> str:
    """The robot as the text of a robot.toml; `load_robot_toml` gives the same robot back."""
    document: dict[str, Any] = {"name": robot.name, "gravity_m_s2": list(robot.gravity_m_s2), **robot.extra}
    if robot.is_cartesian:
        document["cartesian"] = True
    if robot.coupling:
        coupling = _scaled_coupling(robot.coupling, robot.joints, math.radians(1.0))
        document["coupling"] = [list(row) for row in coupling]
    for name, frame in (("base", robot.base), ("flange", robot.flange)):
        if frame != FixedFrame():
            rpy_deg = [degrees(angle_rad) for angle_rad in frame.rpy_rad]
            document[name] = {"xyz_mm": list(frame.xyz_mm), "rpy_deg": rpy_deg}
    document["joints"] = [_joint_document(joint) for joint in robot.joints]
    tool = robot.tool
    document["tool"] = _present(
        {**_link_document(tool), "mass_kg": tool.mass_kg, "com_mm": tool.com_mm, "payload_com_mm": tool.payload_com_mm}
    ) | dict(tool.extra)
    on_arm = [target for target in robot.targets if not target.in_world]
    if on_arm:
        document["targets"] = [_target_document(target) for target in on_arm]
    return tomli_w.dumps(document)


def _target_document(target: Target) -> dict[str, Any]:
    usual = target.tolerance_mm == TARGET_TOLERANCE_MM
    tolerance = {} if usual else {"tolerance_mm": target.tolerance_mm}
    joint = {} if target.joint is None else {"joint": target.joint}
    return {"name": target.name, "xyz_mm": list(target.xyz_mm), **tolerance, **joint}


def _link_document(link: Joint | Tool) -> dict[str, Any]:
    return {
        "a_mm": link.a_mm,
        "alpha_deg": degrees(link.alpha_rad),
        "d_mm": link.d_mm,
        "theta_deg": degrees(link.theta_rad),
        "beta_deg": degrees(link.beta_rad),
    }


def _joint_document(joint: Joint) -> dict[str, Any]:
    unit = "deg" if joint.is_revolute else "mm"

    def limit(value: float | None) -> float | None:
        return degrees(value) if value is not None and joint.is_revolute else value

    document = {
        "name": joint.name,
        "type": joint.type,
        **_link_document(joint),
        f"min_{unit}": limit(joint.min),
        f"max_{unit}": limit(joint.max),
        "mass_kg": joint.mass_kg,
        "com_mm": joint.com_mm,
        "gear_ratio": joint.gear_ratio,
        f"zero_{unit}": limit(joint.zero or None),
        "mesh": joint.mesh,
    }
    return _present(document) | dict(joint.extra)


def _present(document: dict[str, Any]) -> dict[str, Any]:
    """A document without its None values, tuples as lists, as TOML can be written."""
    return {k: list(v) if isinstance(v, tuple) else v for k, v in document.items() if v is not None}


_LARGEST = {"mm": 1e6, "deg": 1e5, "kg": 1e5, "m_s2": 100.0, "ratio": 1e6}  # by the end of a key
_REMEDY = "correct it; the unit stands in the key's name"


def refuse_beyond(robot: Robot, path: Path) -> None:
    """Raise DatasetError where a length, an angle, a mass, a gear ratio or gravity is beyond its bound."""
    for place, key, value in _sizes(robot):
        most = _LARGEST[key.rpartition("_")[2] if not key.endswith("m_s2") else "m_s2"]
        largest = float(np.max(np.abs(value)))
        if not largest <= most:  # nor NaN
            found = f"{value:g}" if isinstance(value, float) else str(list(value))
            raise DatasetError(f"{path}: {place}{key}: found {found}, beyond {most:g}; {_REMEDY}")


def _sizes(robot: Robot) -> Iterator[tuple[str, str, float | Vector]]:
    """Table, key and value of every physical quantity in robot.toml, in the file's units."""
    yield "", "gravity_m_s2", robot.gravity_m_s2
    for name, frame in (("base", robot.base), ("flange", robot.flange)):
        yield f"[{name}].", "xyz_mm", frame.xyz_mm
        roll, pitch, yaw = map(math.degrees, frame.rpy_rad)
        yield f"[{name}].", "rpy_deg", (roll, pitch, yaw)
    for number, joint in enumerate(robot.joints, 1):
        yield from _link_sizes(f"[[joints]] {number}.", joint)
    yield from _link_sizes("[tool].", robot.tool)
    for number, target in enumerate(robot.targets, 1):
        yield f"[[targets]] {number}.", "xyz_mm", target.xyz_mm
        yield f"[[targets]] {number}.", "tolerance_mm", target.tolerance_mm


def _link_sizes(place: str, link: Joint | Tool) -> Iterator[tuple[str, str, float | Vector]]:
    for name in (f.name for f in fields(link)):
        value = getattr(link, name)
        if value is None:
            continue
        if name.endswith("_rad"):
            yield place, f"{name.removesuffix('_rad')}_deg", math.degrees(value)
        elif name in ("min", "max", "zero"):
            turns = isinstance(link, Joint) and link.is_revolute
            yield place, f"{name}_{'deg' if turns else 'mm'}", math.degrees(value) if turns else value
        elif name.endswith(("_mm", "_kg", "_ratio")):
            yield place, name, value
