"""A cell measured by MuJoCo: once for its calibration, then again after something changed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.dataset.files.robot_toml import builtin_robot
from calib.kinematics.robot import Robot
from calib.simulation.pose_design import random_poses
from calib.simulation.simulate import draw_roles, rounded
from tests.support.mujoco_arm import mujoco, mujoco_model

TOLERANCES = np.array([0.3, np.radians(0.1), 0.3, np.radians(0.1), np.radians(0.1)])  # the arm's own errors


@dataclass(frozen=True)
class Cell:
    """The true arm and where the scanner stands."""

    true: Robot
    nominal: Robot
    scanner_T_base: Array
    noise_mm: float = 0.05
    tool_shift_mm: Array = field(default_factory=lambda: np.zeros(3))  # in the tool's frame

    @classmethod
    def drawn(cls, rng: np.random.Generator, robot: str | Robot = "rb5") -> Cell:
        nominal = builtin_robot(robot) if isinstance(robot, str) else robot
        table = nominal.table + rng.normal(size=nominal.table.shape) * TOLERANCES
        return cls(nominal.with_table(table), nominal, _anywhere(rng))

    def with_changes(self, changes: dict[str, float]) -> Cell:
        """The same cell with each named parameter of the table increased by its value."""
        table = self.true.table.copy()
        for name, by in changes.items():
            table[np.unravel_index(self.nominal.parameter_names.index(name), table.shape)] += by
        return replace(self, true=self.nominal.with_table(table))

    def with_tool_shifted(self, shift_mm: Array) -> Cell:
        return replace(self, tool_shift_mm=self.tool_shift_mm + shift_mm)

    def with_scanner_moved(self, rotvec_rad: Array, shift_mm: Array) -> Cell:
        motion = frames.make_transform(frames.rotation_from_rotvec(rotvec_rad), shift_mm)
        return replace(self, scanner_T_base=motion @ self.scanner_T_base)

    def with_scanner_anywhere(self, rng: np.random.Generator) -> Cell:
        return replace(self, scanner_T_base=_anywhere(rng))

    @cached_property
    def _model(self) -> Any:
        return mujoco_model(self.true)

    def seen_mm(self, q: Array) -> Array:
        """(N, 3) the tool point at joints q (N, n) in the scanner's frame, without noise."""
        data = mujoco().MjData(self._model)
        site = data.site("target")
        tool_mm = np.empty((len(q), 3))
        for row, joints in zip(tool_mm, np.where(self.nominal.is_revolute, q, np.asarray(q) / 1e3), strict=True):
            data.qpos[:] = joints
            mujoco().mj_kinematics(self._model, data)
            row[:] = 1e3 * site.xpos + site.xmat.reshape(3, 3) @ self.tool_shift_mm
        return frames.apply(self.scanner_T_base, tool_mm)

    def measured(self, rng: np.random.Generator, poses: int = 8, name: str = "new", q: Array | None = None) -> Dataset:
        """Dataset of the cell with noise, at random poses or at joints q (N, n)."""
        q = rounded(self.nominal, random_poses(self.nominal, poses, rng=rng)) if q is None else q
        seen_mm = self.seen_mm(q)
        noisy_mm = seen_mm + self.noise_mm * rng.normal(size=seen_mm.shape)
        ids = tuple(f"p{i + 1:03d}" for i in range(len(q)))
        return Dataset(
            name,
            self.nominal,
            Poses(ids, draw_roles(len(q), rng=rng), q, np.full(len(q), ""), tuple(f"{i}.ply" for i in ids)),
            Points(np.arange(len(q)), noisy_mm, np.full(len(q), "jig")),
            scanner=Scanner(point_sigma_mm=self.noise_mm),
        )


def measured_twice(
    seed: int, changed: dict[str, float] | None = None, *, robot: str = "rb5", other_arm: bool = False
) -> tuple[Dataset, Dataset]:
    """64 poses of one arm from one place, 64 others from another place.

    changed: what each parameter gained in between; other_arm: the second is of another arm of the type.
    """
    rng = np.random.default_rng(seed)
    cell = Cell.drawn(rng, robot)
    later = Cell.drawn(rng, robot) if other_arm else cell.with_changes(changed or {})
    return cell.measured(rng, 64, "before"), later.with_scanner_anywhere(rng).measured(rng, 64, "after")


def _anywhere(rng: np.random.Generator) -> Array:
    turn = frames.rotation_from_rotvec(rng.normal(size=3))
    return frames.make_transform(turn, [0.0, 0.0, 2500.0])
