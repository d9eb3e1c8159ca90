"""Friction: where a joint comes to rest depends on the way that it came."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.effects.catalogue.joints import revolute_joints
from calib.effects.effect import Family, NaturalBound, Parameter
from calib.effects.shaped import JointOffset, ShapedEffect
from calib.effects.state import RobotState

LENGTHS_DEG = (3, 10, 30, 90)
"""Ways after which a joint has forgotten where it came from; moves are far longer than the shortest."""


def hysteresis(q_rad: Array, length_rad: float) -> Array:
    """Friction's state z (L,), between -1 and 1, of a joint that goes through angles (L,) one after the other.

    Dahl's model dz = (1 - z sign(dq)) dq / length, each move one way; z is 0 before the first.
    """
    z = np.zeros(len(q_rad))
    for k, way in enumerate(np.diff(q_rad), start=1):
        side = np.sign(way)
        z[k] = side + (z[k - 1] - side) * np.exp(-abs(way) / length_rad)
    return z


@dataclass(frozen=True)
class PathFriction(ShapedEffect):
    """Friction that winds a drive up: theta += h z, z by Dahl's model of all moves up to the pose.

    Every pose that was measured counts, used by the fit or not, in the order of measuring. Poses after all measured
    ones, such as the targets of a correction, are taken as without it.
    """

    joint: int
    length_deg: int  # way after which z has come to 1 - 1/e of the other side
    name = "path_friction"
    title = "friction with a memory of the path"
    noun = "friction that remembers the path of joint"
    changes_arm = True
    equation = "theta_j += h z_j, dz = (1 - z sign(dq)) dq / L through all poses"
    symbols = (("h", "rad"),)
    needs = "all poses that the arm went to, in the order they were measured: time_s, else the rows"
    confirm = "one pose from both sides, each after a long and after a short way: the difference grows with the way"
    bounds = (NaturalBound(5e-3, "rad", "friction of a tenth of a drive's torque winds it up by 1e-3 rad"),)
    notes = r"""
    $$ \delta \theta_j = h \, z_j, \qquad dz = ( 1 - z \, \mathrm{sign}(dq) ) \, \frac{dq}{L}, \quad
    L = 3, 10, 30, 90° $$

    Dahl's model: the drive stops wound up against the way it came, by the less the shorter the way was, and what is
    left of the way before fades with it. With $L$ far below all moves it is {doc}`backlash` by the side that the order
    of the poses tells; with $L$ far above them it is the way itself, a {doc}`following_error`. It is reckoned through
    every pose that was measured, test poses and poses left out with them. Where the arm went to places in between that
    are no poses, it is not what happened.
    """
    position = 33

    @property
    def displacement(self) -> JointOffset:
        return JointOffset(self.joint)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Largest turn by friction, with the way in the parameter's name."""
        return (Parameter(f"over_{self.length_deg}deg_rad", "rad", 3e-4, "turn by friction after a long way"),)

    def shapes(self, state: RobotState) -> Array:
        measured_q = state.poses.sequence.q[:, self.joint]
        return state.poses.from_sequence(hysteresis(measured_q, np.radians(self.length_deg)))[:, None]

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Difference between both sides, and the way to either, as text."""
        degree = "\N{DEGREE SIGN}"
        return (
            f"{2.0 * abs(np.degrees(value)):.2g}{degree} between both sides, within ways of {self.length_deg}{degree}"
        )

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each revolute joint and each of four lengths."""
        members = tuple(cls(j, deg) for j in revolute_joints(dataset.robot) for deg in LENGTHS_DEG)
        if not members:
            return Family(cls.name, (), "no joint turns", "nothing: it is a matter of drives that turn")
        return Family(cls.name, members, sparse=True)
