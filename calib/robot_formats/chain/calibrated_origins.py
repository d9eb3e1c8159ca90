"""Where the joints of a user's own chain stand once the five-parameter table of its arm is calibrated.

J_i is the frame of joint i at zero, F_i frame i of the table, both in the base frame. Nominally F_(i-1) and J_i share
axis i, so N_i = F_(i-1)^-1 J_i is a turn about it and a slide along it, and it is kept: with the calibrated table

    J_i' = F_(i-1)' Rz(theta_i' - theta_i) N_i        before_T_joint_i' = J_(i-1)'^-1 J_i'

The change of theta_i turns the link behind joint i, so that an error of one joint's zero changes one origin.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, BoolArray
from calib.frames import apply, best_fit_rotation, invert, make_transform, rotation_from_rpy
from calib.kinematics.robot import Robot
from calib.robot_formats.chain.five_parameters import frames_at_zero, vector
from calib.robot_formats.chain.serial_chain import RobotFileError, SerialChain, axis_frame

_SAME_MM, _SAME_RAD = 1e-3, 1e-6


@dataclass(frozen=True)
class CalibratedChain:
    """A chain with calibrated origins, and whether its tip could be moved with them."""

    chain: SerialChain
    tip_known: (
        bool  # False: the robot's tool ends elsewhere than the chain's tip, which stays on the last link
    )


def with_calibration(chain: SerialChain, nominal: Robot, calibrated: Robot) -> CalibratedChain:
    """The chain with the places of its joints as calibrated: same joints, same axes in their own frames.

    Raises RobotFileError where the nominal robot is not the chain's arm: joints in number or kind, an axis.
    """
    _require_same_joints(chain, nominal)
    frames, after = frames_at_zero(nominal), frames_at_zero(calibrated)
    robot_T_chain = _base(chain, frames, nominal)
    at_zero = robot_T_chain @ chain.at_zero
    joints, before = [], robot_T_chain
    for i, joint in enumerate(chain.joints):
        frame_T_joint = invert(frames[i]) @ at_zero[i]
        _require_axis(chain, nominal, i, frame_T_joint @ axis_frame(joint))
        turn_rad = calibrated.joints[i].theta_rad - nominal.joints[i].theta_rad
        base_T_joint = (
            after[i] @ make_transform(rotation_from_rpy([0.0, 0.0, turn_rad]), np.zeros(3)) @ frame_T_joint
        )
        joints.append(replace(joint, before_T_joint=invert(before) @ base_T_joint))
        before = base_T_joint
    tip_known = bool(_is_near(frames[-1], at_zero[-1]))
    last_T_tip = invert(before) @ after[-1] if tip_known else chain.last_T_tip
    own = calibrated.own_tool_point
    tip_T_frame = invert(before @ last_T_tip) @ after[-2]
    found = replace(
        chain,
        joints=tuple(joints),
        last_T_tip=last_T_tip,
        tool_point_mm=None if own is None else vector(apply(tip_T_frame, own.xyz_mm)),
    )
    return CalibratedChain(found, tip_known)


def _require_same_joints(chain: SerialChain, robot: Robot) -> None:
    kinds = [joint.is_revolute for joint in chain.joints]
    if robot.coupling != chain.coupling:
        raise RobotFileError(f"robot {robot.name}: its joints are coupled, which {chain.name} does not say")
    if kinds != robot.is_revolute.tolist():
        raise RobotFileError(
            f"{chain.name}: has {len(kinds)} joints up to {chain.tip or 'its tip'}, robot.toml has {robot.n_joints}, "
            "or their kinds differ; name the tip of the same arm"
        )


def _base(chain: SerialChain, frames: Array, robot: Robot) -> Array:
    """(4, 4) from the chain's base frame to the robot's: none where their axes agree as they are, else what makes them.

    A maker's file may start from another link than the URDF that robot.toml was made of.
    """
    at_zero = chain.at_zero
    axes = np.stack(
        [frame @ axis_frame(joint) for frame, joint in zip(at_zero[:-1], chain.joints, strict=True)]
    )
    stands = frames[: len(axes)]
    if _same_axes(axes, stands, robot.is_revolute):
        return np.eye(4)
    moved = _moved_onto(axes, stands, robot.is_revolute)
    return moved if _same_axes(moved @ axes, stands, robot.is_revolute) else np.eye(4)


def _across(frames: Array) -> Array:
    """(n, 3, 3) what takes from a vector what lies along the z axis of each frame (n, 4, 4)."""
    along = frames[:, :3, 2]
    return np.asarray(np.eye(3) - along[:, :, None] * along[:, None, :])


def _same_axes(axes: Array, frames: Array, turns: BoolArray) -> bool:
    """Whether the z axes of frames (n, 4, 4) are the same lines, of joints that slide the same directions."""
    gap_mm = np.einsum("nij,nj->ni", _across(frames), axes[:, :3, 3] - frames[:, :3, 3])[turns]
    lean = np.abs(axes[:, :3, 2] - frames[:, :3, 2]).max()
    return bool(lean < _SAME_RAD and np.abs(gap_mm).max(initial=0.0) < _SAME_MM)


def _moved_onto(axes: Array, frames: Array, turns: BoolArray) -> Array:
    """(4, 4) the motion that brings axes (n, 4, 4) onto the z axes of frames (n, 4, 4), by least squares."""
    turn = best_fit_rotation(axes[:, :3, 2], frames[:, :3, 2])
    across = _across(frames)[turns]
    if not len(across):
        return make_transform(turn, np.zeros(3))
    gap_mm = (frames[:, :3, 3] - axes[:, :3, 3] @ turn.T)[turns]
    shift_mm = np.linalg.pinv(across.sum(axis=0), rcond=1e-9) @ np.einsum("nij,nj->i", across, gap_mm)
    return make_transform(turn, shift_mm)


def _require_axis(chain: SerialChain, robot: Robot, i: int, frame_T_axis: Array) -> None:
    """The axis in the frame that should stand on it: it has to be the frame's z axis."""
    off_mm = np.hypot(*frame_T_axis[:2, 3]) if robot.joints[i].is_revolute else 0.0
    lean_rad = np.arctan2(np.hypot(*frame_T_axis[:2, 2]), frame_T_axis[2, 2])
    if off_mm > _SAME_MM or lean_rad > _SAME_RAD:
        raise RobotFileError(
            f"{chain.name}: the axis of joint {i + 1} ({chain.joints[i].name}) is {off_mm:.3g} mm and "
            f"{np.degrees(lean_rad):.3g} deg from that of robot.toml; the two have to be of one arm and base "
            "(inspector convert makes robot.toml of this file)"
        )


def _is_near(one: Array, other: Array) -> bool:
    off_mm, turned = np.abs(one[:3, 3] - other[:3, 3]).max(), np.abs(one[:3, :3] - other[:3, :3]).max()
    return bool(off_mm < _SAME_MM and turned < _SAME_RAD)
