"""Effects of load where robot.toml has no masses: what gives way, times the unknown mass at each frame, is fitted.

A mass along a link acts as a sum of masses at its ends, so that 1 kg at each frame spans what the true masses do. The
effects stay linear: each parameter is a compliance times the mass that hangs at one frame. A payload that varies is
known in kg, so the factor of its load is the compliance itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.effects.effect import Effect, Family, Parameter
from calib.effects.state import RobotState

NOTE = "robot.toml has no masses: compliance times unknown masses is fitted"
ALIKE = (
    "joint_compliance",
    "link_bending",
    "base_compliance",
    "gravity_backlash",
    "nonlinear_stiffness",
    "link_torsion",
    "bearing_clearance",
)
"""Families that follow the load, and cannot be told apart for sure where masses are not known."""
_USUAL_KG = 4.0  # that hangs at a frame
_JOINT, _LINK, _BASE = 5e-5, 2e-5, 2e-6  # rad/Nm, usual compliances


def family_of_unknown_masses(name: str, members: tuple[Effect, ...]) -> Family:
    """The family, which stays open beside the others of load."""
    others = tuple(other for other in ALIKE if other != name)
    return Family(name, members, note=NOTE, open_with=others)


def payload_varies(dataset: Dataset) -> bool:
    """Whether it does over the training poses."""
    poses = dataset.poses
    return poses.payload_kg is not None and bool(np.ptp(poses.payload_kg[~poses.is_test]) > 0.0)


def turn_and_stiffness(c_rad_per_nm: float, torque_nm: Array) -> str:
    """The turn at the largest of some torques (N,), and the stiffness."""
    largest_nm = float(np.abs(torque_nm).max(initial=0.0))
    if largest_nm <= 0.0:
        return stiffness(c_rad_per_nm)
    turn_deg = np.degrees(abs(c_rad_per_nm)) * largest_nm
    return f"{turn_deg:.2g}\N{DEGREE SIGN} at {largest_nm:.3g} Nm, {stiffness(c_rad_per_nm)}"


def stiffness(c_rad_per_nm: float) -> str:
    """ "stiffness 250 kNm/rad": the inverse of a compliance, three figures with a prefix."""
    value = 1.0 / abs(c_rad_per_nm)
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= factor:
            return f"stiffness {value / factor:.3g} {prefix}Nm/rad"
    return f"stiffness {value:.3g} Nm/rad"


def _products(prefix: str, frames: Iterator[int] | range, compliance: float, axis: str = "") -> tuple[Parameter, ...]:
    """One parameter for each frame: compliance times the mass that hangs there."""
    doc = f"compliance{axis and f' about {axis}'} times the mass at a frame"
    return tuple(Parameter(f"{prefix}_{k}", "rad kg/Nm", _USUAL_KG * compliance, doc) for k in frames)


@dataclass(frozen=True)
class JointComplianceUnknownMasses:
    """A joint that gives way: theta += sum over frames beyond of (c m) x torque of 1 kg there."""

    joint: int
    places: int  # frames beyond the joint, the tool point included
    payload: bool  # whether it varies over the training poses
    name = "joint_compliance"
    equation = "theta_j += sum (c_j m_k) torque of 1 kg at frame k"
    symbols = (("c_j m_k", "rad kg/Nm"),)
    needs = "many poses"
    confirm = "the same poses with and without a payload: compliance grows with the load, nothing else does"
    linear = True

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One for each frame beyond the joint, and the compliance where the payload varies."""
        masses = _products("cm_at", range(self.joint + 1, self.joint + 1 + self.places), _JOINT)
        known = Parameter("c_rad_per_nm", "rad/Nm", _JOINT, "compliance; its inverse is the stiffness", positive=True)
        return (*masses, known) if self.payload else masses

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """The joint's error added."""
        gravity = state.loaded.gravity
        torques = gravity.unit_torques(self.joint)  # (N, K)
        if self.payload:
            torques = np.column_stack([torques, gravity.payload_torque(self.joint)])
        return state.add_joint_error(self.joint, torques @ np.array(list(values.values())))

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """What the compliance means on this arm; "" for a product with an unknown mass."""
        if parameter.unit != "rad/Nm":
            return ""
        return turn_and_stiffness(value, state.gravity_torques_nm[:, self.joint])


@dataclass(frozen=True)
class LinkBendingUnknownMasses:
    """A link that bends: its end turns and shifts by the sum over frames beyond of (c m) x that of 1 kg there."""

    joint: int  # the joint that moves the link
    places: int  # frames from the link's end on, the tool point included
    payload: bool  # whether it varies over the training poses
    name = "link_bending"
    equation = "end of link j turns by sum (c_j m_k) moment of 1 kg at frame k"
    symbols = (("c_j m_k", "rad kg/Nm"),)
    needs = "many poses"
    confirm = "the same poses with and without a payload; bending also shifts the link's end, so reach far out"
    linear = True

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One for each frame from the link's end on, and L / EI where the payload varies."""
        masses = _products("cm_at", range(self.joint + 1, self.joint + 1 + self.places), _LINK)
        known = Parameter("c_rad_per_nm", "rad/Nm", _LINK, "L / EI: turn of its end by a unit moment", positive=True)
        return (*masses, known) if self.payload else masses

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """Turn about x, y and z of the link's end (alpha and beta of its row, theta of the next), and its shift."""
        link, gravity = self.joint, state.loaded.gravity
        weights = np.array(list(values.values()))
        turns, shifts_mm = gravity.unit_bendings[link]  # (N, K, 3)
        in_link = np.einsum("nki,k->ni", turns, weights[: self.places])
        shift_mm = np.einsum("nki,k->ni", shifts_mm, weights[: self.places])
        if self.payload:
            turn, shift = gravity.payload_bending(link)
            in_link, shift_mm = in_link + weights[-1] * turn, shift_mm + weights[-1] * shift
        return (
            state.add_link_error(link, "alpha", in_link[:, 0])
            .add_link_error(link, "beta", in_link[:, 1])
            .add_link_error(link + 1, "theta", in_link[:, 2])
            .displace(shift_mm)
        )


@dataclass(frozen=True)
class BaseComplianceUnknownMasses:
    """A pedestal that tilts by the sum over frames of (c m) x the moment of 1 kg there, about x and y apart."""

    places: int  # frames beyond the base, the tool point included
    payload: bool  # whether it varies over the training poses
    name = "base_compliance"
    equation = "base turns by sum (C m_k) moment of 1 kg at frame k"
    symbols = (("cx m_k", "rad kg/Nm"), ("cy m_k", "rad kg/Nm"))
    needs = "many poses"
    confirm = "a dial gauge at the foot while the arm swings round stretched out: it sees the base alone"
    linear = True

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """About x, then about y: one for each frame, and the compliance where the payload varies."""
        out: list[Parameter] = []
        for axis in "xy":
            out += _products(f"c{axis}m_at", range(1, 1 + self.places), _BASE, axis)
            if self.payload:
                out.append(
                    Parameter(
                        f"c{axis}_rad_per_nm",
                        "rad/Nm",
                        _BASE,
                        f"tilt about {axis} a unit moment",
                        positive=True,
                    )
                )
        return tuple(out)

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """The base turned."""
        gravity = state.loaded.gravity
        moments = gravity.unit_moments  # (N, K, 3)
        if self.payload:
            moments = np.concatenate([moments, gravity.payload_moment_about(np.zeros(3))[:, None]], axis=1)
        about_x, about_y = np.array(list(values.values())).reshape(2, -1)
        turn = np.zeros((len(moments), 3))
        turn[:, 0], turn[:, 1] = moments[..., 0] @ about_x, moments[..., 1] @ about_y
        return state.turn_base(turn)
