"""Arms measured by constraints, as owners of small arms do: a ball in sockets, a tip on planes, a bar of known length.

Such data say where a point was, or how far two were apart, and little else. An arm that shrinks meets them as well as
one that moves right, so what these cases look for is a fit that is accepted although its arm has lost its size.
The kinematics and the search for joints are by elementary transforms and share no code with `calib`. Shared by the
tests and benchmarks/soak.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from calib import calibrate, check, diagnose
from calib.array_types import Array
from calib.calibration.plausibility import implausibility_reason
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.errors import CalibError
from calib.kinematics.robot import Joint, Robot, Tool

KINDS = ("sockets", "one socket a place", "planes", "ball bar")
IN_PLANE_MM = 500.0  # sigma along a plane that is touched anywhere
LOST_MM = 40.0  # a length that a fit moved by so much further than it is off is lost
LOST_SHARE = 0.15  # of the arm's size, in the same sense
BELOW = 0.15  # times the noise that was simulated: a residual below it is fitted to itself
FREEDOM = 5.0  # equations left over, without which a residual tells nothing
DIAGNOSED = 8  # one case in so many is diagnosed and checked too, all are calibrated

_TABLES: dict[str, list[tuple[float, float, float, float]]] = {  # a mm, alpha rad, d mm, theta rad
    "7 joints": [
        (0, -np.pi / 2, 333, 0), (0, np.pi / 2, 0, 0), (82.5, np.pi / 2, 316, 0), (-82.5, -np.pi / 2, 0, 0),
        (0, np.pi / 2, 384, 0), (88, np.pi / 2, 0, 0), (0, 0, 107, 0),
    ],
    "6 joints, parallel": [
        (0, np.pi / 2, 162.5, 0), (-425, 0, 0, 0), (-392.2, 0, 0, 0),
        (0, np.pi / 2, 133.3, 0), (0, -np.pi / 2, 99.7, 0), (0, 0, 99.6, 0),
    ],
    "6 joints, spherical wrist": [
        (25, -np.pi / 2, 400, 0), (315, 0, 0, -np.pi / 2), (35, -np.pi / 2, 0, 0),
        (0, np.pi / 2, 365, 0), (0, -np.pi / 2, 0, 0), (0, 0, 80, 0),
    ],
    "4 joints": [(0, -np.pi / 2, 180, 0), (260, 0, 0, 0), (240, 0, 0, 0), (60, np.pi / 2, 0, 0)],
}  # fmt: skip


@dataclass(frozen=True)
class ConstrainedArm:
    """A dataset measured by constraints, and the arm that it was measured with."""

    kind: str
    what: str
    noise_mm: float  # of the seat, as simulated
    true_table: Array  # (n + 1, 5)
    dataset: Dataset


def tips_mm(table: Array, q: Array) -> Array:
    """(N, 3) the tip in the base frame at joints (N, n), by Rz Tz Tx Rx Ry one after the other."""
    at, turned = np.zeros((len(q), 3)), np.broadcast_to(np.eye(3), (len(q), 3, 3))
    for row, angle in zip(table, [*q.T, np.zeros(len(q))], strict=True):
        a, alpha, d, theta, beta = row
        turned = turned @ Rotation.from_euler("z", (theta + angle)[:, None]).as_matrix()
        at = at + turned @ np.array([a, 0.0, d])
        turned = turned @ Rotation.from_euler("XY", [alpha, beta]).as_matrix()
    return at


def joints_at(table: Array, wanted_mm: Array, along: Array, rng: np.random.Generator) -> Array | None:
    """Joints at which the tip is where it is wanted, as far as the directions `along` (K, 3) go; None where none is."""
    q = rng.uniform(-1.8, 1.8, len(table) - 1)
    near = np.vstack([np.zeros(len(q)), 1e-6 * np.eye(len(q))])
    for _ in range(25):
        at = tips_mm(table, q + near) @ along.T
        off = at[0] - along @ wanted_mm
        if np.linalg.norm(off) < 1e-9:
            return q if np.all(np.abs(q) < 2.9) else None
        columns = (at[1:] - at[0]).T / 1e-6
        step = -columns.T @ np.linalg.solve(columns @ columns.T + 1e-3 * np.eye(len(off)), off)
        q = q + step * min(1.0, 0.4 / max(float(np.max(np.abs(step))), 1e-9))
    return None


def draw(number: int, seed: int) -> ConstrainedArm:
    """The case of this number."""
    rng = np.random.default_rng([seed, 7, number])
    kind, arm = str(rng.choice(KINDS)), str(rng.choice(list(_TABLES)))
    rows = np.array([(a, alpha, d, theta, 0.0) for a, alpha, d, theta in _TABLES[arm]], dtype=float)
    tool = np.array([rng.uniform(0, 60), 0.0, rng.uniform(40, 160), rng.uniform(-3, 3), 0.0])
    nominal = np.vstack([rows, tool])
    size = float(rng.choice([0.3, 1.0, 3.0]))
    errors = rng.normal(size=nominal.shape) * np.array([0.5, 0.003, 0.5, 0.004, 0.003]) * size
    true = nominal + errors
    noise_mm = float(np.exp(rng.uniform(np.log(0.02), np.log(0.3))))
    declared = rng.choice([1.0, 1.0, 1.0, 3.0, 0.3, 0.0])
    hidden = str(rng.choice(["nothing", "nothing", "harmonics", "slip", "knock"]))
    law = _Hidden(hidden, rng, len(rows))

    places, poses_each = int(rng.integers(2, 6)), int(rng.integers(6, 22))
    ids, q_all, setup, xyz, cov = [], [], [], [], []
    for place in range(places):
        turn = Rotation.random(rng=rng).as_matrix()
        seats = _seats(kind, true, rng)
        if seats is None:
            continue
        for k in range(poses_each):
            seat_mm, along, told_mm = seats[k % len(seats)]
            for _ in range(6):
                shaken = seat_mm + rng.normal(size=3) * noise_mm
                q = joints_at(law.table_at(true, len(ids)), shaken, along, rng)
                if q is not None:
                    break
            else:
                continue
            ids.append(f"p{len(ids):03d}")
            q_all.append(law.commanded(q, len(ids) - 1))
            setup.append(f"place{place}")
            xyz.append(turn @ told_mm)
            across = np.eye(3) - along.T @ along
            cov.append(turn @ (noise_mm**2 * along.T @ along + IN_PLANE_MM**2 * across) @ turn.T)
    count = len(ids)
    if count < 3:
        return draw(number + 1_000_003, seed)
    role = np.full(count, "train", dtype="<U9")
    role[np.array(setup) == setup[-1]] = "test"
    if np.all(role == "test"):
        role[: count // 2] = "train"
    role[int(np.flatnonzero(role == "train")[0])] = "reference"
    robot = Robot(
        arm,
        tuple(
            Joint(a_mm=a, alpha_rad=al, d_mm=d, theta_rad=th, beta_rad=be, name=f"J{i + 1}")
            for i, (a, al, d, th, be) in enumerate(rows.tolist())
        ),
        Tool(a_mm=tool[0], alpha_rad=tool[1], d_mm=tool[2], theta_rad=tool[3], beta_rad=tool[4]),
    )
    poses = Poses(tuple(ids), role, np.array(q_all), np.array(setup), tuple(f"{i}.ply" for i in ids))
    own = np.array(cov) * (declared or 1.0) ** 2 if kind == "planes" else None
    points = Points(np.arange(count), np.array(xyz), np.full(count, "jig"), covariance_mm2=own)
    sigma_mm = None if declared == 0.0 or own is not None else float(declared * noise_mm)
    dataset = Dataset(f"constraints {number}", robot, poses, points, Scanner(point_sigma_mm=sigma_mm))
    what = (
        f"{arm}, {kind}, {count} poses at {places} places, noise {noise_mm:.3f} mm, "
        f"{'not declared' if sigma_mm is None and own is None else f'declared {declared:g} times'}, "
        f"errors {size:g}, hidden: {hidden}"
    )
    return ConstrainedArm(kind, what, noise_mm, true, dataset)


def _seats(kind: str, table: Array, rng: np.random.Generator) -> list[tuple[Array, Array, Array]] | None:
    """The seats of a place: where the tip is brought, which directions hold it, and what the fixture says of it."""
    middle = tips_mm(table, rng.uniform(-1.2, 1.2, (1, len(table) - 1)))[0]
    every = np.eye(3)
    if kind == "planes":
        axes = Rotation.random(rng=rng).as_matrix()
        return [(middle + 30.0 * axis, axis[None], middle + 30.0 * axis) for axis in axes[: int(rng.integers(1, 4))]]
    if kind == "one socket a place":
        return [(middle, every, np.zeros(3))]
    length = 50.0 if kind == "sockets" else float(rng.uniform(150, 350))
    line = Rotation.random(rng=rng).as_matrix()[0] * length
    count = int(rng.integers(2, 4)) if kind == "sockets" else 2
    return [(middle + k * line, every, np.array([k * length, 0.0, 0.0])) for k in range(count)]


class _Hidden:
    """A cause that is not a constant error of the table; joints are commanded without knowing of it."""

    def __init__(self, name: str, rng: np.random.Generator, joints: int) -> None:
        self.name, self.joint, self.from_pose = name, int(rng.integers(joints)), int(rng.integers(8, 30))
        self.size = float(rng.uniform(0.001, 0.01))
        self.order = int(rng.integers(1, 4))

    def table_at(self, table: Array, pose: int) -> Array:
        out = table.copy()
        if self.name == "knock" and pose >= self.from_pose:
            out[0, [1, 3]] += self.size
        if self.name == "slip" and pose >= self.from_pose:
            out[self.joint, 3] += self.size
        return out

    def commanded(self, q: Array, pose: int) -> Array:
        out = q.copy()
        if self.name == "harmonics":
            out[self.joint] -= 0.3 * self.size * np.sin(self.order * q[self.joint])
        return out


def lost(arm: ConstrainedArm, fitted: Calibration) -> str:
    """Evidence that a fit lost the arm's size or understated its noise; "" where there is none."""
    found = fitted.model.calibrated_robot(fitted.fit.x).table
    length = [0, 2]
    off = np.abs(found[:-1][:, length] - arm.true_table[:-1][:, length])
    if off.max() > LOST_MM:
        row, column = np.unravel_index(int(off.argmax()), off.shape)
        return f"{'ad'[column]}{row + 1} is {off.max():.0f} mm from the true arm's"
    size, true_size = np.abs(found[:, length]).sum(), np.abs(arm.true_table[:, length]).sum()
    if abs(size / true_size - 1.0) > LOST_SHARE:
        return f"the lengths add up to {size / true_size:.2f} times the true arm's"
    if fitted.fit.degrees_of_freedom > FREEDOM and fitted.sigma_mm < BELOW * arm.noise_mm:
        return f"{fitted.sigma_mm:.2g} mm are left of a noise of {arm.noise_mm:.2g} mm"
    return ""


def accepted_collapse(number: int, seed: int) -> str:
    """Evidence that a fit of this case lost the arm's size and is accepted all the same; "" where none is.

    Each case is calibrated; one in eight is diagnosed and checked too.
    """
    arm = draw(number, seed)
    try:
        results = {"calibrate": calibrate(arm.dataset)}
        if number % DIAGNOSED == 0:
            results["diagnose"] = diagnose(arm.dataset).calibration
            checked = check(arm.dataset)
            if checked.passed and checked.diagnosis is not None:
                results["check"] = checked.diagnosis.calibration
    except CalibError:
        return ""  # refused
    found = ((name, lost(arm, result), implausibility_reason(result)) for name, result in results.items())
    return "; ".join(f"{name}: {why}" for name, why, doubt in found if why and (not doubt or name == "check"))
