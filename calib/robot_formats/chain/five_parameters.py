"""Exact conversion between serial chains and five-parameter tables.

Frame i lies on the axis of joint i + 1, with z along it. Its place on the axis is free, as d of the next row
compensates for it. Axes that enclose more than 45 deg are joined at their common normal, where beta is 0 and the row is
that of Denavit and Hartenberg; for others, parallel ones included, the frame is at the joint's own origin, so that no
length grows beyond those of the chain. beta stays below 45 deg, far from +-90 deg, where alpha and the next theta are
one.

A general transform to the tip needs row n and the tool row together: a of row n holds the offset across the last axis,
the tool row the rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array, Vector
from calib.frames import apply, invert, make_transform, rotation_from_rpy
from calib.kinematics.chain import nominal_chain
from calib.kinematics.flange import flange_T_tip
from calib.kinematics.robot import FixedFrame, Joint, Robot, Tool
from calib.kinematics.tool_point import tip_T_last
from calib.robot_formats.chain.serial_chain import ChainJoint, SerialChain, axis_frame

_STEEP = np.sqrt(0.5)  # sine of the angle above which two axes are joined at their common normal
_NOTHING_MM = 1e-11
_STRAIGHT = 1e-12  # rad
_ROUNDING_MM, _ROUNDING_RAD = 1e-12, 1e-15
Row = tuple[float, float, float, float, float]


def robot_of(chain: SerialChain, near_mm: Sequence[ArrayLike] | None = None) -> Robot:
    """Robot with the kinematics of a chain: same joint values and base frame; the tool row ends at the tip.

    `near_mm`: n - 1 points (3,) in the base frame at zero; a frame without a common normal is then placed on its axis
    where it is closest to point i, in place of the joint's own origin.
    """
    at_zero = chain.at_zero
    axes = [frame @ axis_frame(joint) for frame, joint in zip(at_zero[:-1], chain.joints, strict=True)]
    frames = [_first_frame(axes[0])]
    rows: list[Row] = []
    for i, axis in enumerate(axes[1:]):
        to_next = invert(frames[-1]) @ axis
        close_to = None if near_mm is None else apply(invert(frames[-1]), np.asarray(near_mm[i], dtype=float))
        row = _row(to_next[:3, 3], to_next[:3, 2], close_to)
        rows.append(row)
        frames.append(frames[-1] @ row_transform(row))
    last, tool = _last_rows(invert(frames[-1]) @ at_zero[-1])
    frames.append(frames[-1] @ row_transform(last))
    joints = [
        _joint(joint, row, invert(frame) @ of_joint)
        for joint, row, frame, of_joint in zip(chain.joints, [*rows, last], frames[1:], at_zero[:-1], strict=True)
    ]
    return Robot(
        name=chain.name,
        joints=tuple(joints),
        tool=Tool(*tool),
        gravity_m_s2=chain.gravity_m_s2,
        coupling=chain.coupling,
        base=FixedFrame.of(frames[0]),
        flange=_flange(row_transform(tool) if chain.tip_T_flange is None else row_transform(tool) @ chain.tip_T_flange),
    )


def _flange(last_T_flange: Array) -> FixedFrame:
    return FixedFrame() if np.allclose(last_T_flange, np.eye(4), atol=_NOTHING_MM) else FixedFrame.of(last_T_flange)


def chain_of(robot: Robot) -> SerialChain:
    """Chain of a robot, with joints about z: origins Rz(theta_1), then Trans(a, 0, d) Rx Ry Rz(theta_next).

    Its joints are the arm's own, whatever is commanded (`Robot.coupling`).
    """
    joints, before = [], robot.base_T_first
    for k, joint in enumerate(robot.joints):
        turned = row_transform((0.0, 0.0, 0.0, joint.theta_rad, 0.0))
        joint_T_frame = row_transform((joint.a_mm, joint.alpha_rad, joint.d_mm, 0.0, joint.beta_rad))
        mass_kg, com_mm = _with_tool(robot) if k == robot.n_joints - 1 else (joint.mass_kg, joint.com_mm)
        joints.append(
            ChainJoint(
                name=joint.name or f"J{k + 1}",
                before_T_joint=before @ turned,
                type=joint.type,
                min=joint.min,
                max=joint.max,
                mass_kg=mass_kg,
                com_mm=None if com_mm is None else vector(apply(joint_T_frame, com_mm)),
                gear_ratio=joint.gear_ratio,
            )
        )
        before = joint_T_frame
    own = robot.own_tool_point
    return SerialChain(
        robot.name,
        tuple(joints),
        before @ row_transform(robot.tool.row),
        robot.gravity_m_s2,
        tool_point_mm=None if own is None else vector(apply(tip_T_last(robot), own.xyz_mm)),
        tip_T_flange=invert(flange_T_tip(robot)),
    )


def frames_at_zero(robot: Robot) -> Array:
    """Frames (n + 2, 4, 4) at zero in the base frame: the start of the first row, frames 1..n, and the tool."""
    q = np.zeros((1, robot.n_joints))
    return nominal_chain(robot, q).base_T_frame[0]


def row_transform(row: Row) -> Array:
    """Transform (4, 4) of a row (a, alpha, d, theta, beta), mm and rad: Rz(theta) Trans(a, 0, d) Rx(alpha) Ry(beta)."""
    a, alpha, d, theta, beta = row
    turn = rotation_from_rpy([0.0, 0.0, theta])
    tilt = rotation_from_rpy([alpha, 0.0, 0.0]) @ rotation_from_rpy([0.0, beta, 0.0])
    return make_transform(turn @ tilt, turn @ [a, 0.0, d])


def modified_transform(a: float, alpha: float, d: float, theta: float) -> Array:
    """Transform (4, 4) of a modified Denavit-Hartenberg row: Rx(alpha) Trans(a, 0, 0) Rz(theta) Trans(0, 0, d)."""
    return np.asarray(row_transform((a, alpha, 0.0, 0.0, 0.0)) @ row_transform((0.0, 0.0, d, theta, 0.0)))


def _first_frame(axis: Array) -> Array:
    """Start frame (4, 4) of the first row: the base frame where the first axis is its z axis, else the axis' frame."""
    off_mm, lean = np.hypot(*axis[:2, 3]), np.hypot(*axis[:2, 2])
    return np.eye(4) if off_mm < _NOTHING_MM and lean < 1e-15 and axis[2, 2] > 0.0 else axis


def _row(origin_mm: Array, along: Array, close_to_mm: Array | None) -> Row:
    """Row of five parameters from a frame to a frame at a point on the next axis, with z along that axis.

    origin_mm, along  # (3,) a point on the next axis and its unit vector, in the frame
    """
    across = float(np.hypot(along[0], along[1]))
    if across > _STEEP:
        foot = origin_mm - along * (origin_mm[:2] @ along[:2]) / across**2
        theta = _least_turn(np.arctan2(along[0], -along[1]))
    else:
        foot = origin_mm if close_to_mm is None else origin_mm + along * ((close_to_mm - origin_mm) @ along)
        theta = 0.0
        if np.hypot(foot[0], foot[1]) > _NOTHING_MM:
            theta = _least_turn(np.arctan2(foot[1], foot[0]))
        elif across > 1e3 * _STRAIGHT:
            theta = _least_turn(np.arctan2(along[0], -along[1]))
    back = rotation_from_rpy([0.0, 0.0, -theta])
    foot, along = back @ foot, back @ along
    beta = np.arctan2(along[0], np.hypot(along[1], along[2]))
    alpha = np.arctan2(-along[1], along[2])
    return _plain((float(foot[0]), float(alpha), float(foot[2]), theta, float(beta)))


def _last_rows(frame_T_tip: Array) -> tuple[Row, Row]:
    """Row n and tool row of a transform (4, 4) from the last joint's axis to the tip."""
    x, y, z = frame_T_tip[:3, 3]
    theta = _least_turn(np.arctan2(y, x)) if np.hypot(x, y) > _NOTHING_MM else 0.0
    back = rotation_from_rpy([0.0, 0.0, -theta])
    R = back @ frame_T_tip[:3, :3]
    turn = 0.0  # R = Rz(turn) Rx(alpha) Ry(beta)
    if np.hypot(R[0, 1], R[1, 1]) > 1e-15:
        turn = float(np.arctan2(-R[0, 1], R[1, 1]))
    rest = rotation_from_rpy([0.0, 0.0, -turn]) @ R
    alpha, beta = np.arctan2(rest[2, 1], rest[1, 1]), np.arctan2(rest[0, 2], rest[0, 0])
    return (float((back @ [x, y, z])[0]), 0.0, 0.0, theta, 0.0), (0.0, float(alpha), float(z), turn, float(beta))


def _plain(row: Row) -> Row:
    """The row of five parameters with values below rounding set to zero; the next row starts from its end."""
    a, alpha, d, theta, beta = row
    turns = [0.0 if abs(angle) < _ROUNDING_RAD else angle for angle in (alpha, theta, beta)]
    lengths = [0.0 if abs(length) < _ROUNDING_MM else length for length in (a, d)]
    return lengths[0], turns[0], lengths[1], turns[1], turns[2]


def _least_turn(angle_rad: float) -> float:
    """The angle, rad, changed by half a turn if needed to be within a quarter turn of zero; a or alpha changes sign."""
    wrapped = float((angle_rad + np.pi) % (2 * np.pi) - np.pi)
    if wrapped > np.pi / 2 + _STRAIGHT:
        return wrapped - np.pi
    return wrapped + np.pi if wrapped <= -np.pi / 2 + _STRAIGHT else wrapped


def _joint(joint: ChainJoint, row: Row, frame_T_joint: Array) -> Joint:
    com_mm = None if joint.com_mm is None else vector(apply(frame_T_joint, joint.com_mm))
    return Joint(
        *row,
        name=joint.name,
        type=joint.type,
        min=joint.min,
        max=joint.max,
        mass_kg=joint.mass_kg,
        com_mm=com_mm,
        gear_ratio=joint.gear_ratio,
    )


def _with_tool(robot: Robot) -> tuple[float | None, Vector | None]:
    """Mass, kg, and centre of mass, mm in the last frame, of the last link with the tool; None where not known."""
    link, tool = robot.joints[-1], robot.tool
    if not tool.mass_kg or tool.com_mm is None:
        return link.mass_kg, link.com_mm
    mass_kg = (link.mass_kg or 0.0) + tool.mass_kg
    moment = (link.mass_kg or 0.0) * np.array(link.com_mm or (0.0, 0.0, 0.0)) + tool.mass_kg * np.array(tool.com_mm)
    return mass_kg, vector(moment / mass_kg)


def vector(values: Array) -> Vector:
    """Vector (3,), mm, with components below rounding set to zero."""
    x, y, z = (0.0 if abs(value) < _ROUNDING_MM else float(value) for value in values)
    return (x, y, z)
