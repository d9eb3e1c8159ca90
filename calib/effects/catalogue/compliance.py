"""Effects of load: joints, links, base and tool that give way under gravity."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.dataset.dataset import Dataset
from calib.effects.catalogue.unknown_masses import (
    BaseComplianceUnknownMasses,
    JointComplianceUnknownMasses,
    LinkBendingUnknownMasses,
    family_of_unknown_masses,
    payload_varies,
    turn_and_stiffness,
)
from calib.effects.effect import CatalogueEffect, Family, Parameter
from calib.effects.gravity import has_masses
from calib.effects.state import RobotState
from calib.kinematics.robot import Robot


def where_masses_are_known(family: Family, robot: Robot) -> Family:
    """The family, which cannot be tested where robot.toml lacks masses."""
    if has_masses(robot):
        return family
    return replace(
        family,
        why_not="robot.toml has no masses and centres of mass of the links",
        would_help="add mass_kg and com_mm to each [[joints]]; a maker's data sheet or CAD is good enough",
    )


@dataclass(frozen=True)
class JointCompliance(CatalogueEffect):
    """A joint that gives way to gravity's torque about it: theta += c tau (a prismatic one: d += c force)."""

    joint: int
    name = "joint_compliance"
    equation = "theta_j += c_j tau_j(q, payload)"
    symbols = (("c_j", "rad/Nm"),)
    needs = "masses in robot.toml, or many poses; payload_kg where it varies"
    confirm = "the same poses with and without a payload: compliance grows with the load, nothing else does"
    linear = True
    parameters = (Parameter("c_rad_per_nm", "rad/Nm", 5e-5, "compliance; its inverse is the stiffness", positive=True),)

    def apply(self, state: RobotState, *, c_rad_per_nm: float) -> RobotState:
        """The joint's error added, for the torque at the state where loads are worked out (`RobotState.loaded`)."""
        return state.add_joint_error(self.joint, c_rad_per_nm * state.loaded.gravity.joint_torques[:, self.joint])

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """The turn at the largest torque of all poses, and the stiffness."""
        return turn_and_stiffness(value, state.gravity_torques_nm[:, self.joint])

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each joint; where masses are not known, one whose unknowns include them."""
        robot = dataset.robot
        if has_masses(robot):
            return Family(cls.name, tuple(cls(j) for j in range(robot.n_joints)))
        varies = payload_varies(dataset)
        members = tuple(
            JointComplianceUnknownMasses(j, places=robot.n_joints + 1 - j if joint.is_revolute else 1, payload=varies)
            for j, joint in enumerate(robot.joints)
        )
        return family_of_unknown_masses(cls.name, members)


@dataclass(frozen=True)
class GravityBacklash(CatalogueEffect):
    """Backlash of a joint that gravity presses to one side: theta += b / 2 sign(tau)."""

    joint: int
    name = "gravity_backlash"
    equation = "theta_j += b_j / 2 sign(tau_j)"
    symbols = (("b_j", "rad"),)
    needs = "masses in robot.toml"
    confirm = "poses on both sides of the angle where gravity's torque changes sign"
    linear = True
    parameters = (Parameter("b_rad", "rad", 5e-4, "width of the play", positive=True),)

    def apply(self, state: RobotState, *, b_rad: float) -> RobotState:
        """The joint's error added."""
        return state.add_joint_error(
            self.joint, 0.5 * b_rad * np.sign(state.loaded.gravity.joint_torques[:, self.joint])
        )

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each joint."""
        members = tuple(cls(j) for j in range(dataset.robot.n_joints))
        return where_masses_are_known(Family(cls.name, members), dataset.robot)


@dataclass(frozen=True)
class LinkBending(CatalogueEffect):
    """A link that bends under its weight and what hangs beyond it: a cantilever, c = L / EI (`GravityLoads.bending`).

    The part that turns about the next joint's axis is close to what compliance of that joint does; only the shift tells
    them apart.
    """

    joint: int  # the joint that moves the link
    name = "link_bending"
    equation = "end of link j turns by c_j M_j, c_j = L / EI"
    symbols = (("c_j", "rad/Nm"),)
    needs = "masses in robot.toml, or many poses"
    confirm = "the same poses with and without a payload; bending also shifts the link's end, so reach far out"
    linear = True
    parameters = (
        Parameter("c_rad_per_nm", "rad/Nm", 2e-5, "L / EI: turn of the link's end by a unit moment", positive=True),
    )

    def apply(self, state: RobotState, *, c_rad_per_nm: float) -> RobotState:
        """Turn about x, y and z of the link's end (alpha and beta of its row, theta of the next), and its shift."""
        link = self.joint
        turn, shift_mm = state.loaded.gravity.bendings[link]
        in_link = c_rad_per_nm * turn
        return (
            state.add_link_error(link, "alpha", in_link[:, 0])
            .add_link_error(link, "beta", in_link[:, 1])
            .add_link_error(link + 1, "theta", in_link[:, 2])
            .displace(c_rad_per_nm * shift_mm)
        )

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each joint's link; where masses are not known, one whose unknowns include them."""
        robot, n_joints = dataset.robot, dataset.robot.n_joints
        if has_masses(robot):
            return Family(cls.name, tuple(map(cls, range(n_joints))))
        varies = payload_varies(dataset)
        members = tuple(LinkBendingUnknownMasses(j, n_joints + 1 - j, varies) for j in range(n_joints))
        return family_of_unknown_masses(cls.name, members)


@dataclass(frozen=True)
class BaseCompliance(CatalogueEffect):
    """A pedestal that tilts under the moment M of the whole arm's weight: the base turns by diag(cx, cy, 0) M(q)."""

    name = "base_compliance"
    equation = "base turns by C M(q)"
    symbols = (("cx", "rad/Nm"), ("cy", "rad/Nm"))
    needs = "masses in robot.toml, or many poses"
    confirm = "a dial gauge at the foot while the arm swings round stretched out: it sees the base alone"
    linear = True
    parameters = (
        Parameter("cx_rad_per_nm", "rad/Nm", 2e-6, "tilt about x a unit moment", positive=True),
        Parameter("cy_rad_per_nm", "rad/Nm", 2e-6, "tilt about y a unit moment", positive=True),
    )

    def apply(self, state: RobotState, *, cx_rad_per_nm: float, cy_rad_per_nm: float) -> RobotState:
        """The base turned."""
        moment = state.loaded.gravity.moment_about(np.zeros((len(state.poses), 3)), 0)
        return state.turn_base(moment * np.array([cx_rad_per_nm, cy_rad_per_nm, 0.0]))

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """One member, for the whole arm; where masses are not known, one whose unknowns include them."""
        if has_masses(dataset.robot):
            return Family(cls.name, (cls(),))
        member = BaseComplianceUnknownMasses(dataset.robot.n_joints + 1, payload_varies(dataset))
        return family_of_unknown_masses(cls.name, (member,))


@dataclass(frozen=True)
class ToolSag(CatalogueEffect):
    """A tool that sags: it moves by R diag(c) R^T g, R = base_R_flange and g the unit vector along gravity."""

    name = "tool_sag"
    equation = "target moves by R diag(c) R^T g"
    symbols = (("c", "mm"),)
    needs = "tool attitudes that vary"
    confirm = "one place reached with the tool in different attitudes"
    linear = True
    parameters = tuple(Parameter(f"{a}_mm", "mm", 0.1, f"sag with gravity along the tool's {a}") for a in "xyz")

    def apply(self, state: RobotState, *, x_mm: float, y_mm: float, z_mm: float) -> RobotState:
        """The target displaced."""
        rotation = state.loaded.chain.base_T_flange[:, :3, :3]
        gravity_vector = np.array(state.robot.gravity_m_s2)
        down = gravity_vector / max(float(np.linalg.norm(gravity_vector)), 1e-12)
        in_tool = np.einsum("nji,j->ni", rotation, down) * np.array([x_mm, y_mm, z_mm])
        return state.displace(np.einsum("nij,nj->ni", rotation, in_tool))

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """One member, for the whole arm."""
        return Family(cls.name, (cls(),))
