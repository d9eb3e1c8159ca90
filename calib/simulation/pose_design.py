"""Commanded joint vectors: poses with the jig in the scanner's view, and poses over the whole work space.

They are computed on the nominal chain; the true positions follow from `calib.simulation.truth.equilibrium`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.array_types import Array, BoolArray
from calib.errors import CalibError
from calib.frames import apply, invert, make_transform, rotation_from_rotvec
from calib.jig import Jig, jig_geometry
from calib.kinematics.chain import Chain, nominal_chain
from calib.kinematics.inverse import FROM_ANYWHERE, solve_inverse
from calib.kinematics.joint_range import joint_range, random_poses, wrapped
from calib.kinematics.robot import Robot
from calib.simulation.scene import CUBE_CORNER
from calib.workcell.jig_on_tool import JigGoals, jig_outward, target_T_jig
from calib.workcell.measurable import incidence_cosines
from calib.workcell.scan_field import JANG_FIELD, tilted
from calib.workcell.scanner_place import in_front

MAX_TILT_DEG = 22.0  # of the jig's axis from the line of sight, where poses are drawn


def draw_scanner_pose(robot: Robot, *, rng: np.random.Generator) -> Array:
    """Random base_T_scanner (4, 4): before the arm, facing the middle of its reach, up to 4 deg off about each axis."""
    middle_mm, looking_back = in_front(robot)
    tilt_rad = np.radians(rng.uniform(-4.0, 4.0, 3))
    turn = rotation_from_rotvec(tilt_rad) @ looking_back
    return make_transform(turn, middle_mm - JANG_FIELD.distance_mm * turn[:, 2])


def draw_flange_mount(*, rng: np.random.Generator) -> Array:
    """Random flange_T_scanner (4, 4): up to 80 mm off the flange's axis, 20 to 120 mm before it, up to 40 deg."""
    axis = rng.standard_normal(3)
    turn = rotation_from_rotvec(np.radians(rng.uniform(0.0, 40.0)) * axis / np.linalg.norm(axis))
    return make_transform(turn, rng.uniform([-80.0, -80.0, 20.0], [80.0, 80.0, 120.0]))


def draw_jig_place(robot: Robot, *, rng: np.random.Generator) -> Array:
    """Random base_T_jig (4, 4): within 200 mm along each axis of the middle of the reach, in any orientation."""
    middle_mm, _ = in_front(robot)
    axis = rng.standard_normal(3)
    turn = rotation_from_rotvec(rng.uniform(0.0, np.pi) * axis / np.linalg.norm(axis))
    return make_transform(turn, middle_mm + rng.uniform(-200.0, 200.0, 3))


def draw_setups(base_T_scanner: Array, count: int, *, rng: np.random.Generator) -> dict[str, Array]:
    """Setups "A", "B", ... by base_T_scanner: the given one, then others up to 60 deg around the base and 200 mm off.

    For a scanner on the flange by flange_T_scanner, around the flange.
    """
    places = {"A": base_T_scanner}
    for k in range(1, count):
        around_rad = np.array([0.0, 0.0, np.radians(rng.uniform(-60.0, 60.0))])
        around = make_transform(rotation_from_rotvec(around_rad), rng.uniform(-200.0, 200.0, 3))
        places[chr(ord("A") + k) if k < 26 else f"S{k + 1}"] = around @ base_T_scanner
    return places


def facing_poses(robot: Robot, base_T_scanner: Array, count: int, *, rng: np.random.Generator) -> Array:
    """Random poses (count, n) with the jig turned towards the scanner: less than 75 deg from the line of sight.

    Raises:
        CalibError: too few poses have it so.
    """
    q = random_poses(robot, 20 * count, rng=rng)
    chain = nominal_chain(robot, q)
    ray = chain.target_mm - base_T_scanner[:3, 3]
    towards = -jig_outward(robot) * np.sum(chain.base_T_frame[:, -1, :3, 2] * ray, axis=1)
    q = q[towards > np.cos(np.radians(75.0)) * np.linalg.norm(ray, axis=1)]
    if len(q) < count:
        raise CalibError(
            f"robot {robot.name}: found {len(q)} of {count} poses that turn the jig at the scanner; use other limits"
        )
    return q[:count]


def spread_poses(q: Array, count: int) -> NDArray[np.intp]:
    """Indices of `count` of the joint vectors q (M, n) that are far apart, angles being compared modulo 2 pi.

    Farthest-point selection, starting from row 0.
    """
    on_circles = np.concatenate([np.cos(q), np.sin(q)], axis=1)
    chosen = [0]
    nearest = np.linalg.norm(on_circles - on_circles[0], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(on_circles - on_circles[chosen[-1]], axis=1))
    return np.array(chosen)


def scan_poses(
    robot: Robot,
    base_T_scanner: ArrayLike,
    count: int,
    *,
    rng: np.random.Generator,
    jig: Jig = CUBE_CORNER,
    start_q: ArrayLike | None = None,
) -> Array:
    """Random poses (count, n) that hold the jig in the scanner's field with all three faces turned towards the scanner.

    Apex and jig axis are drawn, the turn about the axis is free, and the joints follow by damped least squares from
    random starts: over the whole range, or some 0.4 rad around one of `start_q` (S, n), which keeps its configuration.

    Raises:
        CalibError: too few such poses exist.
    """
    batches: list[Array] = []
    tried = total = 0
    while total < count:
        if tried >= 40 * count + 20_000 or (tried >= 4096 and total == 0):
            raise CalibError(
                f"robot {robot.name}: found {total} of {count} poses that turn the jig at the scanner "
                f"in {tried} tries; check its limits and tool row, or simulate points instead of scans"
            )
        batch = 512
        tried += batch
        apex_mm = JANG_FIELD.draw(batch, rng)
        axis = tilted(apex_mm / np.linalg.norm(apex_mm, axis=1, keepdims=True), MAX_TILT_DEG, rng)
        q = random_poses(robot, batch, rng=rng)
        if start_q is not None:
            starts = np.atleast_2d(np.asarray(start_q, dtype=float))
            q = starts[rng.integers(len(starts), size=batch)] + 0.4 * rng.standard_normal(q.shape)
        batches.append(usable_poses(robot, np.asarray(base_T_scanner, float), apex_mm, axis, q, jig))
        total += len(batches[-1])
    return np.concatenate(batches)[:count]


def usable_poses(robot: Robot, base_T_scanner: Array, apex_mm: Array, axis: Array, q: Array, jig: Jig) -> Array:
    """Joint vectors that reach their goals, within limits, clear of obstacles, with all faces in view."""
    outward = -axis @ base_T_scanner[:3, :3].T
    along_z = np.array([0.0, 0.0, jig_outward(robot)])
    goals = JigGoals(robot, along_z, apply(base_T_scanner, apex_mm), outward)
    rule = FROM_ANYWHERE if robot.is_revolute.all() else replace(FROM_ANYWHERE, longest_step=np.inf)
    anywhere = np.full_like(q, np.inf)
    q = solve_inverse(goals, q, -anywhere, anywhere, rule)
    reached = goals.reached(q)
    low, high = joint_range(robot)
    q = np.where(robot.is_revolute, wrapped(q, low), q)
    reached &= np.all((q >= low) & (q <= high), axis=1)
    chain = nominal_chain(robot, q)
    _, normals = jig_geometry(jig)
    base_T_jig = chain.base_T_frame[:, -1] @ target_T_jig(robot)
    cos_incidence = incidence_cosines(base_T_jig, normals, base_T_scanner[:3, 3])
    seen = np.all(cos_incidence > np.cos(np.radians(JANG_FIELD.max_incidence_deg)), axis=1)
    return q[reached & seen & _is_clear(robot, chain, base_T_scanner)]


def _is_clear(robot: Robot, chain: Chain, base_T_scanner: Array) -> BoolArray:
    """Mask (N,) of poses with frames above the table, wrist off the base column, and no frame in front of the jig.

    A check on frame origins only: it rejects folded arms and is no collision check.
    """
    origins_mm = chain.base_T_frame[:, 1:-1, :3, 3]  # (N, n, 3)
    above = np.all(origins_mm[:, 1:, 2] > 60.0, axis=1)
    wrist_off = np.all(np.linalg.norm(origins_mm[:, -2:, :2], axis=2) > 150.0, axis=1)
    scanner_T_base = invert(base_T_scanner)
    depth_mm = apply(scanner_T_base, origins_mm.reshape(-1, 3))[:, 2].reshape(origins_mm.shape[:2])
    apex_depth_mm = apply(scanner_T_base, chain.target_mm)[:, 2]
    behind = np.all(depth_mm > apex_depth_mm[:, None] - 1e-6, axis=1)
    return above & wrist_off & behind if robot.n_joints > 3 else above
