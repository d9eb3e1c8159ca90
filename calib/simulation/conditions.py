"""Draw the conditions of a simulated measurement: payloads, temperatures, times, directions of approach."""

from __future__ import annotations

import numpy as np

from calib.kinematics.robot import Robot
from calib.simulation.truth.mechanism import Conditions

PAYLOADS_KG = (0.0, 1.0, 2.5)


def draw_conditions(robot: Robot, count: int, *, rng: np.random.Generator) -> Conditions:
    """Conditions of `count` poses that are measured one after the other, all that poses.csv has except the setup.

    A pose takes 25 to 60 s. The cell warms up by about 10 K in the first hour or so and swings by 2 K with the
    air conditioning, so that temperature and time can be told apart. Joints come from either side at random.
    """
    time_s = np.asarray(np.round(np.cumsum(np.append(0.0, rng.uniform(25.0, 60.0, count - 1))), 1), dtype=float)
    swing = np.sin(2.0 * np.pi * (time_s / rng.uniform(900.0, 1500.0) + rng.random()))
    warming = 1.0 - np.exp(-time_s / rng.uniform(1200.0, 2400.0))
    temperature_c = 20.0 + rng.uniform(9.0, 12.0) * warming + rng.uniform(1.5, 2.5) * swing
    return Conditions(
        payload_kg=rng.choice(np.array(PAYLOADS_KG), count),
        temperature_c=np.round(temperature_c, 2),
        time_s=time_s,
        approach=rng.choice(np.array([-1.0, 1.0]), (count, robot.n_joints)),
    )
