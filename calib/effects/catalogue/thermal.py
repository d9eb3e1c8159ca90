"""Effects of temperature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.dataset.dataset import Dataset
from calib.effects.effect import CatalogueEffect, Family, Parameter
from calib.effects.state import RobotState

REFERENCE_C = 20.0
"""Temperature, C, at which lengths are those of robot.toml; growth that is the same at all poses is link errors."""


@dataclass(frozen=True)
class ThermalGrowth(CatalogueEffect):
    """Links that grow with temperature: a and d times 1 + kappa (T - 20 C)."""

    name = "thermal_growth"
    equation = "a, d times 1 + kappa (T - 20 C)"
    symbols = (("kappa", "1/K"),)
    needs = "temperature_c in poses.csv, varying"
    confirm = "the same poses cold and warmed up"
    linear = True
    parameters = (Parameter("kappa_per_k", "1/K", 1e-5, "expansion of all links"),)

    def apply(self, state: RobotState, *, kappa_per_k: float) -> RobotState:
        """Lengths scaled; nothing where no temperature was written down."""
        if state.poses.temperature_c is None:
            return state
        growth = kappa_per_k * (state.poses.temperature_c - REFERENCE_C)  # (N,)
        nominal = state.robot.table
        for frame in range(len(nominal)):
            for column, kind in ((0, "a"), (2, "d")):
                if nominal[frame, column] != 0.0:
                    state = state.add_link_error(frame, kind, growth * nominal[frame, column])
        return state

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """One member, where the temperature varies over the training poses."""
        poses = dataset.poses
        temperature = poses.temperature_c
        if temperature is None:
            return Family(
                cls.name, (), "poses.csv has no temperature_c", "write the arm's temperature a pose"
            )
        if float(np.ptp(temperature[~poses.is_test])) < 1e-6:
            return Family(
                cls.name,
                (),
                f"the temperature was {temperature[0]:g} C at every pose",
                "measure cold and warmed up, 5 K apart or more",
            )
        return Family(cls.name, (cls(),))
