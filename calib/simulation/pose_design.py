"""Commanded joint vectors: poses whose jig the scanner can see, and poses over the whole work space.

They are computed on the nominal chain; where the true arm then stands follows from
`calib.simulation.truth.equilibrium`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.array_types import Array, BoolArray, IndexArray
from calib.errors import CalibError
from calib.frames import apply, invert, make_transform, rotation_from_rotvec
from calib.jig import Jig, jig_geometry
from calib.kinematics.chain import Chain, forward, joint_jacobian
from calib.kinematics.inverse import FROM_ANYWHERE, solve_inverse
from calib.kinematics.robot import Robot
from calib.simulation.scene import CUBE_CORNER


@dataclass(frozen=True)
class ScanField:
    """The scanner's field and the steepest incidence on a face (Jang 2025: 450 mm field, 700 mm away)."""

    distance_mm: float = 700.0
    width_mm: float = 450.0
    height_mm: float = 360.0
    depth_mm: float = 280.0
    margin_mm: float = 60.0  # the apex keeps this far from the field's sides, so that the jig is inside
    max_incidence_deg: float = 65.0
    max_tilt_deg: float = 22.0  # of the jig's axis from the line of sight


JANG_FIELD = ScanField()
_LEVER_MM = 300.0  # weighs one radian of the jig's axis against millimetres


def jig_outward(robot: Robot) -> float:
    """+1 or -1: the side of the tool frame's z axis to which the jig's apex points, away from the flange."""
    return -1.0 if robot.tool.d_mm < 0 else 1.0


def target_T_jig(robot: Robot) -> Array:
    """(4, 4) the jig's frame (apex, z into the material) in the tool frame, whose origin is the apex too."""
    return make_transform(np.diag([1.0, -jig_outward(robot), -jig_outward(robot)]), np.zeros(3))


def draw_scanner_pose(robot: Robot, *, rng: np.random.Generator) -> Array:
    """base_T_scanner (4, 4): in front of the arm, facing the middle of its reach, up to 4 deg off about each axis."""
    q = random_poses(robot, 2000, rng=np.random.default_rng(0))
    reach_mm = float(
        np.linalg.norm(forward(robot.table, q, robot.is_revolute, robot.base_T_first).target_mm, axis=1).max()
    )
    middle_mm = np.array([0.47 * reach_mm, 0.0, 0.42 * reach_mm])
    looking_back = np.array(
        [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    )  # columns: scanner x, y, z in base
    tilt_rad = np.radians(rng.uniform(-4.0, 4.0, 3))
    turn = rotation_from_rotvec(tilt_rad) @ looking_back
    return make_transform(turn, middle_mm - JANG_FIELD.distance_mm * turn[:, 2])


def draw_setups(base_T_scanner: Array, count: int, *, rng: np.random.Generator) -> dict[str, Array]:
    """Setups "A", "B", ... as base_T_scanner: the given one, then up to 60 deg around the base and 200 mm shifted."""
    places = {"A": base_T_scanner}
    for k in range(1, count):
        around_rad = np.array([0.0, 0.0, np.radians(rng.uniform(-60.0, 60.0))])
        around = make_transform(rotation_from_rotvec(around_rad), rng.uniform(-200.0, 200.0, 3))
        places[chr(ord("A") + k) if k < 26 else f"S{k + 1}"] = around @ base_T_scanner
    return places


def random_poses(robot: Robot, count: int, *, rng: np.random.Generator) -> Array:
    """(count, n) joints uniform within +-180 deg (Park 2022) and within their limits."""
    low, high = _limits(robot)
    return rng.uniform(low, high, (count, robot.n_joints))


def facing_poses(robot: Robot, base_T_scanner: Array, count: int, *, rng: np.random.Generator) -> Array:
    """(count, n) as `random_poses`, with the jig turned at the scanner: less than 75 deg from the line of sight.

    Raises:
        CalibError: too few poses are.
    """
    q = random_poses(robot, 20 * count, rng=rng)
    chain = forward(robot.table, q, robot.is_revolute, robot.base_T_first)
    ray = chain.target_mm - base_T_scanner[:3, 3]
    towards = -jig_outward(robot) * np.sum(chain.base_T_frame[:, -1, :3, 2] * ray, axis=1)
    q = q[towards > np.cos(np.radians(75.0)) * np.linalg.norm(ray, axis=1)]
    if len(q) < count:
        raise CalibError(
            f"robot {robot.name}: found {len(q)} of {count} poses that turn the jig at the scanner; use other limits"
        )
    return q[:count]


def spread_poses(q: Array, count: int) -> NDArray[np.intp]:
    """Indices of `count` rows of q (M, n) that lie far from each other on the circle of each joint.

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
    """(count, n) poses that hold the jig in the scanner's field with all three faces turned at it.

    Apex and jig axis are drawn, the turn about the axis is left to chance, and the joints follow by damped least
    squares from random starts: the whole range, or some 0.4 rad around one of `start_q` (S, n), which keeps to its
    configuration.

    Raises:
        CalibError: too few such poses exist.
    """
    found: list[Array] = []
    tried = total = 0
    while total < count:
        if tried >= 40 * count + 20_000 or (tried >= 4096 and total == 0):
            raise CalibError(
                f"robot {robot.name}: found {total} of {count} poses that turn the jig at the scanner "
                f"in {tried} tries; check its limits and tool row, or simulate points instead of scans"
            )
        batch = 512
        tried += batch
        apex_mm = _apexes(batch, rng)
        axis = _tilted(apex_mm / np.linalg.norm(apex_mm, axis=1, keepdims=True), rng)
        q = random_poses(robot, batch, rng=rng)
        if start_q is not None:
            starts = np.atleast_2d(np.asarray(start_q, dtype=float))
            q = starts[rng.integers(len(starts), size=batch)] + 0.4 * rng.standard_normal(q.shape)
        found.append(_usable(robot, np.asarray(base_T_scanner, float), apex_mm, axis, q, jig))
        total += len(found[-1])
    return np.concatenate(found)[:count]


def reach_apexes(
    robot: Robot,
    base_T_scanner: ArrayLike,
    apex_mm: ArrayLike,
    *,
    rng: np.random.Generator,
) -> Array:
    """(K, n) one pose for each wanted apex (K, 3) in the scanner's frame, under the same conditions as `scan_poses`.

    Raises:
        CalibError: an apex is out of reach.
    """
    out = []
    for wanted_mm in np.asarray(apex_mm, dtype=float):
        for _ in range(12):
            apexes = np.tile(wanted_mm, (256, 1))
            axis = _tilted(apexes / np.linalg.norm(apexes, axis=1, keepdims=True), rng)
            start = random_poses(robot, 256, rng=rng)
            q = _usable(robot, np.asarray(base_T_scanner, float), apexes, axis, start, CUBE_CORNER)
            if len(q):
                out.append(q[0])
                break
        else:
            raise CalibError(
                f"robot {robot.name}: cannot hold the jig at {np.round(wanted_mm, 1).tolist()} mm of the scanner; "
                "place the scanner elsewhere"
            )
    return np.array(out)


def _apexes(count: int, rng: np.random.Generator) -> Array:
    """(count, 3) apexes in the field's frustum, scanner frame."""
    depth_mm = JANG_FIELD.distance_mm + JANG_FIELD.depth_mm * rng.uniform(-0.5, 0.5, count)
    half = 0.5 * np.array([JANG_FIELD.width_mm, JANG_FIELD.height_mm]) - JANG_FIELD.margin_mm
    across = rng.uniform(-half, half, (count, 2)) * (depth_mm / JANG_FIELD.distance_mm)[:, None]
    return np.column_stack([across, depth_mm])


def _tilted(sight: Array, rng: np.random.Generator) -> Array:
    """Unit axes (N, 3) within the field's tilt of the lines of sight (N, 3), spread evenly over the cap."""
    cosine = rng.uniform(np.cos(np.radians(JANG_FIELD.max_tilt_deg)), 1.0, len(sight))
    azimuth = rng.uniform(-np.pi, np.pi, len(sight))
    across = np.cross(sight, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(sight, across)
    sideways = np.cos(azimuth)[:, None] * across + np.sin(azimuth)[:, None] * other
    return np.asarray(cosine[:, None] * sight + np.sqrt(1.0 - cosine**2)[:, None] * sideways)


def _usable(robot: Robot, base_T_scanner: Array, apex_mm: Array, axis: Array, q: Array, jig: Jig) -> Array:
    """Solve for the joints and keep the rows that reach, within limits and clear of obstacles, with all faces seen."""
    outward = -axis @ base_T_scanner[:3, :3].T
    goals = _JigGoals(robot, apply(base_T_scanner, apex_mm), outward)
    rule = FROM_ANYWHERE if robot.is_revolute.all() else replace(FROM_ANYWHERE, longest_step=np.inf)
    anywhere = np.full_like(q, np.inf)
    q = solve_inverse(goals, q, -anywhere, anywhere, rule)
    reached = goals.reached(q)
    low, high = _limits(robot)
    q = np.where(robot.is_revolute, _wrapped(q, low), q)
    reached &= np.all((q >= low) & (q <= high), axis=1)
    chain = forward(robot.table, q, robot.is_revolute, robot.base_T_first)
    scanner_T_jig = invert(base_T_scanner) @ chain.base_T_frame[:, -1] @ target_T_jig(robot)
    _, normals = jig_geometry(jig)
    sight = scanner_T_jig[:, :3, 3] / np.linalg.norm(scanner_T_jig[:, :3, 3], axis=1, keepdims=True)
    cos_incidence = -np.einsum("nij,kj,ni->nk", scanner_T_jig[:, :3, :3], normals, sight)
    seen = np.all(cos_incidence > np.cos(np.radians(JANG_FIELD.max_incidence_deg)), axis=1)
    return q[reached & seen & _is_clear(robot, chain, base_T_scanner)]


def _is_clear(robot: Robot, chain: Chain, base_T_scanner: Array) -> BoolArray:
    """(N,) frames above the table, the wrist off the base column, and nothing of the arm between scanner and jig.

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


@dataclass(frozen=True)
class _JigGoals:
    """The jig's apex at N points and its axis along N directions; its turn about that axis does not matter."""

    robot: Robot
    apex_mm: Array  # (N, 3) base frame
    outward: Array  # (N, 3) unit, base frame: from the jig towards its open side

    @property
    def joint_units(self) -> Array:
        return np.ones(self.robot.n_joints)

    def pointing(self, chain: Chain) -> Array:
        """(K, 3) the jig's axis."""
        return jig_outward(self.robot) * chain.base_T_frame[:, -1, :3, 2]

    def linearise(self, q: Array, rows: IndexArray) -> tuple[Array, Array]:
        """The apex's error and the sine of the axis's, times `_LEVER_MM`; what turns about the axis is taken out."""
        chain = forward(self.robot.table, q, self.robot.is_revolute, self.robot.base_T_first)
        pointing, outward = self.pointing(chain), self.outward[rows]
        turn = np.cross(pointing, outward)
        # Where the axis points the wrong way round its sine vanishes too: any turn leads on.
        turn += np.where(np.sum(pointing * outward, axis=1) < -0.99, 0.1, 0.0)[:, None]
        moved, axes = joint_jacobian(chain, self.robot.is_revolute)
        axes = axes - pointing[:, :, None] * np.einsum("ki,kin->kn", pointing, axes)[:, None]
        error = np.concatenate([self.apex_mm[rows] - chain.target_mm, _LEVER_MM * turn], axis=1)
        return error, np.concatenate([moved, _LEVER_MM * axes], axis=1)

    def reached(self, q: Array) -> BoolArray:
        """(N,) whether apex and axis are where they should be, to 1 mm and 0.02 rad."""
        chain = forward(self.robot.table, q, self.robot.is_revolute, self.robot.base_T_first)
        off_mm = np.linalg.norm(self.apex_mm - chain.target_mm, axis=1)
        cosine = np.sum(self.pointing(chain) * self.outward, axis=1)
        return np.asarray((off_mm < 1.0) & (np.arccos(np.clip(cosine, -1.0, 1.0)) < 0.02))


def _limits(robot: Robot) -> tuple[Array, Array]:
    """Lower and upper bound (n,): the joints' own limits, and half a turn either way for those that turn."""
    low = np.array([-np.inf if joint.min is None else joint.min for joint in robot.joints])
    high = np.array([np.inf if joint.max is None else joint.max for joint in robot.joints])
    low = np.where(robot.is_revolute, np.maximum(low, -np.pi), np.where(np.isfinite(low), low, 0.0))
    high = np.where(robot.is_revolute, np.minimum(high, np.pi), np.where(np.isfinite(high), high, 500.0))
    if np.any(low >= high):
        j = int(np.argmax(low >= high))
        raise CalibError(
            f"robot {robot.name}: joint {robot.joints[j].name} has no room within +-180 deg "
            f"of zero (limits {robot.joints[j].min}, {robot.joints[j].max} rad)"
        )
    return low, high


def _wrapped(q: Array, low: Array) -> Array:
    """Angles moved by whole turns to the first value at or above the lower limits."""
    return np.asarray(low + np.mod(q - low, 2.0 * np.pi))
