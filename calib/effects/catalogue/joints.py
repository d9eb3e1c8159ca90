"""Effects of a joint's drive and bearings: the angle, or the axis, is not as commanded."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.dataset.dataset import Dataset
from calib.effects.effect import CatalogueEffect, Family, Parameter
from calib.effects.state import RobotState
from calib.kinematics.robot import Robot


def harmonic(order: float, scale: float) -> tuple[Parameter, ...]:
    """sin3_rad and cos3_rad, say, for a third harmonic."""
    suffix = f"{order:g}_rad".replace(".", "_")
    return tuple(Parameter(part + suffix, "rad", scale, f"{part}({order:g} q) amplitude") for part in ("sin", "cos"))


def _periodic_error(state: RobotState, joint: int, order: float, values: dict[str, float]) -> RobotState:
    """theta += A sin(n q) + B cos(n q), values A and B in rad."""
    sine, cosine = values.values()
    q = state.q_rad[:, joint]
    return state.add_joint_error(joint, sine * np.sin(order * q) + cosine * np.cos(order * q))


def revolute_joints(robot: Robot) -> list[int]:
    """Indices of the joints that turn."""
    return [j for j, joint in enumerate(robot.joints) if joint.is_revolute]


@dataclass(frozen=True)
class TransmissionError(CatalogueEffect):
    """An error that comes n times a turn: theta += A sin(n q) + B cos(n q), n = 1, 2 or 3.

    n = 1 is eccentricity of an encoder or gear. Over a small range of the joint the cosine of n = 1 is nearly a joint
    offset, its sine nearly a wrong gear ratio.
    """

    joint: int
    order: float
    name = "transmission_error"
    equation = "theta_j += A sin(n q_j) + B cos(n q_j), n = 1, 2, 3"
    symbols = (("sin_n", "rad"), ("cos_n", "rad"))
    needs = "joint angles over a good part of a turn"
    confirm = "one joint alone over a whole turn in small steps"
    linear = True

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sine and cosine."""
        return harmonic(self.order, 3e-4)

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """The joint's error added."""
        return _periodic_error(state, self.joint, self.order, values)

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each of three harmonics of each revolute joint."""
        return Family(cls.name, tuple(cls(j, n) for j in revolute_joints(dataset.robot) for n in (1, 2, 3)))


@dataclass(frozen=True)
class StrainWave(TransmissionError):
    """Ripple of a strain wave gear: as `TransmissionError`, n = gear ratio or twice that."""

    order: float
    name = "strain_wave"
    equation = "the same, n = gear ratio and 2 x gear ratio"
    symbols = (("sin_n", "rad"), ("cos_n", "rad"))
    needs = "gear_ratio in robot.toml"
    confirm = "one joint alone in steps of a tenth of a motor turn"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each of two harmonics of each revolute joint whose gear ratio is known."""
        members = tuple(
            cls(j, factor * joint.gear_ratio)
            for j, joint in enumerate(dataset.robot.joints)
            if joint.gear_ratio is not None and joint.is_revolute
            for factor in (1.0, 2.0)
        )
        if members:
            return Family(cls.name, members)
        return Family(cls.name, (), "robot.toml has no gear_ratio", "add gear_ratio to each [[joints]]")


@dataclass(frozen=True)
class JointScale(CatalogueEffect):
    """A wrong gear ratio or encoder scale: theta += k q."""

    joint: int
    name = "joint_scale"
    equation = "theta_j += k_j q_j"
    symbols = (("k_j", "1"),)
    needs = "joint angles over a good range"
    confirm = "one joint alone from end to end of its range: a scale error grows with the angle, harmonics come back"
    linear = True
    parameters = (Parameter("k", "1", 1e-4, "share of the commanded motion"),)

    def apply(self, state: RobotState, *, k: float) -> RobotState:
        """The joint's error added."""
        return state.add_joint_error(self.joint, k * state.q_rad[:, self.joint])

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """The error over the joint's travel in all poses."""
        travel = float(np.ptp(state.q_rad[:, self.joint]))
        if state.robot.joints[self.joint].is_revolute:
            turned = np.degrees(travel)
            return f"{turned * value:.2g}\N{DEGREE SIGN} over the {turned:.0f}\N{DEGREE SIGN} of its travel"
        return f"{travel * value:.2g} mm over the {travel:.0f} mm of its travel"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each joint."""
        return Family(cls.name, tuple(cls(j) for j in range(dataset.robot.n_joints)))


@dataclass(frozen=True)
class JointCoupling(CatalogueEffect):
    """A joint that another one moves along, as in wrists with bevel gears: theta_j += k q_i."""

    joint: int
    driver: int
    name = "joint_coupling"
    equation = "theta_j += k q_i, neighbours of the wrist"
    symbols = (("k", "1"),)
    needs = "three joints or more"
    confirm = "the driving joint alone with the driven one held still"
    linear = True

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One; the driving joint's number is in its name, as a joint may have two drivers."""
        return (Parameter(f"k_of_J{self.driver + 1}", "1", 1e-4, "share of the neighbour's motion"),)

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """The joint's error added."""
        (k,) = values.values()
        return state.add_joint_error(self.joint, k * state.q_rad[:, self.driver])

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """The error for each degree of the other joint."""
        return f"{value:.2g}\N{DEGREE SIGN} for each degree of the driving joint"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """The last two joints, each driven by its neighbour before it, and the last by the one before that."""
        n = dataset.robot.n_joints
        pairs = [(j, j - 1) for j in range(max(n - 2, 1), n)] + ([(n - 1, n - 3)] if n >= 3 else [])
        if n < 2:
            return Family(cls.name, (), "the arm has one joint", "nothing: there is no neighbour")
        return Family(cls.name, tuple(cls(joint, driver) for joint, driver in pairs))


@dataclass(frozen=True)
class Backlash(CatalogueEffect):
    """Backlash, which the side that the joint came from decides: theta += b / 2 sign(approach)."""

    joint: int
    name = "backlash"
    equation = "theta_j += b_j / 2 sign(approach_j)"
    symbols = (("b_j", "rad"),)
    needs = "approach1 ... in poses.csv, from both sides"
    confirm = "each pose twice, coming from the one side and from the other"
    linear = True
    parameters = (Parameter("b_rad", "rad", 5e-4, "width of the play"),)

    def apply(self, state: RobotState, *, b_rad: float) -> RobotState:
        """The joint's error added; nothing where the approach was not written down."""
        if state.poses.approach is None:
            return state
        return state.add_joint_error(self.joint, 0.5 * b_rad * np.sign(state.poses.approach[:, self.joint]))

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each joint that was moved to from both sides in the training poses."""
        poses = dataset.poses
        if poses.approach is None:
            return Family(
                cls.name,
                (),
                "poses.csv has no approach columns",
                "move to each pose from both sides and write approach1 ... (-1 or 1)",
            )
        sides = [np.unique(poses.approach[~poses.is_test, j]) for j in range(dataset.robot.n_joints)]
        both = [j for j, of_joint in enumerate(sides) if len(of_joint) > 1]
        if not both:
            return Family(
                cls.name,
                (),
                "every joint always came from the same side: backlash is then a joint offset",
                "come to some poses from the other side",
            )
        return Family(cls.name, tuple(cls(j) for j in both))


@dataclass(frozen=True)
class AxisWobble(CatalogueEffect):
    """A joint's axis that tilts as it turns, about its own origin, by cosine and sine of n q, n = 1 or 2.

    The part of n = 1 that turns with the link is plain geometry and is left to it: what is kept tilts the axis in the
    link before, about that link's x and y: alpha and beta of the row before, or the base for the first joint.
    """

    joint: int
    order: int
    name = "axis_wobble"
    equation = "axis j tilts about its origin by sin, cos of n q_j, n = 1, 2"
    symbols = (("x_sin_n", "rad"), ("y_cos_n", "rad"))
    needs = "joint angles over a good part of a turn"
    confirm = "one joint alone over a whole turn, with points at two distances from its axis"
    linear = True

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Tilt about x and y, sine and cosine of each."""
        return tuple(
            Parameter(f"{axis}_{part}{self.order}_rad", "rad", 3e-4, f"tilt about {axis}, {part}({self.order} q)")
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

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each of two harmonics of each revolute joint."""
        return Family(cls.name, tuple(cls(j, n) for j in revolute_joints(dataset.robot) for n in (1, 2)))
