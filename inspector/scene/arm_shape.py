"""Simple solids for drawing an arm: a short cylinder for each joint along its axis, cylinders for links and tool.

A row of the table leads from one frame to the next in two straight pieces, d along the joint's axis and a across it, so
each link is drawn as at most two cylinders with a ball at the knee between them. Thickness means nothing: it follows
the arm's reach. Everything is mm in the base frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib import frames
from calib.array_types import Array
from calib.calibration.model_versions import Version
from calib.dataset.dataset import Poses
from calib.effects.state import RobotState
from calib.fitting.model import Model
from calib.kinematics.robot import Robot
from calib.workcell.bodies.arm_bodies import reach_mm

THICKNESS = 0.040  # radius of the first joint over the arm's reach
LAST_THICKNESS = 0.45  # radius of the last joint over that of the first
JOINT_LENGTH = 2.4  # over its radius
LINK_THICKNESS = 0.72  # radius of a link over that of its joint
TOOL_THICKNESS = 0.35


@dataclass(frozen=True)
class ArmShape:
    """The solids of an arm at one pose: K cylinders, B balls; n links.

    `part` says what a cylinder is: "revolute" or "prismatic" for joints, "link", or "tool". `link` is the index of the
    joint that moves it (n for the tool), so that a link which has a mesh can be left out.
    """

    start_mm: Array  # (K, 3)
    end_mm: Array  # (K, 3)
    radius_mm: Array  # (K,)
    part: NDArray[np.str_]  # (K,)
    link: NDArray[np.int64]  # (K,)
    ball_mm: Array  # (B, 3)
    ball_radius_mm: Array  # (B,)
    ball_link: NDArray[np.int64]  # (B,)
    base_T_link: Array  # (n, 4, 4) the frames in which links' meshes are given
    tip_mm: Array  # (3,) the tool point

    def moved(self, a_T_base: ArrayLike) -> ArmShape:
        """The same solids expressed in frame a, for example the scanner's."""
        a_T_base = np.asarray(a_T_base, dtype=float)
        return ArmShape(
            frames.apply(a_T_base, self.start_mm),
            frames.apply(a_T_base, self.end_mm),
            self.radius_mm,
            self.part,
            self.link,
            frames.apply(a_T_base, self.ball_mm),
            self.ball_radius_mm,
            self.ball_link,
            a_T_base @ self.base_T_link,
            frames.apply(a_T_base, self.tip_mm),
        )


def arm_shape(model: Model, x: ArrayLike, poses: Poses, pose: int, flange_T_scanner: Array | None = None) -> ArmShape:
    """Solids of the model's arm at parameters x (P,) and one of the poses, with all effects on the arm applied.

    The frames are those of the model, so the arm stands where its prediction says; effects that only move what the
    scanner reports leave it alone. `flange_T_scanner` (4, 4): of a scanner that it carries.
    """
    state = model.state(x, poses)
    robot = model.robot
    solids = _Solids(robot, 1e-3 * reach_mm(robot))
    base_T_frame = _row(state.chain.base_T_frame, pose)
    turned_x = _row(state.chain.turned_x, pose)
    for i in range(robot.n_joints + 1):
        solids.add_link(i, base_T_frame[i], base_T_frame[i + 1], turned_x[i])
    flange = base_T_frame[-2]
    on_arm = [target.name for target in robot.targets if not target.in_world]
    carried = [state.target_offsets_mm[name] for name in on_arm]
    if flange_T_scanner is not None:
        carried.append(flange_T_scanner[:3, 3])
    for offset_mm in carried:
        solids.strut(robot.n_joints, flange[:3, 3], frames.apply(flange, offset_mm), "tool")
    return solids.shape(base_T_frame).moved(_base_motion(state, pose))


def arm_of(version: Version, pose: int) -> ArmShape | None:
    """Solids of the arm at a pose, in the scanner's frame; None where the pose's setup has no points."""
    poses, scanner_T_base = version.calibration.dataset.poses, version.scanner_T_base[pose]
    if not np.isfinite(scanner_T_base).all():
        return None
    carried = version.flange_T_scanner(pose)
    return arm_shape(version.model, version.x, poses, pose, carried).moved(scanner_T_base)


def _row(values: Array, pose: int) -> Array:
    """Values of one pose, from an array with a row for each pose or one row for all poses."""
    return values[pose if len(values) > 1 else 0]


def _base_motion(state: RobotState, pose: int) -> Array:
    """Motion of the base at a pose by the model's effects (`RobotState.place`), as a transform (4, 4)."""
    turn = frames.rotation_from_rotvec(_row(state.base_rotvec_rad, pose))
    return frames.make_transform(turn, _row(state.displacement_mm, pose))


class _Solids:
    """Collector of the cylinders and balls of an arm."""

    def __init__(self, robot: Robot, shortest_mm: float) -> None:
        self._robot, self._shortest_mm = robot, shortest_mm
        first = THICKNESS * reach_mm(robot)
        self._joint_radius = np.linspace(first, LAST_THICKNESS * first, robot.n_joints + 1)
        self._cylinders: list[tuple[Array, Array, float, str, int]] = []
        self._balls: list[tuple[Array, float, int]] = []

    def add_link(self, i: int, previous: Array, current: Array, turned_x: Array) -> None:
        """Add joint i and its link, or the tool, between two frames (4, 4); x_axis (3,): x after the joint's turn."""
        start, axis, end = previous[:3, 3], previous[:3, 2], current[:3, 3]
        if i < self._robot.n_joints:
            radius = float(self._joint_radius[i])
            half = 0.5 * JOINT_LENGTH * radius * axis
            part = "revolute" if self._robot.joints[i].is_revolute else "prismatic"
            self._cylinders.append((start - half, start + half, radius, part, i))
        part = "link" if i < self._robot.n_joints else "tool"
        knee = end - float((end - start) @ turned_x) * turned_x
        self.strut(i, start, knee, part)
        self.strut(i, knee, end, part)
        if min(np.linalg.norm(knee - start), np.linalg.norm(end - knee)) > self._shortest_mm:
            self._balls.append((knee, self._thickness(i, part), i))

    def strut(self, i: int, start: Array, end: Array, part: str) -> None:
        """Add one straight piece, unless its length is zero."""
        if np.linalg.norm(end - start) > self._shortest_mm:
            self._cylinders.append((start, end, self._thickness(i, part), part, i))

    def _thickness(self, i: int, part: str) -> float:
        share = TOOL_THICKNESS if part == "tool" else LINK_THICKNESS
        return share * float(self._joint_radius[i])

    def shape(self, base_T_frame: Array) -> ArmShape:
        start, end, radius, part, link = zip(*self._cylinders, strict=True)
        return ArmShape(
            np.array(start),
            np.array(end),
            np.array(radius),
            np.array(part),
            np.array(link),
            np.array([b[0] for b in self._balls]).reshape(-1, 3),
            np.array([b[1] for b in self._balls], dtype=float),
            np.array([b[2] for b in self._balls], dtype=np.int64),
            base_T_frame[1:-1],
            base_T_frame[-1, :3, 3],
        )
