"""The tool point of a table: where it is, how far from where robot.toml has it, and a table that has it elsewhere.

Where a point of the tool is shows in the frame that turns (or slides) with the last joint; the last row of the table
and the tool's row move it alike. Both are written down in the nominal arm's last joint's frame, in which `[tool]` is
given.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.effects.link_errors import TOLERANCE_MM, TOLERANCE_RAD, LinkErrors
from calib.kinematics import chain as kinematics
from calib.kinematics.robot import PARAMETER_KINDS, Robot

_NEAR_AXIS_MM = 4.0  # a tool point so near the last joint's axis is taken to be on it
_A, _D, _THETA = (PARAMETER_KINDS.index(kind) for kind in ("a", "d", "theta"))


@dataclass(frozen=True)
class ToolShift:
    """A tool point far from where robot.toml has it."""

    point_mm: tuple[float, float, float]  # where it is, in the nominal arm's last joint's frame
    off_mm: float  # from where robot.toml has it

    @property
    def words(self) -> str:
        x, y, z = self.point_mm
        return (
            f"the tool point is {self.off_mm:.1f} mm from where robot.toml has it (in the last joint's frame: "
            f"x {x:.1f}, y {y:.1f}, z {z:.1f} mm)"
        )


def tool_shift(robot: Robot, table: Array) -> ToolShift:
    """From the arm's tool point to that of another table (n + 1, 5) of it."""
    point_mm = tool_point_in_nominal(robot, table)
    x, y, z = point_mm.tolist()
    return ToolShift((x, y, z), float(np.linalg.norm(point_mm - tool_point(robot.table))))


def tool_point(table: Array) -> Array:
    """(3,) mm, in the last joint's frame, of a table (n + 1, 5)."""
    a, d, theta = table[-1, [_A, _D, _THETA]]
    return np.array([a * np.cos(theta), a * np.sin(theta), d])


def tool_point_in_nominal(robot: Robot, table: Array) -> Array:
    """The tool point of another table of the arm, mm in the nominal arm's last joint's frame (3,)."""
    nominal_T_table = frames.invert(_last_frame(robot.table)) @ _last_frame(table)
    return frames.apply(nominal_T_table, tool_point(table))


def _last_frame(table: Array) -> Array:
    """(4, 4) the last joint's frame in the frame that turns with it, at q = 0."""
    return kinematics.forward(table[-2:], np.zeros((1, 1)), np.ones(1, dtype=bool)).base_T_frame[0, 1]


def tolerance_covariance(robot: Robot, links: LinkErrors, held: Collection[str]) -> Array:
    """(3, 3) mm^2: how far tolerances let the tool point be off.

    Those of the last two rows, where they are not held, and a length's in each direction: the rows may have no
    parameter that moves it that way.
    """
    base_T_joint = np.linalg.inv(_last_frame(robot.table))
    table = robot.table[-2:]
    chain = kinematics.forward(table, np.zeros((1, 1)), np.ones(1, dtype=bool))
    columns = kinematics.point_jacobian(chain, chain.target_mm)[0].reshape(3, -1)
    scales = [0.0 if p.name in held else p.scale for p in links.parameters[-columns.shape[1] :]]
    moved = base_T_joint[:3, :3] @ columns * np.array(scales)
    return np.asarray(moved @ moved.T) + TOLERANCE_MM**2 * np.eye(3)


def free_directions(robot: Robot, held: Collection[str]) -> Array:
    """(3, K) orthonormal: along which the tool's row may move its point, where some of its parameters are held."""
    theta = robot.table[-1, _THETA]
    axes = np.eye(3)
    free = []
    if "aTCP" not in held:
        free += [np.array([np.cos(theta), np.sin(theta), 0.0])] if "thetaTCP" in held else [axes[0], axes[1]]
    if "dTCP" not in held:
        free.append(axes[2])
    return np.array(free).reshape(-1, 3).T


def with_tool_point(robot: Robot, point_mm: Array, held: Collection[str] = ()) -> Robot:
    """The robot with its tool point elsewhere, mm in the last joint's frame; the tool's row turns as little as it can.

    p = (a cos theta, a sin theta, d) reaches any point twice, with a and with -a. Near the axis theta has no say and
    stays as it is: a direction by chance would turn the tool for nothing, and a fit gains nothing by it.
    """
    table = robot.table.copy()
    x, y, d = point_mm
    if "aTCP" not in held:
        theta = table[-1, _THETA]
        turn = _wrapped(np.arctan2(y, x) - theta)
        turn -= np.copysign(np.pi, turn) if abs(turn) > 0.5 * np.pi else 0.0
        if "thetaTCP" not in held and np.hypot(x, y) > _NEAR_AXIS_MM:
            theta += turn
        table[-1, _A], table[-1, _THETA] = x * np.cos(theta) + y * np.sin(theta), theta
    if "dTCP" not in held:
        table[-1, _D] = d
    return robot.with_table(table)


def _wrapped(angle_rad: float) -> float:
    return float((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)


def loose_tolerances(robot: Robot, found: Robot) -> dict[str, float]:
    """Tolerances, mm or rad, that let the tool point be as far off as it was found; theta's where theta was turned."""
    off_mm = float(np.linalg.norm(tool_point(found.table) - tool_point(robot.table)))
    out = {"aTCP": off_mm, "dTCP": off_mm}
    if found.table[-1, _THETA] != robot.table[-1, _THETA]:
        radius_mm = min(abs(found.table[-1, _A]), abs(robot.table[-1, _A]))
        turn_rad = float(np.pi) if np.pi * radius_mm <= off_mm else off_mm / radius_mm
        out["thetaTCP"] = max(turn_rad, TOLERANCE_RAD)
    return out
