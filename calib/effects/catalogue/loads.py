"""Further effects of load: springs that stiffen, links that twist, bearings with clearance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.dataset.dataset import Dataset
from calib.effects.catalogue.compliance import where_masses_are_known
from calib.effects.effect import CatalogueEffect, Family, Parameter
from calib.effects.state import RobotState

_SHORT_MM = 30.0  # a link that reaches out less does not twist
_STILL_NM = 0.01  # a bearing turns over from one side to the other within about this moment


@dataclass(frozen=True)
class NonlinearStiffness(CatalogueEffect):
    """A joint's spring that stiffens, or softens, with load: theta += c2 tau |tau|."""

    joint: int
    name = "nonlinear_stiffness"
    equation = "theta_j += c2_j tau_j abs(tau_j)"
    symbols = (("c2_j", "rad/Nm^2"),)
    needs = "masses in robot.toml; payload_kg where it varies"
    confirm = "the same poses under three payloads: the way from the first to the second is not that to the third"
    linear = True
    parameters = (Parameter("c2_rad_per_nm2", "rad/Nm^2", 5e-7, "compliance that grows with the torque"),)

    def apply(self, state: RobotState, *, c2_rad_per_nm2: float) -> RobotState:
        """The joint's error added."""
        torque = state.loaded.gravity.joint_torques[:, self.joint]
        return state.add_joint_error(self.joint, c2_rad_per_nm2 * torque * np.abs(torque))

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """The turn at the largest torque of all poses."""
        torque_nm = float(np.abs(state.gravity_torques_nm[:, self.joint]).max(initial=0.0))
        turn_deg = np.degrees(value) * torque_nm**2
        return f"{turn_deg:+.2g}\N{DEGREE SIGN} at {torque_nm:.3g} Nm"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each joint that turns."""
        turning = [j for j, joint in enumerate(dataset.robot.joints) if joint.is_revolute]
        return where_masses_are_known(Family(cls.name, tuple(map(cls, turning))), dataset.robot)


@dataclass(frozen=True)
class LinkTorsion(CatalogueEffect):
    """A link that twists about its own axis: its end turns by c times the moment along it of all that hangs beyond."""

    joint: int  # the joint that moves the link
    name = "link_torsion"
    equation = "end of link j turns about the link by c_j (M . e)"
    symbols = (("c_j", "rad/Nm"),)
    needs = "masses in robot.toml"
    confirm = "a weight beside the link's axis, on one side and on the other: the link's end turns"
    linear = True
    parameters = (Parameter("c_rad_per_nm", "rad/Nm", 2e-5, "twist by a unit moment", positive=True),)

    def apply(self, state: RobotState, *, c_rad_per_nm: float) -> RobotState:
        """Turn about x, y and z of the link's end: alpha and beta of its row, theta of the next."""
        link, loaded = self.joint, state.loaded
        base_T_frame = loaded.chain.base_T_frame
        end = base_T_frame[:, link + 1]
        span_mm = end[:, :3, 3] - base_T_frame[:, link, :3, 3]
        length_mm = np.linalg.norm(span_mm, axis=1, keepdims=True)
        along = np.where(length_mm >= 1.0, span_mm / np.maximum(length_mm, 1.0), 0.0)
        moment = loaded.gravity.moment_about(end[:, :3, 3], link + 1)
        turn = np.sum(moment * along, axis=1, keepdims=True) * along
        in_link = c_rad_per_nm * np.einsum("nji,nj->ni", end[:, :3, :3], turn)
        return (
            state.add_link_error(link, "alpha", in_link[:, 0])
            .add_link_error(link, "beta", in_link[:, 1])
            .add_link_error(link + 1, "theta", in_link[:, 2])
        )

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each link that reaches out from its joint's axis: the others' torsion is joint compliance."""
        rows = dataset.robot.table[:-1]
        out = np.abs(rows[:, 0]) > np.maximum(_SHORT_MM, 0.1 * np.abs(rows[:, 2]))
        members = tuple(cls(int(j)) for j in np.flatnonzero(out))
        if not members:
            along = "every link lies along its joint's axis, so that its torsion is the joint's compliance"
            return Family(cls.name, (), along, "nothing: joint_compliance is tested", covered=True)
        return where_masses_are_known(Family(cls.name, members), dataset.robot)


@dataclass(frozen=True)
class BearingClearance(CatalogueEffect):
    """A bearing with clearance: the joint's axis leans by a fixed angle to the side that the moment pushes it to."""

    joint: int
    name = "bearing_clearance"
    equation = "axis j leans by c_j toward the side that the moment across it pushes to"
    symbols = (("c_j", "rad"),)
    needs = "masses in robot.toml"
    confirm = "push the link by hand across its axis: it falls over from one side to the other"
    linear = True
    parameters = (Parameter("c_rad", "rad", 3e-4, "lean to either side", positive=True),)

    def apply(self, state: RobotState, *, c_rad: float) -> RobotState:
        """The tilt added to the frame that carries the joint."""
        frame = state.loaded.chain.base_T_frame[:, self.joint]
        moment = state.loaded.gravity.moment_about(frame[:, :3, 3], self.joint)
        x, y, _ = np.einsum("nji,nj->ni", frame[:, :3, :3], moment).T
        size = np.sqrt(x**2 + y**2 + _STILL_NM**2)
        about_x, about_y = c_rad * x / size, c_rad * y / size
        if self.joint == 0:
            return state.turn_base(np.column_stack([about_x, about_y, np.zeros(len(x))]))
        before = self.joint - 1  # as `AxisWobble`
        return state.add_link_error(before, "alpha", about_x).add_link_error(before, "beta", about_y)

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """A member for each joint that turns."""
        turning = [j for j, joint in enumerate(dataset.robot.joints) if joint.is_revolute]
        return where_masses_are_known(Family(cls.name, tuple(map(cls, turning))), dataset.robot)
