"""A cell measured by MuJoCo: once for its calibration, then by a few check poses after something changed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.kinematics.robot import Robot
from calib.simulation.simulate import simulate_dataset
from tests.support.mujoco_arm import in_mujoco, mujoco_model

TOLERANCES = np.array([0.3, np.radians(0.1), 0.3, np.radians(0.1), np.radians(0.1)])


@dataclass(frozen=True)
class Cell:
    """The true arm and where the scanner stands."""

    true: Robot
    nominal: Robot
    scanner_T_base: Array
    noise_mm: float = 0.05

    @classmethod
    def drawn(cls, rng: np.random.Generator, robot: str = "rb5") -> Cell:
        nominal = builtin_robot(robot)
        table = nominal.table + rng.normal(size=nominal.table.shape) * TOLERANCES
        turn = frames.rotation_from_rotvec(rng.normal(size=3))
        return cls(nominal.with_table(table), nominal, frames.make_transform(turn, [0.0, 0.0, 2500.0]))

    def with_change(self, parameter: str, by: float) -> Cell:
        table = self.true.table.copy()
        table[np.unravel_index(self.nominal.parameter_names.index(parameter), table.shape)] += by
        return replace(self, true=self.nominal.with_table(table))

    def with_scanner_moved(self, rotvec_rad: Array, shift_mm: Array) -> Cell:
        motion = frames.make_transform(frames.rotation_from_rotvec(rotvec_rad), shift_mm)
        return replace(self, scanner_T_base=motion @ self.scanner_T_base)

    def measured(
        self, rng: np.random.Generator, poses: int = 8, name: str = "new", at: Dataset | None = None
    ) -> Dataset:
        """At random poses, or at those of another dataset."""
        plan = (
            at
            or simulate_dataset(self.nominal, rng=rng, poses=poses, noise_mm=self.noise_mm, name=name).dataset
        )
        assert plan.points is not None
        model = mujoco_model(self.true)
        tool_mm = np.array(
            [1e3 * in_mujoco(model, self.true, q).site("target").xpos for q in plan.poses.q[plan.points.pose]]
        )
        seen_mm = frames.apply(self.scanner_T_base, tool_mm)
        noisy = seen_mm + self.noise_mm * rng.normal(size=seen_mm.shape)
        return plan.with_points(replace(plan.points, xyz_mm=noisy))
