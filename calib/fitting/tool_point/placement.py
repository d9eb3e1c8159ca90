"""The tool point of a fitted arm: where it is in the nominal arm's last joint's frame, and how far that may be off.

Where a point of the tool is shows in the frame that turns (or slides) with the last joint; the last row of the table
and the tool's row move it alike, and one point cannot tell which of them did, nor how the tool is turned about it. So
a tool point far from where robot.toml has it becomes a point of its own in the last joint's frame (`jig.x`, `jig.y`,
`jig.z`), and the two rows, with them the place and attitude of the tip, stay as robot.toml has them.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.effects.link_errors import TOLERANCE_MM, LinkErrors, TargetOffsets, target_parameter_names
from calib.fitting.model import Model
from calib.fitting.observations import Observations
from calib.kinematics import chain as kinematics
from calib.kinematics.robot import PARAMETER_KINDS, Robot
from calib.kinematics.tool_point import tip_T_last, tool_point_of, with_own_tool_point

_ROWS_BEHIND = 2  # of the table: what lies behind the last joint's axis


@dataclass(frozen=True)
class ToolShift:
    """A tool point far from where robot.toml has it."""

    point_mm: tuple[float, float, float]  # where it is, in the nominal arm's last joint's frame
    off_mm: float  # from where robot.toml has it
    in_tip_mm: tuple[float, float, float]  # where it is, in the frame of the tip

    @property
    def words(self) -> str:
        x, y, z = self.point_mm
        from_tip = ", ".join(f"{value:.1f}" for value in self.in_tip_mm)
        return (
            f"the tool point is {self.off_mm:.1f} mm from where robot.toml has it (in the last joint's frame: "
            f"x {x:.1f}, y {y:.1f}, z {z:.1f} mm; from the tip: {from_tip} mm); it is a point of its own, and the tip "
            "stays where robot.toml has it: the measured points tell neither its place nor its attitude"
        )


def tool_shift(nominal: Robot, calibrated: Robot) -> ToolShift:
    """From the nominal arm's tool point to that of the calibrated arm."""
    point_mm = tool_point_in_nominal(nominal, calibrated)
    x, y, z = point_mm.tolist()
    in_tip = frames.apply(tip_T_last(nominal), point_mm).tolist()
    off_mm = float(np.linalg.norm(point_mm - tool_point_of(nominal)))
    return ToolShift((x, y, z), off_mm, (in_tip[0], in_tip[1], in_tip[2]))


def tool_point_in_nominal(nominal: Robot, other: Robot) -> Array:
    """The tool point of another table of the arm, mm in the nominal arm's last joint's frame (3,)."""
    nominal_T_other = frames.invert(_last_frame(nominal.table)) @ _last_frame(other.table)
    return frames.apply(nominal_T_other, tool_point_of(other))


def tip_turn_rad(nominal: Robot, other: Robot) -> float:
    """How far the rows behind the last joint's axis turn the tip of another table of the arm; its zero apart."""
    axis_R_tip = []
    for robot in (nominal, other):
        rows = robot.table[-_ROWS_BEHIND:].copy()
        rows[0, PARAMETER_KINDS.index("theta")] = 0.0
        chain = kinematics.forward(rows, np.zeros((1, 1)), np.ones(1, dtype=bool))
        axis_R_tip.append(chain.base_T_frame[0, -1, :3, :3])
    return float(np.linalg.norm(frames.rotvec_from_rotation(axis_R_tip[0].T @ axis_R_tip[1])))


def _last_frame(table: Array) -> Array:
    """(4, 4) the last joint's frame in the frame that turns with it, at q = 0."""
    return kinematics.forward(table[-2:], np.zeros((1, 1)), np.ones(1, dtype=bool)).base_T_frame[0, 1]


def tolerance_covariance(robot: Robot, links: LinkErrors, fixed: Collection[str]) -> Array:
    """(3, 3) mm^2: how far tolerances let the tool point be off.

    Those of the last two rows, where they are not fixed, and a length's in each direction: the rows may have no
    parameter that moves it that way. A point of its own may be off by its own tolerance.
    """
    own = robot.own_tool_point
    if own is not None:
        return (own.tolerance_mm**2 + TOLERANCE_MM**2) * np.eye(3)
    base_T_joint = np.linalg.inv(_last_frame(robot.table))
    table = robot.table[-2:]
    chain = kinematics.forward(table, np.zeros((1, 1)), np.ones(1, dtype=bool))
    columns = kinematics.point_jacobian(chain, chain.target_mm)[0].reshape(3, -1)
    scales = [0.0 if p.name in fixed else p.scale for p in links.parameters[-columns.shape[1] :]]
    moved = base_T_joint[:3, :3] @ columns * np.array(scales)
    return np.asarray(moved @ moved.T) + TOLERANCE_MM**2 * np.eye(3)


def free_directions(robot: Robot, fixed: Collection[str]) -> Array:
    """(3, K) along which the tool point may move, where its lengths across or along the last axis are fixed."""
    own = robot.own_tool_point
    lengths = ("aTCP", "aTCP", "dTCP") if own is None else target_parameter_names(own)
    return np.eye(3)[:, [name not in fixed for name in lengths]]


def fixed_behind_tool_point(robot: Robot, observed: Observations) -> tuple[str, ...]:
    """The parameters that one point of its own on the last link leaves at robot.toml's: all behind the last axis.

    They move it as its own place does, or turn the tip about it, of which it tells nothing. () where the tool point is
    the end of the tool's row, and where further targets on the last link tell how that stands.
    """
    own = robot.own_tool_point
    if own is None or own.name not in observed.targets:
        return ()
    further = [t for t in robot.targets if t is not own and t.joint is None and t.name in observed.targets]
    names = behind_last_axis(robot)
    return names[-len(PARAMETER_KINDS) :] if further else names


def behind_last_axis(robot: Robot) -> tuple[str, ...]:
    """The parameters of what lies behind the last joint's axis: of its row and of the tool's."""
    return robot.parameter_names[-_ROWS_BEHIND * len(PARAMETER_KINDS) :]


def angles_behind_last_axis(robot: Robot) -> tuple[str, ...]:
    """Those of them that turn the tip, the last joint's zero apart."""
    zero = f"theta{robot.n_joints}"
    return tuple(n for n in behind_last_axis(robot) if n.startswith(("alpha", "beta", "theta")) and n != zero)


def with_found_tool(
    model: Model, links: LinkErrors, offsets: TargetOffsets | None, observed: Observations, found: Robot
) -> Model:
    """The model with the tool point as a point of its own, which may be as far off as it was found.

    links, offsets: with the tolerances that were asked for, the model's first effects.
    """
    nominal_mm = tool_point_of(links.robot)
    robot = with_own_tool_point(model.robot, nominal_mm)
    own = robot.own_tool_point
    assert own is not None
    off_mm = float(np.linalg.norm(tool_point_of(found) - nominal_mm))
    x, y, z = target_parameter_names(own)
    across_mm, along_mm = (links.tolerances.get(name, off_mm) for name in ("aTCP", "dTCP"))
    tolerances = {x: across_mm, y: across_mm, z: along_mm}
    others: tuple[TargetOffsets, ...] = () if offsets is None else (offsets,)
    targets = tuple(t for of in others for t in of.targets if t.name != own.name)
    place = TargetOffsets((own, *targets), {**tolerances, **(offsets.tolerances if offsets else {})})
    own_names = {"aTCP": (x, y), "dTCP": (z,)}
    own_fixed = [name for row_name, names in own_names.items() if row_name in model.fixed for name in names]
    geometry = (LinkErrors(robot, links.tolerances), place)
    return Model(
        robot,
        (*geometry, *model.effects[1 + len(others) :]),
        model.fixed.union(fixed_behind_tool_point(robot, observed), own_fixed),
        model.prior_sigmas,
        model.loads_of,
        found,
    )
