"""A simulated cell whose arm carries the scanner."""

from __future__ import annotations

from dataclasses import replace

from calib.dataset.files.robot_toml import builtin_robot
from calib.simulation.simulate import simulate_dataset

RB5 = replace(builtin_robot("rb5"), carries_scanner=True)


MADE = simulate_dataset(RB5, rng=3, effects=["joint_compliance"], noise_mm=1e-4, poses=50)
