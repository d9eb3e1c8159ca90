"""Temperature: effects of a measured temperature, or of an arm that warms up at work."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.dataset.signals import named_temperatures
from calib.effects.effect import CatalogueEffect, Family, NaturalBound, Parameter, Parameters
from calib.effects.shaped import Growth, HeatOfMotor, ShapedEffect
from calib.effects.state import RobotState

REFERENCE_C = 20.0
"""Temperature, C, at which lengths are those of robot.toml; growth that is the same at all poses is link errors."""


_SAME_C = 1e-6  # temperatures that differ by less do not vary
LAG_MINUTES = (0, 5, 15, 45)
"""Time constants with which the links follow the temperature that was written down."""


def lagged(temperature_c: Array, time_s: Array, lag_s: float) -> Array:
    """Temperature (L,) of a body that follows another's with a time constant; both are the same at first."""
    out = [float(temperature_c[0])]
    for outside_c, kept in zip(temperature_c[1:].tolist(), np.exp(-np.diff(time_s) / lag_s).tolist(), strict=True):
        out.append(outside_c + (out[-1] - outside_c) * kept)
    return np.array(out)


@dataclass(frozen=True)
class ThermalGrowth(CatalogueEffect):
    """Links that grow with temperature: a and d times 1 + kappa (T - 20 C), at once or with a lag."""

    lag_minutes: int = 0
    name = "thermal_growth"
    noun = "the growth of the links with temperature"
    equation = "a, d times 1 + kappa (T - 20 C)"
    symbols: ClassVar[tuple[tuple[str, str], ...]] = (("kappa", "1/K"),)
    needs = "temperature_c or temperature_<name>_c in poses.csv, varying"
    needed_conditions = ("temperature_c",)
    confirm = "the same poses cold and warmed up"
    bounds = (
        NaturalBound(3e-5, "1/K", "of an arm's metals aluminium grows most, by 23e-6/K"),
        NaturalBound(2e-4, "rad/K", "a housing that turns a joint by 2e-3 rad in 10 K is warped"),
    )
    notes = r"""
    $$ a_i, \, d_i \; \to \; a_i, \, d_i \; ( 1 + \kappa \, ( T - 20 ) ), \qquad T \text{ in C} $$

    Aluminium grows by 23e-6/K: 0.23 mm a metre in 10 K. Growth that is the same at all poses is link errors. If
    temperature only rises with time, {doc}`scanner_drift` is nearly the same. Where times are known too, the links may
    follow the temperature with a time constant of 5, 15 or 45 minutes: a sensor in the hall is ahead of a casting.

    Each further temperature, such as `temperature_motor2_c`, may drive the growth of all links, or that of one link
    with a turn of its joint, $\delta \theta_j = b_j ( T - 20 )$: of joint 2 where its name ends so, else of any.
    """
    position = 9
    linear = True

    @cached_property
    def parameters(self) -> Parameters:
        """Expansion, with the lag in its name."""
        name = f"kappa_after_{self.lag_minutes}min_per_k" if self.lag_minutes else "kappa_per_k"
        return (Parameter(name, "1/K", 1e-5, "expansion of all links"),)

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """Robot state with the lengths scaled; unchanged where no temperature was recorded."""
        poses = state.poses
        temperature_c = poses.temperature_c
        if temperature_c is None:
            return state
        if self.lag_minutes and poses.sequence.temperature_c is not None and poses.sequence.time_s is not None:
            followed_c = lagged(poses.sequence.temperature_c, poses.sequence.time_s, 60.0 * self.lag_minutes)
            measured = np.isfinite(poses.order)
            temperature_c = np.where(measured, poses.from_sequence(followed_c), temperature_c)
        (kappa_per_k,) = values.values()
        return Growth().act(state, kappa_per_k * (temperature_c - REFERENCE_C)[:, None])

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with a member for each lag, one without times, where the temperature varies."""
        poses = dataset.poses
        temperature, sensed = poses.temperature_c, tuple(_by_sensors(dataset))
        if sensed and (temperature is None or float(np.ptp(temperature[~poses.is_test])) < _SAME_C):
            return Family(cls.name, sensed)
        if temperature is None:
            return cls.untestable("poses.csv has no temperature_c", "add the arm's temperature at each pose")
        if float(np.ptp(temperature[~poses.is_test])) < _SAME_C:
            return cls.untestable(
                f"the temperature was {temperature[0]:g} C at every pose",
                "measure cold and warmed up, 5 K apart or more",
            )
        lags = LAG_MINUTES if poses.time_s is not None else LAG_MINUTES[:1]
        return Family(cls.name, (*map(cls, lags), *sensed))


@dataclass(frozen=True)
class GrowthBySensor(ThermalGrowth):
    """Links that all grow with a temperature of its own name: a and d times 1 + kappa (T - 20 C)."""

    sensor: str = field(kw_only=True)  # "motor2" for temperature_motor2_c

    @cached_property
    def parameters(self) -> Parameters:
        """Expansion, with the sensor in its name."""
        return (Parameter(f"kappa_by_{self.sensor}_per_k", "1/K", 1e-5, "expansion of all links"),)

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """Robot state with the lengths scaled; unchanged where this temperature was not recorded."""
        (kappa_per_k,) = values.values()
        warmer_k = self.warmer_k(state)
        return state if warmer_k is None else Growth().act(state, kappa_per_k * warmer_k[:, None])

    def warmer_k(self, state: RobotState) -> Array | None:
        """Temperature (N,) above 20 C, K; None where it was not recorded."""
        temperature_c = named_temperatures(state.poses).get(self.sensor)
        return None if temperature_c is None else temperature_c - REFERENCE_C


@dataclass(frozen=True)
class JointBySensor(GrowthBySensor):
    """A joint that turns, and whose link grows, with a temperature of its own name."""

    joint: int = field(kw_only=True)  # revolute
    equation = "a_j, d_j times 1 + kappa_j (T - 20 C), theta_j += b_j (T - 20 C)"
    symbols = (("kappa_j", "1/K"), ("b_j", "rad/K"))

    @cached_property
    def parameters(self) -> Parameters:
        """Turn of the joint and expansion of its link, with the sensor in their names."""
        return (
            Parameter(f"turn_by_{self.sensor}_rad_per_k", "rad/K", 1e-5, "turn of the joint by 1 K"),
            Parameter(f"kappa_by_{self.sensor}_per_k", "1/K", 1e-5, "expansion of its link"),
        )

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """Robot state with the joint turned and its link longer; unchanged where there is no such temperature."""
        warmer_k = self.warmer_k(state)
        if warmer_k is None:
            return state
        return HeatOfMotor(self.joint).act(state, warmer_k[:, None] * np.array(list(values.values())))


def _by_sensors(dataset: Dataset) -> Iterator[ThermalGrowth]:
    """Members for each named temperature that varies: all links, and the joint of its number or else every joint."""
    turning = dataset.robot.revolute_joints
    for sensor, temperature_c in named_temperatures(dataset.poses).items():
        if float(np.ptp(temperature_c[~dataset.poses.is_test])) < _SAME_C:
            continue
        yield GrowthBySensor(sensor=sensor)
        number = re.search(r"[0-9]+$", sensor)
        own = int(number[0]) - 1 if number else -1
        yield from (JointBySensor(sensor=sensor, joint=j) for j in ([own] if own in turning else turning))


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
    needs = "time_s in poses.csv"
    confirm = "a sensor on the arm (temperature_c), or the first poses again at the end"
    bounds = (NaturalBound(2e-3, "1", "aluminium grows by 1.4e-3 for 60 K"),)
    notes = r"""
    $$ a_i, \, d_i \; \to \; a_i, \, d_i \left( 1 + g \left( 1 - e^{ - t / T } \right) \right) $$

    with $T$ = 5, 10, 20, 40, 80 or 160 minutes. A thermometer in the hall does not tell what an arm's own work does to
    it: where one was read, {doc}`thermal_growth` is tested beside it.
    """
    position = 22

    @property
    def displacement(self) -> Growth:
        return Growth()

    @cached_property
    def parameters(self) -> Parameters:
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
        if poses.time_s is None or float(np.ptp(poses.time_s)) <= 0.0:
            return cls.untimed(poses.time_s)
        start_s, last_s = float(poses.time_s.min()), float(poses.time_s.max())
        minutes = [m for m in WARM_UP_MINUTES if 60.0 * m <= 3.0 * (last_s - start_s)] or [WARM_UP_MINUTES[0]]
        return Family(cls.name, tuple(cls(m, start_s, last_s) for m in minutes), sparse=True)


HEAT_SECONDS = (100, 150, 220, 320, 470, 700, 1000, 1500, 2200, 3200)
"""Time constants of a motor's heat: of its winding, of its housing, of the casting around it."""


def workload(q_rad: Array, time_s: Array, settling_s: float, *, warm: bool = False) -> Array:
    """Recent speed (L,), rad/s, of a joint that goes through angles (L,) at given times.

    An average that forgets with a time constant. Each move is spread evenly over the time that it had. Before the first
    pose the joint stood still or, warm, worked as it did on average from then on.
    """
    ways, took_s = np.abs(np.diff(q_rad)), np.diff(time_s)
    still = took_s <= 0.0  # two poses at one time: the way counts, the time does not
    kept = np.exp(-np.maximum(took_s, 0.0) / settling_s)
    gained = np.where(still, ways / settling_s, (1.0 - kept) * ways / np.where(still, 1.0, took_s))
    span_s = float(time_s[-1] - time_s[0])
    recent = [float(ways.sum()) / span_s if warm and span_s > 0.0 else 0.0]
    for share, more in zip(kept.tolist(), gained.tolist(), strict=True):
        recent.append(share * recent[-1] + more)
    return np.array(recent)


@dataclass(frozen=True)
class MotorHeat(ShapedEffect):
    """A motor that its own work heats: its joint's theta and its link's lengths follow the recent speed of the joint.

    Poses after all measured ones, such as the targets of a correction, are taken as cold.
    """

    joint: int
    seconds: int  # time constant
    warm: bool = False  # whether it had worked before the first pose
    name = "motor_heat"
    title = "heat of a motor"
    noun = "the heat of the motor of joint"
    changes_arm = True
    equation = "theta_j += b H_j, a_j and d_j times 1 + g H_j, H_j the recent speed of joint j"
    symbols = (("b", "rad/(rad/s)"), ("g", "1/(rad/s)"))
    needs = "time_s in poses.csv, and work that differs over the session"
    confirm = "one pose before and after the joint alone ran to and fro for half an hour"
    bounds = (
        NaturalBound(0.1, "rad/(rad/s)", "a housing that twists a joint by 2e-3 rad at 0.02 rad/s is warped"),
        NaturalBound(0.1, "1/(rad/s)", "aluminium grows by 1.4e-3 for 60 K, at 0.02 rad/s and more"),
    )
    notes = r"""
    $$ \delta \theta_j = b \, H_j, \qquad a_j, \, d_j \; \to \; a_j, \, d_j \, ( 1 + g \, H_j ), \qquad
    T \, \dot H_j = | \dot q_j | - H_j, \quad T = 100 \ldots 3200 \text{ s} $$

    $H_j$ is the joint's speed, averaged over about the last $T$, through all poses that were measured. With two time
    constants, of winding and casting, two members stand side by side. No table says what the motor did before the first
    pose: $H_j$ begins at 0, at the mean speed of the session, or between, where both have a share. A session in which
    all joints work alike heats them alike: then {doc}`warm_up` is nearly the same. Torque heats a motor too, as its
    square; it is left out, as it hardly varies from one such average to the next.
    """
    position = 34

    @property
    def displacement(self) -> HeatOfMotor:
        return HeatOfMotor(self.joint)

    @cached_property
    def parameters(self) -> Parameters:
        """Turn and growth by a recent speed of 1 rad/s, with the time constant and the start in their names."""
        word = f"{'warm_' if self.warm else ''}in_{self.seconds}s"
        return (
            Parameter(f"turn_{word}_rad_s_per_rad", "rad/(rad/s)", 5e-3, "turn by a recent speed of 1 rad/s"),
            Parameter(f"growth_{word}_s_per_rad", "1/(rad/s)", 5e-3, "growth of its link by the same"),
        )

    def shapes(self, state: RobotState) -> Array:
        poses = state.poses
        if poses.sequence.time_s is None:
            return np.zeros((len(poses), 1))
        recent = workload(poses.sequence.q[:, self.joint], poses.sequence.time_s, self.seconds, warm=self.warm)
        return poses.from_sequence(recent)[:, None]

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Largest change over all poses, as text."""
        largest = value * float(self.shapes(state).max(initial=0.0))
        if parameter.unit == "1/(rad/s)":
            return f"{1e3 * largest:+.2g} mm a metre at most"
        return f"{np.degrees(largest):+.2g}\N{DEGREE SIGN} at most"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each revolute joint, of ten time constants and either start."""
        poses = dataset.poses
        if poses.time_s is None or float(np.ptp(poses.time_s)) <= 0.0:
            return cls.untimed(poses.time_s)
        turning = dataset.robot.revolute_joints
        if not turning:
            return cls.untestable("no joint turns", "nothing: it is a matter of motors at joints that turn")
        members = tuple(cls(j, s, warm) for j in turning for s in HEAT_SECONDS for warm in (False, True))
        return Family(cls.name, members, sparse=True, superposed=True)
