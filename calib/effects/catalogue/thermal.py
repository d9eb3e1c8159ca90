"""Temperature: effects of a measured temperature, or of an arm that warms up at work."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.effects.effect import CatalogueEffect, Family, NaturalBound, Parameter
from calib.effects.shaped import Growth, ShapedEffect
from calib.effects.state import RobotState

REFERENCE_C = 20.0
"""Temperature, C, at which lengths are those of robot.toml; growth that is the same at all poses is link errors."""


@dataclass(frozen=True)
class ThermalGrowth(CatalogueEffect):
    """Links that grow with temperature: a and d times 1 + kappa (T - 20 C)."""

    name = "thermal_growth"
    noun = "the growth of the links with temperature"
    equation = "a, d times 1 + kappa (T - 20 C)"
    symbols = (("kappa", "1/K"),)
    needs = "temperature_c in poses.csv, varying"
    needed_conditions = ("temperature_c",)
    confirm = "the same poses cold and warmed up"
    bounds = (NaturalBound(3e-5, "1/K", "of an arm's metals aluminium grows most, by 23e-6/K"),)
    notes = r"""
    $$ a_i, \, d_i \; \to \; a_i, \, d_i \; ( 1 + \kappa \, ( T - 20 ) ), \qquad T \text{ in C} $$

    Aluminium grows by 23e-6/K: 0.23 mm a metre in 10 K. Growth that is the same at all poses is link errors. If
    temperature only rises with time, {doc}`scanner_drift` is nearly the same.
    """
    position = 9
    linear = True
    parameters = (Parameter("kappa_per_k", "1/K", 1e-5, "expansion of all links"),)

    def apply(self, state: RobotState, *, kappa_per_k: float) -> RobotState:
        """Robot state with the lengths scaled; unchanged where no temperature was recorded."""
        if state.poses.temperature_c is None:
            return state
        growth = kappa_per_k * (state.poses.temperature_c - REFERENCE_C)  # (N,)
        return Growth().act(state, growth[:, None])

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member, where the temperature varies over the training poses."""
        poses = dataset.poses
        temperature = poses.temperature_c
        if temperature is None:
            return Family(cls.name, (), "poses.csv has no temperature_c", "add the arm's temperature at each pose")
        if float(np.ptp(temperature[~poses.is_test])) < 1e-6:
            return Family(
                cls.name,
                (),
                f"the temperature was {temperature[0]:g} C at every pose",
                "measure cold and warmed up, 5 K apart or more",
            )
        return Family(cls.name, (cls(),))


WARM_UP_MINUTES = (5, 10, 20, 40, 80, 160)


@dataclass(frozen=True)
class WarmUp(ShapedEffect):
    """An arm that warms up at work: lengths grow as 1 - exp(-t / T) from the first pose on.

    Poses that come after all that were measured, and those without a time, are as warm as the last one.
    """

    minutes: int  # T
    start_s: float
    last_s: float
    name = "warm_up"
    title = "warm-up growth"
    noun = "the growth of the links as the arm warms up"
    changes_arm = True
    equation = "a, d times 1 + g (1 - exp(-t / T))"
    symbols = (("g", "1"),)
    needs = "time_s in poses.csv, and no temperature_c (thermal_growth takes that)"
    confirm = "a sensor on the arm (temperature_c), or the first poses again at the end"
    bounds = (NaturalBound(2e-3, "1", "aluminium grows by 1.4e-3 for 60 K"),)
    notes = r"""
    $$ a_i, \, d_i \; \to \; a_i, \, d_i \left( 1 + g \left( 1 - e^{ - t / T } \right) \right) $$

    with $T$ = 5, 10, 20, 40, 80 or 160 minutes. Where `temperature_c` was written down, {doc}`thermal_growth` is tested
    in its place.
    """
    position = 22

    @property
    def displacement(self) -> Growth:
        return Growth()

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Relative growth of the warm arm, with the time constant T in the parameter's name."""
        return (Parameter(f"growth_in_{self.minutes}min", "1", 1e-4, "growth of all lengths in the end"),)

    def shapes(self, state: RobotState) -> Array:
        poses = state.poses
        time_s = np.full(len(poses), self.last_s) if poses.time_s is None else poses.time_s
        time_s = np.where(np.isfinite(poses.order), time_s, self.last_s)
        return 1.0 - np.exp(-(time_s - self.start_s) / (60.0 * self.minutes))[:, None]

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Growth per metre of the warm arm, as text."""
        return f"{1e3 * value:.2g} mm a metre once warm, after some {self.minutes} minutes"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member per time constant T of a grid, up to three times the session."""
        poses = dataset.poses
        if poses.time_s is None:
            return Family(cls.name, (), "poses.csv has no time_s", "write down when each pose was measured")
        if poses.temperature_c is not None:
            known = "poses.csv has temperature_c, by which thermal_growth tests it"
            return Family(
                cls.name,
                (),
                known,
                "thermal_growth, which takes the measured temperature, tests the same cause",
                covered=True,
            )
        start_s, last_s = float(poses.time_s.min()), float(poses.time_s.max())
        if last_s <= start_s:
            return Family(cls.name, (), "time_s is the same at every pose", "write down when each pose was measured")
        minutes = [m for m in WARM_UP_MINUTES if 60.0 * m <= 3.0 * (last_s - start_s)] or [WARM_UP_MINUTES[0]]
        return Family(cls.name, tuple(cls(m, start_s, last_s) for m in minutes), sparse=True)
