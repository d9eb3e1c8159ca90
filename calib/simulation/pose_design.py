"""Commanded joint vectors: poses with the jig in the scanner's view, and poses over the whole work space.

They are computed on the nominal chain; the true positions follow from `calib.simulation.truth.equilibrium`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.array_types import Array, BoolArray
from calib.errors import CalibError
from calib.frames import apply, invert, make_transform, rotation_from_rotvec
from calib.jig import Jig, jig_geometry
from calib.kinematics.chain import Chain, nominal_chain
from calib.kinematics.inverse import FROM_ANYWHERE, solve_inverse
from calib.kinematics.joint_range import joint_range, random_poses, wrapped
from calib.kinematics.robot import Robot
from calib.kinematics.tool_point import tip_T_last
from calib.simulation.scanner import CUBE_CORNER
from calib.workcell.candidates import PointingGoals
from calib.workcell.jig_on_tool import jig_outward, target_T_jig
from calib.workcell.measurable import incidence_cosines
from calib.workcell.scan_field import JANG_FIELD, tilted
from calib.workcell.scanner_place import in_front, random_reach_mm

MAX_TILT_DEG = 22.0  # of the jig's axis from the line of sight, where poses are drawn
_BATCH, _BATCH_IN_ROOM = 512, 256  # goals and starts at once, of a jig on the arm and of one in the room
_JIG_TRIES = 14  # positions of a jig in the room that are tried
_GOOD_SHARE = 0.1  # of a batch that succeeds at a position that is taken at once
_CLEARANCE_MM = 120.0  # of the arm's frames from the line of sight of a scanner on the flange
_LOWEST_MM = 60.0  # height of the arm's frames over its base


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
    parent_T_scanner: Array,
    count: int,
    *,
    rng: np.random.Generator,
    jig: Jig = CUBE_CORNER,
    base_T_jig: Array | None = None,
    start_q: Array | None = None,
) -> Array:
    """Random poses (count, n) with the jig in the scanner's field and all three faces turned towards the scanner.

    Apex and jig axis are drawn, the turn about the axis is free, and the joints follow by damped least squares from
    random starts: over the whole range, or some 0.4 rad around one of `start_q` (S, n), which keeps its configuration.

    Args:
        parent_T_scanner: (4, 4) in the base frame, or in the flange's where the jig is fixed in the room.
        base_T_jig: (4, 4) of a jig fixed in the room; None: it is on the arm.

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
        batches.append(_drawn_poses(robot, parent_T_scanner, rng, jig, base_T_jig, start_q))
        tried, total = tried + _BATCH, total + len(batches[-1])
    return np.concatenate(batches)[:count]


def _drawn_poses(
    robot: Robot,
    parent_T_scanner: Array,
    rng: np.random.Generator,
    jig: Jig,
    base_T_jig: Array | None,
    start_q: Array | None = None,
) -> Array:
    """Usable poses (K, n) that result from one batch of random goals and starts, see `scan_poses`."""
    batch = _BATCH if base_T_jig is None else _BATCH_IN_ROOM
    apex_mm = JANG_FIELD.draw(batch, rng)
    axis = tilted(apex_mm / np.linalg.norm(apex_mm, axis=1, keepdims=True), MAX_TILT_DEG, rng)
    q = random_poses(robot, batch, rng=rng)
    if start_q is not None:
        q = start_q[rng.integers(len(start_q), size=batch)] + 0.4 * rng.standard_normal(q.shape)
    return usable_poses(robot, parent_T_scanner, apex_mm, axis, q, jig, base_T_jig)


def usable_poses(
    robot: Robot,
    parent_T_scanner: Array,
    apex_mm: Array,
    axis: Array,
    q: Array,
    jig: Jig,
    base_T_jig: Array | None = None,
) -> Array:
    """Joint vectors that reach their goals from starts q, within limits, clear of obstacles, with all faces in view.

    The goals are apexes and axes of the jig (N, 3), in the scanner's frame.
    """
    place_mm, along = apply(parent_T_scanner, apex_mm), axis @ parent_T_scanner[:3, :3].T
    if base_T_jig is None:
        flange_T_jig = invert(tip_T_last(robot)) @ target_T_jig(robot)
        goals = PointingGoals(robot, flange_T_jig[:3, 3], flange_T_jig[:3, 2], place_mm, along)
    else:
        goals = PointingGoals(robot, place_mm, along, base_T_jig[:3, 3], base_T_jig[:3, 2])
    longest = FROM_ANYWHERE.longest_step if robot.is_revolute.all() else np.inf
    anywhere = np.full_like(q, np.inf)
    rule = replace(FROM_ANYWHERE, longest_step=longest, by_normal_equations=True)
    q = solve_inverse(goals, q, -anywhere, anywhere, rule)
    low, high = joint_range(robot)
    usable = goals.reached(nominal_chain(robot, q))
    q = np.where(robot.is_revolute, wrapped(q, low), q)
    q = q[usable & np.all((q >= low) & (q <= high), axis=1)]
    chain = nominal_chain(robot, q)
    if base_T_jig is None:
        base_T_scanner = np.broadcast_to(parent_T_scanner, (len(q), 4, 4))
        placed = chain.base_T_frame[:, -1] @ target_T_jig(robot)
        clear = _holds_clear(robot, chain, parent_T_scanner)
    else:
        base_T_scanner = chain.base_T_flange @ parent_T_scanner
        placed = np.broadcast_to(base_T_jig, (len(q), 4, 4))
        clear = _looks_clear(chain, base_T_scanner, base_T_jig[:3, 3])
    cosine = incidence_cosines(placed, jig_geometry(jig)[1], base_T_scanner[:, :3, 3])
    return q[clear & np.all(cosine > np.cos(np.radians(JANG_FIELD.max_incidence_deg)), axis=1)]


def _holds_clear(robot: Robot, chain: Chain, base_T_scanner: Array) -> BoolArray:
    """Mask (N,) of poses with frames above the table, wrist off the base column, and no frame in front of the jig.

    A check on frame origins only, as the next: it rejects folded arms and is no collision check.
    """
    origins_mm = chain.base_T_frame[:, 1:-1, :3, 3]  # (N, n, 3)
    above = np.all(origins_mm[:, 1:, 2] > _LOWEST_MM, axis=1)
    wrist_off = np.all(np.linalg.norm(origins_mm[:, -2:, :2], axis=2) > 150.0, axis=1)
    scanner_T_base = invert(base_T_scanner)
    apex_depth_mm = apply(scanner_T_base, chain.target_mm)[:, 2]
    behind = np.all(apply(scanner_T_base, origins_mm)[..., 2] > apex_depth_mm[:, None] - 1e-6, axis=1)
    return above & wrist_off & behind if robot.n_joints > 3 else above


def _looks_clear(chain: Chain, base_T_scanner: Array, apex_mm: Array) -> BoolArray:
    """Mask (N,) of the poses with all frames and the scanner above the base, and no frame near the line of sight.

    Frames as near to the scanner as its flange are beside its lens and do not count.
    """
    origins_mm = chain.base_T_frame[:, 1:-1, :3, 3]  # (N, n, 3)
    above = np.all(origins_mm[:, 1:, 2] > _LOWEST_MM, axis=1) & (base_T_scanner[:, 2, 3] > _LOWEST_MM)
    from_eye_mm = origins_mm - base_T_scanner[:, None, :3, 3]
    sight = apex_mm - base_T_scanner[:, :3, 3]
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    along_mm = np.einsum("nki,ni->nk", from_eye_mm, sight)
    aside_mm = np.linalg.norm(from_eye_mm - along_mm[..., None] * sight[:, None], axis=2)
    return np.asarray(above & ~np.any((along_mm > _CLEARANCE_MM) & (aside_mm < _CLEARANCE_MM), axis=1))


def draw_jig_in_view(
    robot: Robot, flange_T_scanner: Array, *, rng: np.random.Generator, jig: Jig = CUBE_CORNER
) -> Array:
    """Random base_T_jig (4, 4): on a table before the arm, tilted by up to 35 deg, in view of a scanner on the flange.

    Raises:
        CalibError: no pose has it in view.
    """
    best, most = np.eye(4), 0
    for _ in range(_JIG_TRIES):
        place_mm = random_reach_mm(robot) * rng.uniform([0.3, -0.25, -0.15], [0.65, 0.25, 0.1])
        z = -tilted(np.array([[0.0, 0.0, 1.0]]), 35.0, rng)[0]
        x = np.cross([0.0, 1.0, 0.0], z)
        x /= np.linalg.norm(x)
        about = rotation_from_rotvec(rng.uniform(-np.pi, np.pi) * z)
        base_T_jig = make_transform(about @ np.column_stack([x, np.cross(z, x), z]), place_mm)
        count = len(_drawn_poses(robot, flange_T_scanner, rng, jig, base_T_jig))
        if count > most:
            best, most = base_T_jig, count
        if most >= _GOOD_SHARE * _BATCH_IN_ROOM:
            break
    if most:
        return best
    raise CalibError(
        f"robot {robot.name}: with the scanner on its flange no pose looks at a jig on a table before it, at "
        f"{_JIG_TRIES} places tried; check its limits, or simulate points instead of scans"
    )
