"""Friction: where a joint comes to rest depends on the way that it came."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.effects.effect import Family, NaturalBound, Parameter
from calib.effects.shaped import JointLaw
from calib.effects.state import RobotState

LENGTHS_DEG = (10, 30, 90)
"""Ways after which a joint that winds up smoothly has forgotten where it came from."""
SLIPS_DEG = (2, 7, 20, 40, 80, 160)
"""Ways from one side to the other, halved, of a joint that sticks and then slips; moves are far longer than the
shortest. A state that slips is sharper than one that fades: twice the way leaves a pattern that noise does not hide."""
STARTS = {0: "", 1: "come_up_", -1: "come_down_"}
"""States of friction at the first pose, of which the way to it is in no table: at rest, or wound up to either side."""


def hysteresis(q_rad: Array, length_rad: float, start: float = 0.0) -> Array:
    """Friction's state z (L,), between -1 and 1, of a joint that goes through angles (L,) one after the other.

    Dahl's model dz = (1 - z sign(dq)) dq / length, each move one way; z is `start` at the first.
    """
    way_rad = np.diff(q_rad)
    kept = np.exp(-np.abs(way_rad) / length_rad)
    z = [start]
    for share, more in zip(kept.tolist(), (np.sign(way_rad) * (1.0 - kept)).tolist(), strict=True):
        z.append(share * z[-1] + more)
    return np.array(z)


def stick_and_slip(q_rad: Array, width_rad: float, start: float = 0.0) -> Array:
    """State z (L,) of a spring and a dry slider in a row, as `hysteresis`: dz = dq / width, held between -1 and 1.

    A few of them side by side are Maxwell's slip model: what small moves wound up is still there after they are undone.
    """
    z = [start]
    for more in (np.diff(q_rad) / width_rad).tolist():
        z.append(min(max(z[-1] + more, -1.0), 1.0))
    return np.array(z)


@dataclass(frozen=True)
class PathFriction(JointLaw):
    """Friction that winds a drive up: theta += h z, z by Dahl's model of all moves up to the pose.

    Every pose that was measured counts, used by the fit or not, in the order of measuring. Poses after all measured
    ones, such as the targets of a correction, are taken as without it.
    """

    length_deg: int  # way after which z has come to 1 - 1/e of the other side; half the way to it where it slips
    start: int = 0  # z at the first pose, of `STARTS`
    slips: bool = False  # whether it sticks and slips
    name = "path_friction"
    title = "friction with a memory of the path"
    noun = "friction that remembers the path of joint"
    changes_arm = True
    equation = "theta_j += h z_j, dz = (1 - z sign(dq)) dq / L, or dq / L between -1 and 1, through all poses"
    symbols = (("h", "rad"),)
    needs = "all poses that the arm went to, in the order they were measured: time_s, else the rows"
    confirm = "one pose from both sides, each after a long and after a short way: the difference grows with the way"
    bounds = (NaturalBound(5e-3, "rad", "friction of a tenth of a drive's torque winds it up by 1e-3 rad"),)
    notes = r"""
    $$ \delta \theta_j = h \, z_j, \qquad dz = ( 1 - z \, \mathrm{sign}(dq) ) \, \frac{dq}{L}, \quad
    L = 10, 30, 90° $$

    Dahl's model: the drive stops wound up against the way it came, by the less the shorter the way was, and what is
    left of the way before fades with it. A spring and a dry slider in a row, $dz = dq / L$ between -1 and 1 with $L$ =
    2, 7, 20, ... 160°, remember longer: what a small move winds up, the same move back takes away. Several of both side
    by side are Maxwell's slip model. The way to the first pose is in no table: $z$ starts from 0, 1 or -1. With $L$ far
    below all moves it is {doc}`backlash` by the side that the order of the poses tells; with $L$ far above them it is
    the way itself, a {doc}`following_error`. It is reckoned through every pose that was measured, test poses and poses
    left out with them. Where the arm went to places in between that are no poses, it is not what happened.
    """
    position = 33

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Largest turn by friction, with the way and the start in the parameter's name."""
        word = "slipping" if self.slips else "over"
        name = f"{STARTS.get(self.start, '')}{word}_{self.length_deg}deg_rad"
        return (Parameter(name, "rad", 3e-4, "turn by friction after a long way"),)

    def shapes(self, state: RobotState) -> Array:
        q_rad = state.poses.sequence.q[:, self.joint]
        law = stick_and_slip if self.slips else hysteresis
        return state.poses.from_sequence(law(q_rad, np.radians(self.length_deg), float(self.start)))[:, None]

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Difference between both sides, and the way to either, as text."""
        degree = "\N{DEGREE SIGN}"
        return (
            f"{2.0 * abs(np.degrees(value)):.2g}{degree} between both sides, within ways of {self.length_deg}{degree}"
        )

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each revolute joint, law, length and start.

        Where a joint never moves far enough to slip, friction that slips is a spring alone: a scale error of the joint.
        One that slips within the shortest way is backlash where the sides of approach are known.
        """
        widths_deg = SLIPS_DEG if dataset.poses.approach is None else SLIPS_DEG[1:]
        laws = [*((deg, False) for deg in LENGTHS_DEG), *((deg, True) for deg in widths_deg)]
        joints = dataset.robot.revolute_joints
        way_rad = dataset.poses.sequence.q - dataset.poses.sequence.q[0]

        def slips_ever(member: PathFriction) -> bool:
            way = way_rad[:, member.joint] / np.radians(member.length_deg)
            return bool(np.abs(member.start + way).max() > 1.0 and np.ptp(way) > 1.0)

        tried = (cls(j, deg, start, slips) for j in joints for deg, slips in laws for start in STARTS)
        members = tuple(member for member in tried if not member.slips or slips_ever(member))
        if not joints:
            return cls.untestable("no joint turns", "nothing: it is a matter of drives that turn")
        limits = ("backlash", "following_error", "joint_scale")  # of a way far below, about and far above all moves
        return Family(cls.name, members, sparse=True, superposed=True, contains=limits)
