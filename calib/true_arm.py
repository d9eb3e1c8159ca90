"""Draw the arm that a simulation measures: link errors, and effects whose sizes make sense on that arm.

What the drawn arm does is worked out in `calib.truth`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.errors import CalibError
from calib.robot import Robot
from calib.truth import Truth, gravity_torques, scanner_T_target

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations from which link errors are drawn, every parameter of every row by itself."""

    length_mm: float = 0.3
    angle_deg: float = 0.1


TYPICAL = Tolerances()


def draw_truth(
    robot: Robot,
    base_T_scanner: ArrayLike,
    q: Array,
    *,
    rng: np.random.Generator,
    effects: Sequence[str] = (),
    tolerances: Tolerances = TYPICAL,
    payload_kg: Array | None = None,
) -> Truth:
    """Draw an arm: link errors from the tolerances, and effects whose sizes make sense at the poses q (N, n)."""
    check_effects(effects)
    angle_rad = np.radians(tolerances.angle_deg)
    sigma = np.array([tolerances.length_mm, angle_rad, tolerances.length_mm, angle_rad, angle_rad])
    table = robot.table + sigma * rng.standard_normal(robot.table.shape)
    truth = Truth.without_effects(robot.with_table(table), base_T_scanner)
    for effect in effects:
        truth = _EFFECTS[effect](truth, q, payload_kg, rng)
    return truth


def check_effects(effects: Sequence[str]) -> None:
    """Raise CalibError at the first effect that cannot be simulated."""
    for effect in effects:
        if effect not in _EFFECTS:
            raise CalibError(f"cannot simulate the effect {effect!r}; there are {', '.join(_EFFECTS)}")


def _draw_joint_compliance(
    truth: Truth, q: Array, payload_kg: Array | None, rng: np.random.Generator
) -> Truth:
    """Joints that yield: 0.2 to 0.5 mm rms at the tool over the poses; the wrist is about four times softer."""
    robot = truth.robot
    n = robot.n_joints
    softness = (
        np.where(np.arange(n) < n - 3, 1.0, 4.0) * np.exp(0.3 * rng.standard_normal(n)) * robot.is_revolute
    )
    wanted_mm = rng.uniform(0.2, 0.5)
    if not np.any(gravity_torques(robot, q, payload_kg)[:, robot.is_revolute]):
        raise CalibError(
            f"robot {robot.name}: gravity turns none of its joints, joint_compliance would do nothing"
        )
    rigid_mm = scanner_T_target(truth, q, payload_kg)[:, :3, 3]
    scale = 1e-5
    for _ in range(4):  # the sag is all but proportional to the scale
        truth = replace(truth, joint_compliance_rad_per_nm=scale * softness)
        sag_mm = np.linalg.norm(scanner_T_target(truth, q, payload_kg)[:, :3, 3] - rigid_mm, axis=1)
        scale *= wanted_mm / float(np.sqrt(np.mean(sag_mm**2)))
    return truth


def _draw_transmission_error(
    truth: Truth, q: Array, payload_kg: Array | None, rng: np.random.Generator
) -> Truth:
    """Gears that run unevenly once and twice a turn: 1e-4 rad (20 arc seconds) rms for n = 1, half of it for n = 2."""
    size_rad = np.array([1.0e-4, 0.5e-4]) * truth.robot.is_revolute[:, None]
    cos_rad, sin_rad = rng.standard_normal((2, truth.robot.n_joints, 2)) * size_rad
    return replace(truth, transmission_cos_rad=cos_rad, transmission_sin_rad=sin_rad)


_EFFECTS: dict[str, Callable[[Truth, Array, Array | None, np.random.Generator], Truth]] = {
    "joint_compliance": _draw_joint_compliance,
    "transmission_error": _draw_transmission_error,
}

SIMULATED_EFFECTS = tuple(_EFFECTS)
