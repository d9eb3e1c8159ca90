"""Effects in the drive of one joint: where it stands is not where it was told to stand."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.effects.base import Parameter
from calib.effects.state import RobotState


def _harmonics(orders: tuple[float, ...], scale: float) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(f"{part}{order:g}_rad".replace(".", "_"), "rad", scale, f"{part}({order:g} q) amplitude")
        for order in orders
        for part in ("sin", "cos")
    )


def _periodic_error(
    state: RobotState, joint: int, orders: tuple[float, ...], values: dict[str, float]
) -> RobotState:
    q = state.q_rad[:, joint]
    error = np.zeros(len(q))
    for order in orders:
        suffix = f"{order:g}_rad".replace(".", "_")
        error += values[f"sin{suffix}"] * np.sin(order * q) + values[f"cos{suffix}"] * np.cos(order * q)
    return state.add_joint_error(joint, error)


@dataclass(frozen=True)
class TransmissionError:
    """Errors that come once, twice or three times a turn: theta += A sin(n q) + B cos(n q), n = 1, 2, 3.

    n = 1 is eccentricity of an encoder or gear. The cosine of n = 1 at a joint whose whole range is small is close to a
    joint offset, its sine to a wrong gear ratio.
    """

    joint: int
    name = "transmission_error"
    orders = (1.0, 2.0, 3.0)
    parameters = _harmonics(orders, 3e-4)

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """The joint's error added."""
        return _periodic_error(state, self.joint, self.orders, values)


@dataclass(frozen=True)
class StrainWave:
    """Ripple of a strain wave gear: as `TransmissionError`, n = gear ratio and twice that."""

    joint: int
    gear_ratio: float
    name = "strain_wave"

    @property
    def orders(self) -> tuple[float, float]:
        """Turns of error a turn of the joint."""
        return (self.gear_ratio, 2.0 * self.gear_ratio)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sine and cosine of both orders."""
        return _harmonics(self.orders, 3e-4)

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """The joint's error added."""
        return _periodic_error(state, self.joint, self.orders, values)


@dataclass(frozen=True)
class JointScale:
    """A wrong gear ratio or encoder scale: theta += k q."""

    joint: int
    name = "joint_scale"
    parameters = (Parameter("k", "1", 1e-4, "share of the commanded motion"),)

    def apply(self, state: RobotState, *, k: float) -> RobotState:
        """The joint's error added."""
        return state.add_joint_error(self.joint, k * state.q_rad[:, self.joint])


@dataclass(frozen=True)
class JointCoupling:
    """A joint that is dragged by its neighbour, as wrists with bevel gears are: theta_j += k q_i."""

    joint: int
    driver: int
    name = "joint_coupling"

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One: the driver's number is in its name, as a joint may have two."""
        return (Parameter(f"k_of_J{self.driver + 1}", "1", 1e-4, "share of the neighbour's motion"),)

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """The joint's error added."""
        (k,) = values.values()
        return state.add_joint_error(self.joint, k * state.q_rad[:, self.driver])


@dataclass(frozen=True)
class Backlash:
    """Play that is taken up from the side the joint came from: theta += b / 2 sign(approach)."""

    joint: int
    name = "backlash"
    parameters = (Parameter("b_rad", "rad", 5e-4, "width of the play"),)

    def apply(self, state: RobotState, *, b_rad: float) -> RobotState:
        """The joint's error added; nothing where the approach was not written down."""
        if state.poses.approach is None:
            return state
        return state.add_joint_error(self.joint, 0.5 * b_rad * np.sign(state.poses.approach[:, self.joint]))


@dataclass(frozen=True)
class AxisWobble:
    """A joint's axis that tilts as it turns, about its own origin, by cosines and sines of n q, n = 1, 2.

    The part of n = 1 that turns with the link is plain geometry and is left to it: what is kept tilts the axis in the
    link before, about that link's x and y: alpha and beta of the row before, or the base for the first joint.
    """

    joint: int
    name = "axis_wobble"
    orders = (1, 2)
    parameters = tuple(
        Parameter(f"{axis}_{part}{order}_rad", "rad", 3e-4, f"tilt about {axis}, {part}({order} q)")
        for order in orders
        for axis in ("x", "y")
        for part in ("sin", "cos")
    )

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """The tilt added to the frame that carries the joint."""
        q = state.q_rad[:, self.joint]
        tilt = {axis: np.zeros(len(q)) for axis in ("x", "y")}
        for order in self.orders:
            for axis, error in tilt.items():
                error += values[f"{axis}_sin{order}_rad"] * np.sin(order * q)
                error += values[f"{axis}_cos{order}_rad"] * np.cos(order * q)
        if self.joint == 0:
            return state.turn_base(np.column_stack([tilt["x"], tilt["y"], np.zeros(len(q))]))
        # Ry is the last factor of the row before, so beta turns about the y axis that this joint starts from. A turn
        # about its x axis is alpha's where beta is small: x' of alpha is Ry^-1 x.
        before = self.joint - 1
        return state.add_link_error(before, "alpha", tilt["x"]).add_link_error(before, "beta", tilt["y"])
