"""Origins of the joints of a user's chain after its arm's five-parameter table is calibrated.

J_i is the frame of joint i at zero, F_i frame i of the table, both in the base frame. Where the table before the
calibration is known, F_(i-1) and J_i share axis i there, so N_i = F_(i-1)^-1 J_i is a turn about it and a slide along
it, which stays the same: with the calibrated table

    J_i' = F_(i-1)' Rz(theta_i' - theta_i) N_i        before_T_joint_i' = J_(i-1)'^-1 J_i'

The change of theta_i turns the link behind joint i, so that an error of one joint's zero changes one origin.

A table from elsewhere, such as a controller's calibration, has its frames at other places on the same axes. It
determines each joint's axis, a line at zero, but not place and turn of the frame on that line, which change no motion
as long as the frames behind compensate for them. So each frame is put where the chain has its link: joint
by joint, what the chain's own origin gives behind the joint before is moved onto the calibrated axis by the least shift
and the least turn, and turned about it until the next axis lies where the chain has it. The last joint is turned about
its axis until the tip is placed on it as in the chain.

Where the file cannot hold the tip, the last joint is turned and shifted along its axis to bring it there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, BoolArray
from calib.frames import apply, best_fit_rotation, invert, make_transform, rotation_from_rpy, skew, wrapped_angle
from calib.kinematics.robot import PARAMETER_KINDS, Robot
from calib.robot_formats.chain.five_parameters import frames_at_zero, robot_of, vector
from calib.robot_formats.chain.serial_chain import RobotFileError, SerialChain, axis_frame

_THETA = PARAMETER_KINDS.index("theta")
_SAME_MM, _SAME_RAD = 1e-3, 1e-6
_STEEP = 0.5  # sine of the angle between two axes above which the direction of the next one tells how a link is turned
_TELLS_MM = 10.0  # distance of two axes above which the place of the next one does


@dataclass(frozen=True)
class CalibratedChain:
    """A chain with calibrated origins, and whether its tip is calibrated too."""

    chain: SerialChain
    tip_known: bool  # False: the robot's tool ends elsewhere than the chain's tip, which stays on the last link


def with_calibration(
    chain: SerialChain, nominal: Robot | None, calibrated: Robot, *, holds_tip: bool = True
) -> CalibratedChain:
    """The chain with calibrated joint origins, its joints and their axes in their own frames unchanged.

    nominal: the robot whose table was calibrated; None: the chain itself, where the table may have other frames.
    holds_tip: whether the chain's file can hold the tip's place on the last joint; else that joint is moved instead.

    Raises RobotFileError where nominal robot and chain differ in number or type of joints, or in an axis.
    """
    before_calibration = robot_of(chain) if nominal is None else nominal
    _require_same_joints(chain, before_calibration)
    frames, after = frames_at_zero(before_calibration), frames_at_zero(calibrated)
    robot_T_chain = _base(chain, frames, before_calibration)
    at_zero = robot_T_chain @ chain.at_zero
    frames_T_joints = [invert(frame) @ joint for frame, joint in zip(frames[:-2], at_zero[:-1], strict=True)]
    for i, joint in enumerate(chain.joints):
        _require_axis(chain, before_calibration, i, frames_T_joints[i] @ axis_frame(joint))
    if nominal is None:
        _require_same_joints(chain, calibrated)
        places = _by_lines(chain, robot_T_chain, after[:-2])
    else:
        turns_rad = calibrated.table[:-1, _THETA] - nominal.table[:-1, _THETA]
        places = [
            frame @ _about_axis(turn_rad) @ frame_T_joint
            for frame, turn_rad, frame_T_joint in zip(after[:-2], turns_rad, frames_T_joints, strict=True)
        ]
    tip_known = bool(_is_near(frames[-1], at_zero[-1]))
    if tip_known and (nominal is None or not holds_tip):
        last = axis_frame(chain.joints[-1])
        turn_rad, slide_mm = _last_motion(invert(places[-1] @ last) @ after[-1], invert(last) @ chain.last_T_tip)
        places[-1] = places[-1] @ last @ _about_axis(turn_rad, slide_mm) @ invert(last)
    joints, before = [], robot_T_chain
    for joint, base_T_joint in zip(chain.joints, places, strict=True):
        joints.append(replace(joint, before_T_joint=invert(before) @ base_T_joint))
        before = base_T_joint
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


def _by_lines(chain: SerialChain, base_T_chain: Array, lines: Array) -> list[Array]:
    """Frames (4, 4) of the joints at zero, on the calibrated axes and as near as possible to the nominal frames.

    The last is not turned about its axis yet. lines  # (n, 4, 4) whose z axes are the calibrated ones
    """
    own = [joint.before_T_joint @ axis_frame(joint) for joint in chain.joints]
    out: list[Array] = []
    before = base_T_chain
    for i, joint in enumerate(chain.joints):
        axis = _moved_to_line(before @ own[i], lines[i], slides=not joint.is_revolute)
        joint_T_axis = axis_frame(joint)
        if i + 1 < len(own):
            both_turn = joint.is_revolute and chain.joints[i + 1].is_revolute
            expected = invert(joint_T_axis) @ own[i + 1]
            turn_rad = _azimuth(invert(axis) @ lines[i + 1], expected, both_turn=both_turn)
            axis = axis @ _about_axis(turn_rad)
        before = axis @ invert(joint_T_axis)
        out.append(before)
    return out


def _about_axis(turn_rad: float, slide_mm: float = 0.0) -> Array:
    """Transform (4, 4) of a turn about z and a slide along z."""
    return make_transform(rotation_from_rpy([0.0, 0.0, turn_rad]), [0.0, 0.0, slide_mm])


def _moved_to_line(frame: Array, line: Array, *, slides: bool) -> Array:
    """Frame (4, 4) moved by the least turn and shift that bring its z axis onto the z axis of another frame (4, 4).

    For a sliding joint only the direction of the axis counts.
    """
    along = line[:3, 2]
    turn = _least_turn_between(frame[:3, 2], along) @ frame[:3, :3]
    off_mm = frame[:3, 3] - line[:3, 3]
    place = frame[:3, 3] if slides else line[:3, 3] + along * (along @ off_mm)
    return make_transform(turn, place)


def _least_turn_between(one: Array, other: Array) -> Array:
    """Least rotation (3, 3) of a unit vector (3,) onto another that is not its opposite."""
    across, cosine = np.cross(one, other), float(one @ other)
    cross = skew(across)
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))


def _azimuth(axis_T_line: Array, nominal: Array, *, both_turn: bool) -> float:
    """Rotation, rad, about an axis that gives the next axis its nominal azimuth, by its direction or else its position.

    Both arguments (4, 4) with the next axis along z. 0 where the two axes are one line.
    """
    direction, expected = axis_T_line[:2, 2], nominal[:2, 2]
    if np.hypot(*expected) < _STEEP:
        if not both_turn:
            return 0.0
        # The next axis where it passes nearest to the frame's own height, as nominally.
        rise_mm = (nominal[2, 3] - axis_T_line[2, 3]) / axis_T_line[2, 2]
        direction, expected = axis_T_line[:2, 3] + rise_mm * direction, nominal[:2, 3]
        if np.hypot(*expected) < _TELLS_MM or np.hypot(*direction) < _TELLS_MM:
            return 0.0
    return wrapped_angle(float(np.arctan2(direction[1], direction[0]) - np.arctan2(expected[1], expected[0])))


def _last_motion(axis_T_tip: Array, nominal: Array) -> tuple[float, float]:
    """Turn, rad, about the last axis and slide, mm, along it that bring the tip to its nominal place on the axis."""
    turned = axis_T_tip[:3, :3] @ nominal[:3, :3].T
    turn_rad = float(np.arctan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1]))
    return turn_rad, float(axis_T_tip[2, 3] - nominal[2, 3])


def _require_same_joints(chain: SerialChain, robot: Robot) -> None:
    kinds = [joint.is_revolute for joint in chain.joints]
    if kinds != robot.is_revolute.tolist():
        raise RobotFileError(
            f"{chain.name}: has {len(kinds)} joints up to {chain.tip or 'its tip'}, robot.toml has {robot.n_joints}, "
            "or their kinds differ; name the tip of the same arm"
        )


def _base(chain: SerialChain, frames: Array, robot: Robot) -> Array:
    """Transform (4, 4) from the chain's base frame to the robot's; the identity where both have the same joint axes.

    A maker's file may start from another link than the URDF from which robot.toml was made.
    """
    at_zero = chain.at_zero
    axes = np.stack([frame @ axis_frame(joint) for frame, joint in zip(at_zero[:-1], chain.joints, strict=True)])
    stands = frames[: len(axes)]
    if _same_axes(axes, stands, robot.is_revolute):
        return np.eye(4)
    moved = _moved_onto(axes, stands, robot.is_revolute)
    return moved if _same_axes(moved @ axes, stands, robot.is_revolute) else np.eye(4)


def _across(frames: Array) -> Array:
    """Projections (n, 3, 3) onto the planes perpendicular to the z axes of frames (n, 4, 4)."""
    along = frames[:, :3, 2]
    return np.asarray(np.eye(3) - along[:, :, None] * along[:, None, :])


def _same_axes(axes: Array, frames: Array, turns: BoolArray) -> bool:
    """Whether the z axes of two sets of frames (n, 4, 4) are equal lines, or for sliding joints equal directions."""
    gap_mm = np.einsum("nij,nj->ni", _across(frames), axes[:, :3, 3] - frames[:, :3, 3])[turns]
    lean = np.abs(axes[:, :3, 2] - frames[:, :3, 2]).max()
    return bool(lean < _SAME_RAD and np.abs(gap_mm).max(initial=0.0) < _SAME_MM)


def _moved_onto(axes: Array, frames: Array, turns: BoolArray) -> Array:
    """Rigid motion (4, 4) of axes (n, 4, 4) onto the z axes of frames (n, 4, 4), by least squares."""
    turn = best_fit_rotation(axes[:, :3, 2], frames[:, :3, 2])
    across = _across(frames)[turns]
    if not len(across):
        return make_transform(turn, np.zeros(3))
    gap_mm = (frames[:, :3, 3] - axes[:, :3, 3] @ turn.T)[turns]
    shift_mm = np.linalg.pinv(across.sum(axis=0), rcond=1e-9) @ np.einsum("nij,nj->i", across, gap_mm)
    return make_transform(turn, shift_mm)


def _require_axis(chain: SerialChain, robot: Robot, i: int, frame_T_axis: Array) -> None:
    """Raise RobotFileError where an axis, given in its frame, is not the frame's z axis."""
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
