"""Bounds for every size in robot.toml: a value beyond them has a wrong unit or a typing error."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np

from calib.errors import DatasetError
from calib.kinematics.robot import Joint, Robot, Tool

_MOST = {"mm": 1e6, "deg": 1e5, "kg": 1e5, "m_s2": 100.0, "ratio": 1e6}  # by the end of a key
_PLACE = "correct it; the unit stands in the key's name"


def refuse_beyond(robot: Robot, path: Path) -> None:
    """Raise DatasetError where a length, an angle, a mass, a gear ratio or gravity is beyond its bound."""
    for place, key, value in _sizes(robot):
        most = _MOST[key.rpartition("_")[2] if not key.endswith("m_s2") else "m_s2"]
        largest = float(np.max(np.abs(value)))
        if not largest <= most:  # nor NaN
            found = f"{value:g}" if isinstance(value, float) else str(list(value))
            raise DatasetError(f"{path}: {place}{key}: found {found}, beyond {most:g}; {_PLACE}")


def _sizes(robot: Robot) -> Iterator[tuple[str, str, float | tuple[float, float, float]]]:
    """Place, key and value of every size in the file, in its units."""
    yield "", "gravity_m_s2", robot.gravity_m_s2
    yield "[base].", "xyz_mm", robot.base.xyz_mm
    roll, pitch, yaw = map(math.degrees, robot.base.rpy_rad)
    yield "[base].", "rpy_deg", (roll, pitch, yaw)
    for number, joint in enumerate(robot.joints, 1):
        yield from _of_link(f"[[joints]] {number}.", joint)
    yield from _of_link("[tool].", robot.tool)
    for number, target in enumerate(robot.targets, 1):
        yield f"[[targets]] {number}.", "xyz_mm", target.xyz_mm
        yield f"[[targets]] {number}.", "tolerance_mm", target.tolerance_mm


def _of_link(place: str, link: Joint | Tool) -> Iterator[tuple[str, str, float | tuple[float, float, float]]]:
    for name in (f.name for f in fields(link)):
        value = getattr(link, name)
        if value is None:
            continue
        if name.endswith("_rad"):
            yield place, f"{name.removesuffix('_rad')}_deg", math.degrees(value)
        elif name in ("min", "max"):
            turns = isinstance(link, Joint) and link.is_revolute
            yield place, f"{name}_{'deg' if turns else 'mm'}", math.degrees(value) if turns else value
        elif name.endswith(("_mm", "_kg", "_ratio")):
            yield place, name, value
