"""Effects of temperature."""

from __future__ import annotations

from dataclasses import dataclass

from calib.effects.effect import Parameter
from calib.effects.state import RobotState

REFERENCE_C = 20.0
"""Lengths are those of this temperature; a constant offset is link errors."""


@dataclass(frozen=True)
class ThermalGrowth:
    """Links that grow with temperature: a and d times 1 + kappa (T - 20 C)."""

    name = "thermal_growth"
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
