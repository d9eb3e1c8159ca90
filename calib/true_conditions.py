"""Draw what surrounds a simulated measurement: payloads, a warming room, the clock, approaches, scanner placements."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.errors import CalibError
from calib.pose_design import random_poses
from calib.robot import Robot
from calib.true_mechanism import Conditions
from calib.truth import Truth, jig_side, scanner_T_target

Array = NDArray[np.float64]

PAYLOADS_KG = (0.0, 1.0, 2.5)


def draw_conditions(robot: Robot, count: int, *, rng: np.random.Generator) -> Conditions:
    """A morning's work of `count` poses: everything that poses.csv has a column for, except the setup.

    Half a minute to a minute a pose. The cell warms up by about 10 K in the first hour or so and swings by 2 K with the
    air conditioning, so that temperature and time can be told apart. Joints come from either side at random.
    """
    time_s = np.asarray(
        np.round(np.cumsum(np.append(0.0, rng.uniform(25.0, 60.0, count - 1))), 1), dtype=float
    )
    swing = np.sin(2.0 * np.pi * (time_s / rng.uniform(900.0, 1500.0) + rng.random()))
    warming = 1.0 - np.exp(-time_s / rng.uniform(1200.0, 2400.0))
    temperature_c = 20.0 + rng.uniform(9.0, 12.0) * warming + rng.uniform(1.5, 2.5) * swing
    return Conditions(
        payload_kg=rng.choice(np.array(PAYLOADS_KG), count),
        temperature_c=np.round(temperature_c, 2),
        time_s=time_s,
        approach=rng.choice(np.array([-1.0, 1.0]), (count, robot.n_joints)),
    )


def facing_poses(robot: Robot, base_T_scanner: Array, count: int, *, rng: np.random.Generator) -> Array:
    """(count, n) all over the joints' ranges, with the jig turned at the scanner: less than 75 deg from the line of sight."""
    q = random_poses(robot, 20 * count, rng=rng)
    seen = scanner_T_target(Truth.without_effects(robot, base_T_scanner), q)
    towards = -jig_side(robot) * np.sum(seen[:, :3, 2] * seen[:, :3, 3], axis=1)
    q = q[towards > np.cos(np.radians(75.0)) * np.linalg.norm(seen[:, :3, 3], axis=1)]
    if len(q) < count:
        raise CalibError(
            f"robot {robot.name}: found {len(q)} of {count} poses that turn the jig at the scanner; use other limits"
        )
    return q[:count]


def more_places(base_T_scanner: Array, count: int, *, rng: np.random.Generator) -> dict[str, Array]:
    """Placements "A", "B", ... of the scanner: the given one, the others up to 60 deg around the arm and 200 mm off."""
    places = {"A": base_T_scanner}
    for k in range(1, count):
        around = np.eye(4)
        around[:3, :3] = Rotation.from_euler("z", rng.uniform(-60.0, 60.0), degrees=True).as_matrix()
        around[:3, 3] = rng.uniform(-200.0, 200.0, 3)
        places[chr(ord("A") + k) if k < 26 else f"S{k + 1}"] = around @ base_T_scanner
    return places
