"""A run of an arm that stops at poses, recorded: joints and a measured point by time, by a kinematics of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NAMES = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
ROWS = (  # a_mm, alpha_deg, d_mm, theta_deg; an arm of UR's build, whose tables are public
    (0.0, 90.0, 89.159, 0.0),
    (-425.0, 0.0, 0.0, 0.0),
    (-392.25, 0.0, 0.0, 0.0),
    (0.0, 90.0, 109.15, 0.0),
    (0.0, -90.0, 94.65, 0.0),
    (0.0, 0.0, 82.3, 0.0),
)
TOOL_MM = (30.0, -20.0, 60.0)
ZERO_DEG = (0.0, 0.25, -0.3, 0.15, 0.2, 0.0)  # of the true arm's encoders
POINT_SIGMA_MM = 0.05


def robot_toml(names: tuple[str, ...] = NAMES) -> str:
    """The nominal arm as robot.toml."""
    lines = ['name = "stop-and-go arm"', ""]
    for name, (a, alpha, d, theta) in zip(names, ROWS, strict=True):
        lines += ["[[joints]]", f'name = "{name}"', f"a_mm = {a}", f"alpha_deg = {alpha}", f"d_mm = {d}"]
        lines += [f"theta_deg = {theta}", "beta_deg = 0.0", ""]
    return "\n".join([*lines, "[tool]", f"xyz_mm = {list(TOOL_MM)}", ""])


def tool_mm(q: Array, zero_deg: tuple[float, ...] = ZERO_DEG, tool: tuple[float, float, float] = TOOL_MM) -> Array:
    """Place (N, 3) of the measured point in the tracker's frame, for joints (N, 6) in radians."""
    out = np.broadcast_to(np.eye(4), (len(q), 4, 4)).copy()
    for k, (a, alpha, d, theta) in enumerate(ROWS):
        turn = q[:, k] + np.radians(theta + zero_deg[k])
        c, s, ca, sa = np.cos(turn), np.sin(turn), np.cos(np.radians(alpha)), np.sin(np.radians(alpha))
        step = np.zeros((len(q), 4, 4))
        step[:, 0] = np.stack([c, -s * ca, s * sa, a * c], axis=1)
        step[:, 1] = np.stack([s, c * ca, -c * sa, a * s], axis=1)
        step[:, 2, 1:] = sa, ca, d
        step[:, 3, 3] = 1.0
        out = out @ step
    in_base = out[:, :3, :3] @ np.array(tool) + out[:, :3, 3]
    turn = np.radians(35.0)
    tracker = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(in_base @ tracker.T + np.array([900.0, -400.0, 250.0]))


@dataclass(frozen=True)
class Run:
    """What was recorded, and the truth at each stop."""

    joint_s: Array  # (N,) by the joints' clock
    q: Array  # (N, 6) rad, in the order of NAMES
    effort_nm: Array  # (N, 6)
    point_s: Array  # (M,) by the points' clock
    xyz_mm: Array  # (M, 3)
    stops_q: Array  # (K, 6) rad
    stops_mm: Array  # (K, 3)
    sides: Array  # (K, 6) direction of each joint's last motion
    offset_s: float  # of the points' clock


def recorded_run(
    rng: np.random.Generator,
    stops: int = 32,
    *,
    joint_hz: float = 50.0,
    point_hz: float = 60.0,
    offset_s: float = 0.35,
    start_s: float = 1_700_000_000.0,
    regular: bool = False,
    forwards: bool = False,
    joint_sigma_rad: float = 2e-5,
    reach: float = 1.0,
) -> Run:
    """A run with pauses between travels, jitter of the times, dropouts, correlated noise of the points.

    regular  # all travels and pauses alike, between two places, so that a clock's offset cannot be told
    forwards  # no joint turns back
    reach  # of the arm's usual joint values
    """
    low, high = np.array([-2.5, -2.2, -2.2, -2.5, -2.0, -2.5]), np.array([2.5, -0.4, 2.2, 0.5, 2.0, 2.5])
    places = reach * rng.uniform(low, high, (stops, 6))
    if regular:
        places = places[[0, 1] * (stops // 2)]
    places = np.sort(places, axis=0) if forwards else places
    rest = np.full(stops, 2.0) if regular else rng.uniform(1.4, 2.6, stops)
    way = np.full(stops, 1.5) if regular else rng.uniform(1.0, 2.2, stops)
    begins, ends, at = [], [], 0.0
    for k in range(stops):
        at += way[k]
        begins.append(at)
        at += rest[k]
        ends.append(at)
    before = np.vstack([places[0] + reach * (-0.3 if forwards else 0.3), places[:-1]])

    def joints_at(t: Array) -> Array:
        k = np.clip(np.searchsorted(ends, t), 0, stops - 1)
        share = np.clip((t - (np.array(begins) - way)[k]) / way[k], 0.0, 1.0)
        smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)  # minimum jerk
        return np.asarray(before[k] + smooth[:, None] * (places[k] - before[k]))

    def times(hz: float) -> Array:
        t = np.arange(0.0, at, 1.0 / hz)
        t = np.sort(t + rng.uniform(-0.2, 0.2, len(t)) / hz)
        lost = np.zeros(len(t), dtype=bool)
        for start in rng.uniform(0.0, at, 6):
            lost |= (t > start) & (t < start + 0.15)
        return np.asarray(t[~lost])

    joint_t, point_t = times(joint_hz), times(point_hz)
    q = joints_at(joint_t) + rng.normal(0.0, joint_sigma_rad, (len(joint_t), 6))
    noise = np.zeros((len(point_t), 3))
    fresh = rng.normal(0.0, POINT_SIGMA_MM * np.sqrt(1.0 - 0.7**2), noise.shape)
    for i in range(1, len(noise)):
        noise[i] = 0.7 * noise[i - 1] + fresh[i]
    effort = 20.0 * np.cos(q) + rng.normal(0.0, 0.2, q.shape)
    return Run(
        start_s + joint_t, q, effort, start_s + point_t + offset_s, tool_mm(joints_at(point_t)) + noise,
        places, tool_mm(places), np.sign(places - before), offset_s,
    )  # fmt: skip
