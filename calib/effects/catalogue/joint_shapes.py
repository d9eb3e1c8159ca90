"""Effects of a joint's drive beside the first harmonics: a damaged tooth, encoder lines, a cable, a late reading."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.effects.catalogue.joints import harmonic, revolute_joints
from calib.effects.catalogue.order_steps import shows
from calib.effects.effect import CatalogueEffect, Family, Parameter
from calib.effects.shaped import JointOffset, ShapedEffect
from calib.effects.state import RobotState

DENT_WIDTHS_DEG = (4, 7, 12, 20)  # standard deviations of a dent's shape
FEWEST_INSIDE = 3  # training poses within 1.2 of them: with fewer a dent is only an outlier
HIGH_ORDERS = range(4, 21)


@dataclass(frozen=True)
class JointDent(ShapedEffect):
    """A damaged place in a gear: theta is off in a narrow range, h exp(-(q - place)^2 / 2 width^2)."""

    joint: int
    place_deg: int
    width_deg: int
    name = "joint_dent"
    equation = "theta_j += h in a narrow range of q_j"
    symbols = (("h", "rad"),)
    needs = "three poses or more within the range"
    confirm = "one joint alone in steps of a degree through the place, from both sides"

    @property
    def displacement(self) -> JointOffset:
        return JointOffset(self.joint)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The height; place and width are in its name."""
        place = f"{'minus' if self.place_deg < 0 else ''}{abs(self.place_deg)}"
        return (Parameter(f"at_{place}deg_{self.width_deg}deg_wide_rad", "rad", 3e-4, "height of the dent"),)

    def shapes(self, state: RobotState) -> Array:
        off = state.q_rad[:, self.joint] - np.radians(self.place_deg)
        near = np.remainder(off + np.pi, 2.0 * np.pi) - np.pi  # over the nearer way round
        return np.exp(-0.5 * (near[:, None] / np.radians(self.width_deg)) ** 2)

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Where and by how much."""
        degree = "\N{DEGREE SIGN}"
        return (
            f"joint {self.joint + 1} is off by {np.degrees(value):+.2g}{degree} around {self.place_deg}{degree}, "
            f"{self.width_deg}{degree} wide (one sigma)"
        )

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each revolute joint, width and place that enough poses show."""
        poses = dataset.poses
        q_deg = np.degrees(poses.q[shows(dataset)])
        members = []
        for joint in revolute_joints(dataset.robot):
            angle = q_deg[:, joint]
            for width_deg in DENT_WIDTHS_DEG:
                places = np.arange(np.floor(angle.min()), angle.max() + 1.0, width_deg // 2)
                off = np.remainder(angle[:, None] - places + 180.0, 360.0) - 180.0
                inside = np.count_nonzero(np.abs(off) < 1.2 * width_deg, axis=0)
                members += [cls(joint, int(p), width_deg) for p in places[inside >= FEWEST_INSIDE]]
        if members:
            return Family(cls.name, tuple(members), sparse=True)
        few = f"nowhere are {FEWEST_INSIDE} poses within a few degrees of a joint"
        return Family(cls.name, (), few, "measure more poses")


@dataclass(frozen=True)
class HighHarmonic(ShapedEffect):
    """Teeth, or the lines of an encoder: theta += A sin(n q) + B cos(n q), n = 4 to 20."""

    joint: int
    order: int
    name = "high_harmonic"
    equation = "theta_j += A sin(n q_j) + B cos(n q_j), n = 4 ... 20"
    symbols = (("sin_n", "rad"), ("cos_n", "rad"))
    needs = "joint angles over a good part of a turn"
    confirm = "one joint alone over 90 degrees in steps of a degree"

    @property
    def displacement(self) -> JointOffset:
        return JointOffset(self.joint)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sine and cosine."""
        return harmonic(self.order, 1e-4)

    def shapes(self, state: RobotState) -> Array:
        turned = self.order * state.q_rad[:, self.joint]
        return np.column_stack([np.sin(turned), np.cos(turned)])

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each of 17 harmonics of each revolute joint."""
        joints = revolute_joints(dataset.robot)
        return Family(cls.name, tuple(cls(j, n) for j in joints for n in HIGH_ORDERS), sparse=True)


@dataclass(frozen=True)
class CableDrag(ShapedEffect):
    """A cable over two neighbouring joints that pulls one of them: harmonics of their sum, or of their difference."""

    joint: int  # that is pulled
    other: int
    sign: int  # 1 for the sum, -1 for the difference
    order: int
    name = "cable_drag"
    equation = "theta_j += A sin(n u) + B cos(n u), u = q_j +- q_(j+1) or q_j +- q_(j-1), n = 1, 2"
    symbols = (("sin_n", "rad"), ("cos_n", "rad"))
    needs = "two neighbouring joints over a good part of a turn, each for itself"
    confirm = "the same poses with the cable or hose taken off"

    @property
    def displacement(self) -> JointOffset:
        return JointOffset(self.joint)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sine and cosine; the other joint is in their names."""
        way = "with" if self.sign > 0 else "against"
        return tuple(
            Parameter(f"{part}{self.order}_{way}_J{self.other + 1}_rad", "rad", 3e-4, f"{part} amplitude")
            for part in ("sin", "cos")
        )

    def shapes(self, state: RobotState) -> Array:
        turned = self.order * (state.q_rad[:, self.joint] + self.sign * state.q_rad[:, self.other])
        return np.column_stack([np.sin(turned), np.cos(turned)])

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Members for both joints of each pair of neighbours that turn, two harmonics of the sum and the difference."""
        turning = revolute_joints(dataset.robot)
        pairs = [(j, k) for j in turning for k in turning if abs(j - k) == 1]
        if not pairs:
            return Family(cls.name, (), "no two neighbouring joints turn", "nothing: no cable runs so")
        members = [cls(j, k, sign, order) for j, k in pairs for sign in (1, -1) for order in (1, 2)]
        return Family(cls.name, tuple(members), sparse=True)


@dataclass(frozen=True)
class AsymmetricScale(CatalogueEffect):
    """An encoder or drive that errs alike to both sides of its zero: theta += k |q|."""

    joint: int
    name = "asymmetric_scale"
    equation = "theta_j += k_j abs(q_j)"
    symbols = (("k_j", "1"),)
    needs = "joint angles on both sides of zero"
    confirm = "one joint alone from end to end of its range: the error turns round at zero"
    linear = True
    parameters = (Parameter("k", "1", 1e-4, "share of the commanded motion"),)

    def apply(self, state: RobotState, *, k: float) -> RobotState:
        """The joint's error added."""
        return state.add_joint_error(self.joint, k * np.abs(state.q_rad[:, self.joint]))

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each joint."""
        return Family(cls.name, tuple(cls(j) for j in range(dataset.robot.n_joints)))


@dataclass(frozen=True)
class FollowingError(CatalogueEffect):
    """A joint that is read before it settled: a share of the way from the pose before is still to go.

    Poses that come after all that were measured are taken as waited for: nothing is still to go there.
    """

    joint: int
    name = "following_error"
    changes_arm = True
    equation = "theta_j += k_j (q_j - q_j of the pose before)"
    symbols = (("k_j", "1"),)
    needs = "poses in the order they were measured: time_s, else the rows"
    confirm = "the same poses after a longer wait"
    linear = True
    parameters = (Parameter("k", "1", 1e-4, "share of the way from the pose before"),)

    def apply(self, state: RobotState, *, k: float) -> RobotState:
        """The joint's error added."""
        return state.add_joint_error(self.joint, k * state.poses.motion[:, self.joint])

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each joint."""
        return Family(cls.name, tuple(cls(j) for j in range(dataset.robot.n_joints)))
