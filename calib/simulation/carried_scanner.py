"""Poses for scans by a scanner on the flange, of a jig that is fixed in the world.

They are computed on the nominal chain, as those of `calib.simulation.pose_design` for a scanner in the world are. The
jig is on a table before the arm, its axis up to 35 deg from the vertical.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.array_types import Array, BoolArray
from calib.errors import CalibError
from calib.frames import apply, invert, make_transform, rotation_from_rotvec
from calib.jig import Jig, jig_geometry
from calib.kinematics.chain import Chain, nominal_chain
from calib.kinematics.inverse import FROM_ANYWHERE, solve_inverse
from calib.kinematics.joint_range import joint_range, random_poses, wrapped
from calib.kinematics.robot import Robot
from calib.simulation.scene import CUBE_CORNER
from calib.workcell.measurable import incidence_cosines
from calib.workcell.scan_field import JANG_FIELD, tilted
from calib.workcell.view_of_target import ViewGoals

_JIG_TRIES = 14  # positions of the jig that are tried
_BATCH = 256  # starts of the search for poses
_GOOD_SHARE = 0.1  # of them that succeed at a position that is taken at once
_MAX_TILT_DEG = 22.0  # of the jig's axis from the line of sight
_CLEARANCE_MM = 120.0  # of the arm's frames from the line of sight
_LOWEST_MM = 60.0  # height of the arm's frames over its base


def draw_jig_in_view(
    robot: Robot, flange_T_scanner: Array, *, rng: np.random.Generator, jig: Jig = CUBE_CORNER
) -> Array:
    """Random base_T_jig (4, 4): on a table before the arm, tilted by up to 35 deg, in view from many poses.

    Raises:
        CalibError: no pose has it in view.
    """
    reach_mm = float(
        np.linalg.norm(
            nominal_chain(robot, random_poses(robot, 2000, rng=np.random.default_rng(0))).target_mm,
            axis=1,
        ).max()
    )
    best, most = np.eye(4), 0
    for _ in range(_JIG_TRIES):
        place_mm = reach_mm * rng.uniform([0.3, -0.25, -0.15], [0.65, 0.25, 0.1])
        outward = tilted(np.array([[0.0, 0.0, 1.0]]), 35.0, rng)[0]
        base_T_jig = make_transform(_turn_with_z(-outward, rng.uniform(-np.pi, np.pi)), place_mm)
        count = len(_poses_in_view(robot, flange_T_scanner, base_T_jig, rng=rng, jig=jig))
        if count > most:
            best, most = base_T_jig, count
        if most >= _GOOD_SHARE * _BATCH:
            break
    if not most:
        raise CalibError(
            f"robot {robot.name}: with the scanner on its flange no pose looks at a jig on a table before it, at "
            f"{_JIG_TRIES} places tried; check its limits, or simulate points instead of scans"
        )
    return best


def poses_with_jig_in_view(
    robot: Robot,
    flange_T_scanner: Array,
    base_T_jig: Array,
    count: int,
    *,
    rng: np.random.Generator,
    jig: Jig = CUBE_CORNER,
) -> Array:
    """Random poses (count, n) with the jig in the scanner's field and all three faces turned towards the scanner.

    Raises:
        CalibError: too few such poses exist.
    """
    batches: list[Array] = []
    total = tries = 0
    while total < count:
        if tries > 20 + count:
            raise CalibError(
                f"robot {robot.name}: found {total} of {count} poses that look at the jig; ask for fewer, or simulate "
                "points instead of scans"
            )
        batches.append(_poses_in_view(robot, flange_T_scanner, base_T_jig, rng=rng, jig=jig))
        total, tries = total + len(batches[-1]), tries + 1
    return np.concatenate(batches)[:count]


def _poses_in_view(
    robot: Robot, flange_T_scanner: Array, base_T_jig: Array, *, rng: np.random.Generator, jig: Jig
) -> Array:
    """Poses (K, n) with the jig in view that result from `_BATCH` random goals and starts."""
    apex_mm = JANG_FIELD.draw(_BATCH, rng)  # scanner frame
    axis = tilted(apex_mm / np.linalg.norm(apex_mm, axis=1, keepdims=True), _MAX_TILT_DEG, rng)
    goals = ViewGoals(
        robot, apply(flange_T_scanner, apex_mm), axis @ flange_T_scanner[:3, :3].T, base_T_jig[:3, 3], base_T_jig[:3, 2]
    )
    start = random_poses(robot, _BATCH, rng=rng)
    anywhere = np.full_like(start, np.inf)
    longest = FROM_ANYWHERE.longest_step if robot.is_revolute.all() else np.inf
    rule = replace(FROM_ANYWHERE, longest_step=longest, by_normal_equations=True)
    q = solve_inverse(goals, start, -anywhere, anywhere, rule)
    low, high = joint_range(robot)
    chain = nominal_chain(robot, q)
    usable = goals.reached(chain)
    q = np.where(robot.is_revolute, wrapped(q, low), q)
    usable &= np.all((q >= low) & (q <= high), axis=1)
    base_T_scanner = chain.base_T_flange @ flange_T_scanner
    usable &= _is_clear(chain, base_T_scanner, base_T_jig[:3, 3])
    for k in np.flatnonzero(usable):
        cosine = incidence_cosines(base_T_jig[None], jig_geometry(jig)[1], base_T_scanner[k, :3, 3])
        usable[k] = bool(np.all(cosine > np.cos(np.radians(JANG_FIELD.max_incidence_deg))))
    return q[usable]


def _is_clear(chain: Chain, base_T_scanner: Array, apex_mm: Array) -> BoolArray:
    """Mask (N,) of the poses with all frames and the scanner above the base, and no frame near the line of sight.

    Frames as near to the scanner as its flange are beside its lens and do not count. A check on frame origins only: it
    rejects folded arms and is no collision check.
    """
    origins_mm = chain.base_T_frame[:, 1:-1, :3, 3]  # (N, n, 3)
    clear = np.all(origins_mm[:, 1:, 2] > _LOWEST_MM, axis=1) & (base_T_scanner[:, 2, 3] > _LOWEST_MM)
    for k in np.flatnonzero(clear):
        seen_mm = apply(invert(base_T_scanner[k]), np.concatenate([origins_mm[k], apex_mm[None]]))
        sight = seen_mm[-1] / np.linalg.norm(seen_mm[-1])
        along_mm = seen_mm[:-1] @ sight
        aside_mm = np.linalg.norm(seen_mm[:-1] - along_mm[:, None] * sight, axis=1)
        clear[k] = not np.any((along_mm > _CLEARANCE_MM) & (aside_mm < _CLEARANCE_MM))
    return np.asarray(clear)


def _turn_with_z(z: Array, about_rad: float) -> Array:
    """Rotation (3, 3) with a given z axis and a given angle about that axis."""
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return rotation_from_rotvec(about_rad * z) @ np.column_stack([x, np.cross(z, x), z])
