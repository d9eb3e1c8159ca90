"""robot.toml, read, checked and written; angles are degrees in the file and rad in `Robot`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from calib.array_types import Vector
from calib.errors import DatasetError
from calib.kinematics.robot import TARGET_TOLERANCE_MM, TOOL_POINT, FixedFrame, Joint, Link, Robot, Target, Tool
from calib.options import BUILTIN_ROBOTS
from calib.text_files.toml_table import TomlTable, degrees, document_of

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


def _row(table: TomlTable) -> dict[str, float]:
    """Parameters of a row, which it has to have but for beta."""
    for key in _ROW_KEYS[:-1]:
        table.required_number(key)
    return table.record(Link)


def _joint(table: TomlTable, number: int) -> Joint:
    type_ = table.text("type", "revolute", choices=("revolute", "prismatic")) or "revolute"
    unit, scale = ("deg", math.radians(1.0)) if type_ == "revolute" else ("mm", 1.0)
    low, high = table.number(f"min_{unit}"), table.number(f"max_{unit}")
    if low is not None and high is not None and low >= high:
        raise table.error(f"max_{unit}", f"found {high:g}, not above min_{unit} = {low:g}", "swap or mend the limits")
    found = table.record(Joint, but=("type",)) | _row(table)
    if (found.get("mass_kg") or 0.0) < 0.0:
        raise table.error("mass_kg", f"found {found['mass_kg']:g}", "a mass is 0 or more")
    table.number("gear_ratio", positive=True)
    limits = {key: None if value is None else value * scale for key, value in (("min", low), ("max", high))}
    zero = (table.number(f"zero_{unit}") or 0.0) * scale
    found |= {"name": found.get("name") or f"J{number}", "type": type_, "zero": zero, **limits}
    return Joint(**found, extra=table.unread())


def _tool(table: TomlTable) -> Tool:
    if not table.data:
        raise DatasetError(
            f"{table.file}: found no [tool]; the measured point needs its own row (a_mm, alpha_deg, d_mm, theta_deg), "
            "or xyz_mm = [x, y, z] in the last joint's frame"
        )
    xyz_mm = table.vector("xyz_mm")
    row = _row(table) if xyz_mm is None else _link_to(table, xyz_mm)
    return Tool(**(table.record(Tool) | row), extra=table.unread())


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


def robot_to_toml(robot: Robot) -> str:
    """The robot as the text of a robot.toml; `load_robot_toml` gives the same robot back."""
    return tomli_w.dumps(_document(robot))


def _document(robot: Robot) -> dict[str, Any]:
    document: dict[str, Any] = {"name": robot.name, "gravity_m_s2": list(robot.gravity_m_s2), **robot.extra}
    if robot.is_cartesian:
        document["cartesian"] = True
    if robot.coupling:
        coupling = _scaled_coupling(robot.coupling, robot.joints, math.radians(1.0))
        document["coupling"] = [list(row) for row in coupling]
    frames = {"base": robot.base, "flange": robot.flange}
    document |= {name: document_of(frame) for name, frame in frames.items() if frame != FixedFrame()}
    document["joints"] = list(map(_joint_document, robot.joints))
    document["tool"] = document_of(robot.tool)
    on_arm = [target for target in robot.targets if not target.in_world]
    if on_arm:
        document["targets"] = [
            document_of(t, but=("in_world", *(["tolerance_mm"] if t.tolerance_mm == TARGET_TOLERANCE_MM else [])))
            for t in on_arm
        ]
    return document


def _joint_document(joint: Joint) -> dict[str, Any]:
    unit = "deg" if joint.is_revolute else "mm"
    values = {"min": joint.min, "max": joint.max, "zero": joint.zero or None}
    limits = {
        f"{key}_{unit}": degrees(value) if joint.is_revolute else value
        for key, value in values.items()
        if value is not None
    }
    first = {"name": joint.name, "type": joint.type}
    return first | document_of(replace(joint, extra={}), but=values) | limits | dict(joint.extra)


_LARGEST = {"mm": 1e6, "deg": 1e5, "kg": 1e5, "s2": 100.0, "ratio": 1e6}  # by the end of a key
_REMEDY = "correct it; the unit stands in the key's name"


def refuse_beyond(robot: Robot, path: Path) -> None:
    """Raise DatasetError where a length, an angle, a mass, a gear ratio or gravity is beyond its bound."""
    links = [replace(joint, extra={}) for joint in robot.joints]
    document = _document(replace(robot, joints=tuple(links), tool=replace(robot.tool, extra={}), extra={}))
    for name, content in document.items():
        tables = {"": document} if name == "gravity_m_s2" else {f"[{name}].": content}
        if isinstance(content, list) and name in ("joints", "targets"):
            tables = {f"[[{name}]] {number}.": table for number, table in enumerate(content, 1)}
        for place, table in tables.items():
            _refuse_large(path, place, table if isinstance(table, dict) else {})


def _refuse_large(path: Path, place: str, table: Mapping[str, Any]) -> None:
    for key, value in table.items():
        most = _LARGEST.get(key.rpartition("_")[2], math.inf)
        if most < math.inf and not float(np.max(np.abs(value))) <= most:  # nor NaN
            found = f"{value:g}" if isinstance(value, float) else str(value)
            raise DatasetError(f"{path}: {place}{key}: found {found}, beyond {most:g}; {_REMEDY}")
