"""Simple solids for drawing an arm: a short cylinder for each joint along its axis, cylinders for links and tool.

A row of the table leads from one frame to the next in two straight pieces, d along the joint's axis and a across it, so
each link is drawn as at most two cylinders with a ball at the knee between them. Thickness means nothing: it follows
the arm's reach. Everything is mm in the base frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib import frames
from calib.array_types import Array
from calib.calibration.model_versions import Version
from calib.dataset.dataset import Poses
from calib.effects.state import RobotState
from calib.fitting.model import Model
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
        start_mm, end_mm, ball_mm, tip_mm = (
            frames.apply(a_T_base, places) for places in (self.start_mm, self.end_mm, self.ball_mm, self.tip_mm)
        )
        base_T_link = np.asarray(a_T_base, dtype=float) @ self.base_T_link
        return replace(self, start_mm=start_mm, end_mm=end_mm, ball_mm=ball_mm, tip_mm=tip_mm, base_T_link=base_T_link)


def arm_shape(model: Model, x: ArrayLike, poses: Poses, pose: int, flange_T_scanner: Array | None = None) -> ArmShape:
    """Solids of the model's arm at parameters x (P,) and one of the poses, with all effects on the arm applied.

    The frames are those of the model, so the arm stands where its prediction says; effects that only move what the
    scanner reports leave it alone. `flange_T_scanner` (4, 4): of a scanner that it carries.
    """
    state = model.state(x, poses)
    robot, n = model.robot, model.robot.n_joints
    base_T_frame, turned_x = _row(state.chain.base_T_frame, pose), _row(state.chain.turned_x, pose)
    shortest_mm, first = 1e-3 * reach_mm(robot), THICKNESS * reach_mm(robot)
    joint_radius = np.linspace(first, LAST_THICKNESS * first, n + 1)
    radius = joint_radius * np.append(np.full(n, LINK_THICKNESS), TOOL_THICKNESS)
    # Each row of the table: along the joint's axis to the knee, then across it.
    start, end, every = base_T_frame[:-1, :3, 3], base_T_frame[1:, :3, 3], np.arange(n + 1)
    knee = end - np.sum((end - start) * turned_x, axis=1)[:, None] * turned_x
    bends = np.minimum(*(np.linalg.norm(knee - other, axis=1) for other in (start, end))) > shortest_mm
    half = 0.5 * JOINT_LENGTH * joint_radius[:-1, None] * base_T_frame[:-2, :3, 2]
    on_arm = [target.name for target in robot.targets if not target.in_world]
    carried = [state.target_offsets_mm[name] for name in on_arm]
    if flange_T_scanner is not None:
        carried.append(flange_T_scanner[:3, 3])
    held = frames.apply(base_T_frame[-2], np.reshape(carried, (-1, 3)))
    starts = np.concatenate([start[:-1] - half, start, knee, np.broadcast_to(base_T_frame[-2, :3, 3], held.shape)])
    ends = np.concatenate([start[:-1] + half, knee, end, held])
    link = np.concatenate([every[:-1], every, every, np.full(len(held), n)])
    part = np.where(link == n, "tool", "link").astype("<U9")
    part[:n] = np.where(robot.is_revolute, "revolute", "prismatic")
    thick = np.where(np.arange(len(link)) < n, joint_radius[link], radius[link])
    kept = np.flatnonzero((np.arange(len(link)) < n) | (np.linalg.norm(ends - starts, axis=1) > shortest_mm))
    kept = kept[np.argsort(link[kept], kind="stable")]
    return ArmShape(
        starts[kept],
        ends[kept],
        thick[kept],
        part[kept],
        link[kept],
        knee[bends],
        radius[bends],
        every[bends],
        base_T_frame[1:-1],
        base_T_frame[-1, :3, 3],
    ).moved(_base_motion(state, pose))


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
