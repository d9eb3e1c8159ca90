"""Effects in the drive of one joint: where it stands is not where it was told to stand."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.effects.effect import Parameter
from calib.effects.state import RobotState


def _harmonic(order: float, scale: float) -> tuple[Parameter, ...]:
    suffix = f"{order:g}_rad".replace(".", "_")
    return tuple(
        Parameter(part + suffix, "rad", scale, f"{part}({order:g} q) amplitude") for part in ("sin", "cos")
    )


def _periodic_error(state: RobotState, joint: int, order: float, values: dict[str, float]) -> RobotState:
    sine, cosine = values.values()
    q = state.q_rad[:, joint]
    return state.add_joint_error(joint, sine * np.sin(order * q) + cosine * np.cos(order * q))


@dataclass(frozen=True)
class TransmissionError:
    """An error that comes n times a turn: theta += A sin(n q) + B cos(n q), n = 1, 2 or 3.

    n = 1 is eccentricity of an encoder or gear. The cosine of n = 1 at a joint whose whole range is small is close to a
    joint offset, its sine to a wrong gear ratio.
    """

    joint: int
    order: float
    name = "transmission_error"
    linear = True

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sine and cosine."""
        return _harmonic(self.order, 3e-4)

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """The joint's error added."""
        return _periodic_error(state, self.joint, self.order, values)


@dataclass(frozen=True)
class StrainWave(TransmissionError):
    """Ripple of a strain wave gear: as `TransmissionError`, n = gear ratio or twice that."""

    order: float
    name = "strain_wave"


@dataclass(frozen=True)
class JointScale:
    """A wrong gear ratio or encoder scale: theta += k q."""

    joint: int
    name = "joint_scale"
    linear = True
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
    linear = True

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
    linear = True
    parameters = (Parameter("b_rad", "rad", 5e-4, "width of the play"),)

    def apply(self, state: RobotState, *, b_rad: float) -> RobotState:
        """The joint's error added; nothing where the approach was not written down."""
        if state.poses.approach is None:
            return state
        return state.add_joint_error(self.joint, 0.5 * b_rad * np.sign(state.poses.approach[:, self.joint]))


@dataclass(frozen=True)
class AxisWobble:
    """A joint's axis that tilts as it turns, about its own origin, by cosine and sine of n q, n = 1 or 2.

    The part of n = 1 that turns with the link is plain geometry and is left to it: what is kept tilts the axis in the
    link before, about that link's x and y: alpha and beta of the row before, or the base for the first joint.
    """

    joint: int
    order: int
    name = "axis_wobble"
    linear = True

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Tilt about x and y, sine and cosine of each."""
        return tuple(
            Parameter(
                f"{axis}_{part}{self.order}_rad", "rad", 3e-4, f"tilt about {axis}, {part}({self.order} q)"
            )
            for axis in ("x", "y")
            for part in ("sin", "cos")
        )

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """The tilt added to the frame that carries the joint."""
        x_sin, x_cos, y_sin, y_cos = values.values()
        turned = self.order * state.q_rad[:, self.joint]
        about_x = x_sin * np.sin(turned) + x_cos * np.cos(turned)
        about_y = y_sin * np.sin(turned) + y_cos * np.cos(turned)
        if self.joint == 0:
            return state.turn_base(np.column_stack([about_x, about_y, np.zeros(len(turned))]))
        # Ry is the last factor of the row before, so beta turns about the y axis that this joint starts from; alpha's
        # axis is that frame's x where beta is small.
        before = self.joint - 1
        return state.add_link_error(before, "alpha", about_x).add_link_error(before, "beta", about_y)
