"""Compliance under load: joints, links, bearings, base and tool that give way to gravity.

Where robot.toml has no masses, compliance times the unknown mass at each frame is fitted. A mass along a link acts as a
sum of masses at its ends, so that 1 kg at each frame spans what the true masses do. The effects stay linear. A payload
that varies is known in kg, so the factor of its load is the compliance itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset, PoseCondition
from calib.effects.effect import (
    CatalogueEffect,
    Effect,
    Family,
    NaturalBound,
    Parameter,
    Parameters,
    registered_effects,
)
from calib.effects.gravity import has_masses, loaded_joints
from calib.effects.shaped import JointLaw, tilted_axis, turned_end
from calib.effects.state import RobotState
from calib.kinematics.robot import Robot

PLAY = "robot gears are made with 3e-4 rad of play (one arc minute), worn ones have a few times that"
"""Source of the natural bound of backlash."""
_UNKNOWN_MASSES = "robot.toml has no masses: compliance times unknown masses is fitted"
_USUAL_KG = 4.0  # that hangs at a frame
_JOINT, _LINK, _BASE = 5e-5, 2e-5, 2e-6  # rad/Nm, usual compliances
_SHORT_MM = 30.0  # a link that reaches out less does not twist
_KNEES = (0.1, 0.3)  # of a joint's largest torque, at which a soft wind-up is used up
_UNLOADED_NM = 0.05  # a joint whose largest torque is below shows no wind-up
_STILL_NM = 0.01  # a bearing turns over from one side to the other within about this moment


def where_masses_are_known(family: Family, robot: Robot) -> Family:
    """An effect family, unchanged, or marked as not testable where robot.toml lacks masses."""
    if has_masses(robot):
        return family
    return replace(
        family,
        why_not="robot.toml has no masses and centres of mass of the links",
        would_help="add mass_kg and com_mm to each [[joints]]; a maker's data sheet or CAD is good enough",
    )


def measured_note(robot: Robot) -> str:
    """Clause that says at which joints a measured torque is the load; "" where none was measured."""
    joints = [str(load.joint + 1) for load in robot.measured_loads]
    if not joints:
        return ""
    several = len(joints) > 1
    return f"the measured torque is the load of {'joints' if several else 'joint'} {', '.join(joints)}"


def where_load_is_known(family: Family, robot: Robot) -> Family:
    """An effect family with its members at joints of known load, by masses or measured torque; or not testable."""
    known = loaded_joints(robot)
    if not known:
        return where_masses_are_known(family, robot)
    members = tuple(member for member in family.members if getattr(member, "joint", None) in known)
    return replace(family, members=members, note=measured_note(robot))


def _family_of_unknown_masses(name: str, members: tuple[Effect, ...]) -> Family:
    """Family of a load effect with unknown masses, marked as confounded with all other load effects."""
    others = tuple(kind.name for kind in registered_effects() if kind.under_load and kind.name != name)
    return Family(name, members, note=_UNKNOWN_MASSES, confounded_with=others)


def _payload_varies(dataset: Dataset) -> bool:
    """Whether the payload differs between training poses."""
    poses = dataset.poses
    return poses.payload_kg is not None and bool(np.ptp(poses.payload_kg[~poses.is_test]) > 0.0)


def _turn_and_stiffness(c_rad_per_nm: float, torque_nm: Array) -> str:
    """Joint's turn at the largest of N torques, and its stiffness: "0.051° at 63.3 Nm, stiffness 71 kNm/rad"."""
    largest_nm = float(np.abs(torque_nm).max(initial=0.0))
    if largest_nm <= 0.0:
        return stiffness(c_rad_per_nm)
    turn_deg = np.degrees(abs(c_rad_per_nm)) * largest_nm
    return f"{turn_deg:.2g}\N{DEGREE SIGN} at {largest_nm:.3g} Nm, {stiffness(c_rad_per_nm)}"


def stiffness(c_rad_per_nm: float) -> str:
    """Inverse of a compliance as text, three figures with a prefix: "stiffness 250 kNm/rad"; no number below zero."""
    if c_rad_per_nm < 0.0:
        return "against the torque, as no spring turns"
    value = 1.0 / c_rad_per_nm
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= factor:
            return f"stiffness {value / factor:.3g} {prefix}Nm/rad"
    return f"stiffness {value:.3g} Nm/rad"


def _products(prefix: str, frames: Iterator[int] | range, compliance: float, axis: str = "") -> Parameters:
    """Parameters for unknown masses, one for each frame: compliance times the mass at that frame."""
    doc = f"compliance{axis and f' about {axis}'} times the mass at a frame"
    return tuple(Parameter(f"{prefix}_{k}", "rad kg/Nm", _USUAL_KG * compliance, doc) for k in frames)


def _tilt(axis: str) -> Parameter:
    """Parameter for the base's compliance about its x or y axis."""
    return Parameter(f"c{axis}_rad_per_nm", "rad/Nm", _BASE, f"tilt about {axis} by a unit moment", positive=True)


@dataclass(frozen=True)
class JointCompliance(JointLaw):
    """A joint that gives way to gravity's torque about it: theta += c tau (a prismatic one: d += c force)."""

    name = "joint_compliance"
    noun = "the compliance of joint"
    equation = "theta_j += c_j tau_j(q, payload)"
    symbols = (("c_j", "rad/Nm"),)
    needs = "masses in robot.toml or torque<j>_nm in poses.csv, or many poses; payload_kg where it varies"
    helpful_conditions: ClassVar[tuple[PoseCondition, ...]] = ("payload_kg",)
    confirm = "the same poses with and without a payload: compliance grows with the load, nothing else does"
    bounds = (
        NaturalBound(1e-3, "rad/Nm", "the smallest strain wave gears turn by 1e-3 rad/Nm (makers' tables: 1 kNm/rad)"),
        NaturalBound(5e-2, "rad kg/Nm", "that is 50 kg on the smallest strain wave gear (1 kNm/rad)"),
    )
    notes = r"""
    $$ \delta \theta_j = c_j \, \tau_j(q, \text{payload}), \qquad
    \tau_j = z_j \cdot \sum_k (c_k - o_j) \times m_k g $$

    The torque is that of {doc}`/method/kinematics`. Without masses in robot.toml the products $c_j m_k$ of compliance
    and the mass at each frame are fitted; the law stays linear.

    On real arms it comes first almost everywhere: of a small ABB arm under a tracker, geometry with gravity terms
    brought the held-out error from 0.28 to 0.107 mm.
    """
    position = 1
    under_load = True

    @cached_property
    def parameters(self) -> Parameters:
        """Compliance of the joint."""
        return (Parameter("c_rad_per_nm", "rad/Nm", _JOINT, "compliance; its inverse is the stiffness", positive=True),)

    def shapes(self, state: RobotState) -> Array:
        return state.loaded.gravity.joint_torques[:, [self.joint]]

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Turn at the largest torque of all poses, and the stiffness, as text."""
        return _turn_and_stiffness(value, state.gravity_torques_nm[:, self.joint])

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each joint; unknown masses become part of the parameters."""
        robot, varies = dataset.robot, _payload_varies(dataset)
        known = loaded_joints(robot)
        members = tuple(
            cls(j)
            if j in known
            else JointComplianceUnknownMasses(
                j, places=robot.n_joints + 1 - j if joint.is_revolute else 1, payload=varies
            )
            for j, joint in enumerate(robot.joints)
        )
        if len(known) == robot.n_joints:
            return Family(cls.name, members, note=measured_note(robot))
        family = _family_of_unknown_masses(cls.name, members)
        told = "; ".join(filter(None, (measured_note(robot), _UNKNOWN_MASSES + " for the others")))
        return replace(family, note=told, confounded_with=()) if known else family


@dataclass(frozen=True)
class JointComplianceUnknownMasses(JointCompliance):
    """Compliance of a joint under unknown masses: theta += sum over later frames of (c m) x torque of 1 kg there."""

    places: int  # frames beyond the joint, the tool point included
    payload: bool  # whether it varies over the training poses
    equation = "theta_j += sum (c_j m_k) torque of 1 kg at frame k"
    symbols = (("c_j m_k", "rad kg/Nm"),)
    needs = "many poses"
    helpful_conditions = ()

    @cached_property
    def parameters(self) -> Parameters:
        """Compliance times mass for each frame beyond the joint, and the compliance where the payload varies."""
        masses = _products("cm_at", range(self.joint + 1, self.joint + 1 + self.places), _JOINT)
        known = Parameter("c_rad_per_nm", "rad/Nm", _JOINT, "compliance; its inverse is the stiffness", positive=True)
        return (*masses, known) if self.payload else masses

    def shapes(self, state: RobotState) -> Array:
        gravity = state.loaded.gravity
        torques = gravity.unit_torques(self.joint)  # (N, K)
        return np.column_stack([torques, gravity.payload_torque(self.joint)]) if self.payload else torques

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Turn at the largest torque, and stiffness, as text; "" for a product with an unknown mass."""
        if parameter.unit != "rad/Nm":
            return ""
        return _turn_and_stiffness(value, state.gravity_torques_nm[:, self.joint])


@dataclass(frozen=True)
class LinkBending(CatalogueEffect):
    """A link that bends under its own weight and later ones: a cantilever, c = L / EI (`GravityLoads.bending`).

    The part that turns about the next joint's axis is close to what compliance of that joint does; only the shift tells
    them apart.
    """

    joint: int  # the joint that moves the link
    name = "link_bending"
    noun = "the bending of the link behind joint"
    equation = "end of link j turns by c_j M_j, c_j = L / EI"
    symbols = (("c_j", "rad/Nm"),)
    needs = "masses in robot.toml, or many poses"
    confirm = "the same poses with and without a payload; bending also shifts the link's end, so reach far out"
    bounds = (
        NaturalBound(5e-4, "rad/Nm", "half a metre of aluminium tube, 40 mm by 3 mm, bends by 1e-4 rad/Nm"),
        NaturalBound(2.5e-2, "rad kg/Nm", "that is 50 kg on a link of 2 kNm/rad"),
    )
    notes = r"""
    A cantilever after Euler and Bernoulli, $c_j = L / EI$. With the moments across the link at its root and end, $M_0$
    and $M_L$, of all beyond it, and $M_1$ of its own weight at the root, its end turns and moves by

    $$ \phi = c_j \left( \frac{M_0 + M_L}{2} + \frac{M_1}{3} \right), \qquad
    s = c_j \, L \left( \frac{M_0}{3} + \frac{M_L}{6} + \frac{M_1}{4} \right) \times e $$

    with $e$ the direction of the link. A moment in the plane of the link turns the next joint's frame as compliance of
    that joint does; only the shift tells them apart. Expect {doc}`joint_compliance`, `link_bending` and
    {doc}`base_compliance` to be confounded, and tell them apart with a payload.
    """
    position = 2
    under_load = True
    linear = True

    @cached_property
    def parameters(self) -> Parameters:
        """The link's only parameter, its compliance L / EI."""
        doc = "L / EI: turn of the link's end by a unit moment"
        return (Parameter("c_rad_per_nm", "rad/Nm", _LINK, doc, positive=True),)

    def apply(self, state: RobotState, *, c_rad_per_nm: float) -> RobotState:
        """Robot state with the link's end shifted and turned (alpha and beta of the link, theta of the next row)."""
        turn, shift_mm = state.loaded.gravity.bendings[self.joint]
        return turned_end(state, self.joint, c_rad_per_nm * turn).displace(c_rad_per_nm * shift_mm)

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each joint's link; unknown masses become part of the parameters."""
        robot, n_joints = dataset.robot, dataset.robot.n_joints
        if has_masses(robot):
            return Family(cls.name, tuple(map(cls, range(n_joints))))
        varies = _payload_varies(dataset)
        members = tuple(LinkBendingUnknownMasses(j, n_joints + 1 - j, varies) for j in range(n_joints))
        return _family_of_unknown_masses(cls.name, members)


@dataclass(frozen=True)
class LinkBendingUnknownMasses(LinkBending):
    """Bending of a link under unknown masses: the sum over later frames of (c m) times the bending by 1 kg."""

    places: int  # frames from the link's end on, the tool point included
    payload: bool  # whether it varies over the training poses
    equation = "end of link j turns by sum (c_j m_k) moment of 1 kg at frame k"
    symbols = (("c_j m_k", "rad kg/Nm"),)
    needs = "many poses"

    @cached_property
    def parameters(self) -> Parameters:
        """L / EI times mass for each frame from the link's end on, and L / EI where the payload varies."""
        masses = _products("cm_at", range(self.joint + 1, self.joint + 1 + self.places), _LINK)
        known = Parameter("c_rad_per_nm", "rad/Nm", _LINK, "L / EI: turn of its end by a unit moment", positive=True)
        return (*masses, known) if self.payload else masses

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """Robot state with the link's end shifted and turned (alpha and beta of the link, theta of the next row)."""
        link, gravity = self.joint, state.loaded.gravity
        weights = np.array(list(values.values()))
        turns, shifts_mm = gravity.unit_bendings[link]  # (N, K, 3)
        in_link = np.einsum("nki,k->ni", turns, weights[: self.places])
        shift_mm = np.einsum("nki,k->ni", shifts_mm, weights[: self.places])
        if self.payload:
            turn, shift = gravity.payload_bending(link)
            in_link, shift_mm = in_link + weights[-1] * turn, shift_mm + weights[-1] * shift
        return turned_end(state, link, in_link).displace(shift_mm)


@dataclass(frozen=True)
class BaseCompliance(CatalogueEffect):
    """A pedestal that tilts under the moment M of the whole arm's weight: the base turns by diag(cx, cy, 0) M(q)."""

    name = "base_compliance"
    noun = "the compliance of the base"
    equation = "base turns by C M(q)"
    symbols = (("cx", "rad/Nm"), ("cy", "rad/Nm"))
    needs = "masses in robot.toml, or many poses"
    confirm = "a dial gauge at the foot while the arm swings round stretched out: it sees the base alone"
    bounds = (
        NaturalBound(1e-4, "rad/Nm", "a light table gives way by 1e-4 rad/Nm, a bolted base far less"),
        NaturalBound(1e-2, "rad kg/Nm", "that is 100 kg on a light table (10 kNm/rad)"),
    )
    notes = r"""
    $$ \phi = \begin{pmatrix} c_x & 0 & 0 \\ 0 & c_y & 0 \\ 0 & 0 & 0 \end{pmatrix} M(q), \qquad
    M = \sum_k c_k \times m_k g $$

    The whole arm turns about the origin of its base by $\phi$, under the overturning moment $M$ of its weight.
    """
    position = 10
    under_load = True
    linear = True

    @cached_property
    def parameters(self) -> Parameters:
        """Compliances of the base about its x and y axes."""
        return tuple(_tilt(axis) for axis in "xy")

    def apply(self, state: RobotState, *, cx_rad_per_nm: float, cy_rad_per_nm: float) -> RobotState:
        """Robot state with the base turned."""
        moment = state.loaded.gravity.moment_about(np.zeros((len(state.poses), 3)), 0)
        return state.turn_base(moment * np.array([cx_rad_per_nm, cy_rad_per_nm, 0.0]))

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member, for the whole arm; unknown masses become part of the parameters."""
        if has_masses(dataset.robot):
            return Family(cls.name, (cls(),))
        member = BaseComplianceUnknownMasses(dataset.robot.n_joints + 1, _payload_varies(dataset))
        return _family_of_unknown_masses(cls.name, (member,))


@dataclass(frozen=True)
class BaseComplianceUnknownMasses(BaseCompliance):
    """Compliance of a pedestal under unknown masses: a tilt by the sum over frames of (c m) x the moment of 1 kg."""

    places: int  # frames beyond the base, the tool point included
    payload: bool  # whether it varies over the training poses
    equation = "base turns by sum (C m_k) moment of 1 kg at frame k"
    symbols = (("cx m_k", "rad kg/Nm"), ("cy m_k", "rad kg/Nm"))
    needs = "many poses"

    @cached_property
    def parameters(self) -> Parameters:
        """Compliance times mass for each frame, about x and then y; plain compliance where the payload varies."""
        parameters: list[Parameter] = []
        for axis in "xy":
            parameters += _products(f"c{axis}m_at", range(1, 1 + self.places), _BASE, axis)
            if self.payload:
                parameters.append(_tilt(axis))
        return tuple(parameters)

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """Robot state with the base turned."""
        gravity = state.loaded.gravity
        moments = gravity.unit_moments  # (N, K, 3)
        if self.payload:
            moments = np.concatenate([moments, gravity.payload_moment_about(np.zeros(3))[:, None]], axis=1)
        about_x, about_y = np.array(list(values.values())).reshape(2, -1)
        turn = np.zeros((len(moments), 3))
        turn[:, 0], turn[:, 1] = moments[..., 0] @ about_x, moments[..., 1] @ about_y
        return state.turn_base(turn)


@dataclass(frozen=True)
class GravityBacklash(JointLaw):
    """Backlash of a joint that gravity presses to one side of its play: theta += b / 2 sign(tau)."""

    name = "gravity_backlash"
    noun = "the backlash under gravity of joint"
    equation = "theta_j += b_j / 2 sign(tau_j)"
    symbols = (("b_j", "rad"),)
    needs = "masses in robot.toml or torque<j>_nm in poses.csv"
    confirm = "poses on both sides of the angle where gravity's torque changes sign"
    bounds = (NaturalBound(9e-3, "rad", PLAY),)
    notes = r"""
    $$ \delta \theta_j = \frac{b_j}{2} \, \mathrm{sign}( \tau_j ) $$

    Gravity presses the joint to one side of its play, so no side of approach has to be written down. Near $\tau_j = 0$
    it jumps, where compliance goes straight through.
    """
    position = 8
    under_load = True
    parameters = (Parameter("b_rad", "rad", 5e-4, "width of the play", positive=True),)

    def shapes(self, state: RobotState) -> Array:
        return 0.5 * np.sign(state.loaded.gravity.joint_torques[:, [self.joint]])

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each joint of known load."""
        return where_load_is_known(super().family(dataset), dataset.robot)


@dataclass(frozen=True)
class NonlinearStiffness(JointLaw):
    """A joint's spring that stiffens, or softens, with load: theta += c2 tau |tau|."""

    name = "nonlinear_stiffness"
    noun = "the nonlinear stiffness of joint"
    equation = "theta_j += c2_j tau_j abs(tau_j)"
    symbols = (("c2_j", "rad/Nm^2"),)
    needs = "masses in robot.toml or torque<j>_nm in poses.csv; payload_kg where it varies"
    helpful_conditions = ("payload_kg",)
    confirm = "the same poses under three payloads: the way from the first to the second is not that to the third"
    bounds = (NaturalBound(1e-4, "rad/Nm^2", "the smallest gears lose a tenth of their stiffness for each Nm"),)
    notes = r"""
    $$ \delta \theta_j = c_{2,j} \; \tau_j \, | \tau_j | $$

    Beside {doc}`joint_compliance`, of which it is the next term: positive for a spring that softens, negative for one
    that stiffens, as strain wave gears do. A drive that gives way to small torques and is stiff beyond a knee is
    $w_j \tanh ( \tau_j / T )$, with $T$ a tenth and three tenths of the joint's largest torque; with a far smaller $T$
    it is {doc}`gravity_backlash`.
    """
    position = 27
    under_load = True
    members_of = "revolute joints"

    @cached_property
    def parameters(self) -> Parameters:
        """Compliance that grows with the torque."""
        return (Parameter("c2_rad_per_nm2", "rad/Nm^2", 5e-7, "compliance that grows with the torque"),)

    def shapes(self, state: RobotState) -> Array:
        torque_nm = state.loaded.gravity.joint_torques[:, [self.joint]]
        return torque_nm * np.abs(torque_nm)

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Turn at the largest torque of all poses, as text."""
        torque_nm = float(np.abs(state.gravity_torques_nm[:, self.joint]).max(initial=0.0))
        turn_deg = np.degrees(value) * torque_nm**2
        return f"{turn_deg:+.2g}\N{DEGREE SIGN} at {torque_nm:.3g} Nm"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each revolute joint, and its wind-ups where it is under load."""
        robot = dataset.robot
        family = where_load_is_known(super().family(dataset), robot)
        if family.why_not:
            return family
        turning = [j for j in robot.revolute_joints if j in loaded_joints(robot)]
        torques_nm = RobotState.nominal(robot, dataset.poses).gravity_torques_nm
        largest_nm = np.abs(torques_nm[~dataset.poses.is_test]).max(axis=0, initial=0.0)
        loaded = [j for j in turning if largest_nm[j] > _UNLOADED_NM]
        wind_ups = [WindUp(j, float(f"{share * largest_nm[j]:.2g}")) for j in loaded for share in _KNEES]
        limits = (JointCompliance.name, GravityBacklash.name)  # of a far larger and a far smaller knee
        return replace(family, members=(*family.members, *wind_ups), contains=limits)


@dataclass(frozen=True)
class WindUp(NonlinearStiffness):
    """A joint's soft wind-up: a drive that gives way to small torques and is stiff beyond, theta += w tanh(tau / T)."""

    knee_nm: float  # T
    equation = "theta_j += w_j tanh(tau_j / T)"
    symbols = (("w_j", "rad"),)
    bounds = (NaturalBound(5e-3, "rad", "drives give way by a few minutes of arc before they are stiff"),)

    @cached_property
    def parameters(self) -> Parameters:
        """Turn to either side, with the torque at which it is used up in the parameter's name."""
        knee = f"{self.knee_nm:g}".replace(".", "p")
        return (Parameter(f"windup_over_{knee}nm_rad", "rad", 3e-4, "turn under a large torque", positive=True),)

    def shapes(self, state: RobotState) -> Array:
        return np.tanh(state.loaded.gravity.joint_torques[:, [self.joint]] / self.knee_nm)

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Turn between a large torque to one side and to the other, as text."""
        turn_deg = 2.0 * np.degrees(value)
        return f"{turn_deg:+.2g}\N{DEGREE SIGN} between both sides, most of it within {self.knee_nm:.3g} Nm"


@dataclass(frozen=True)
class LinkTorsion(CatalogueEffect):
    """A link that twists about its own axis: its end turns by c times the moment about the axis of later weights."""

    joint: int  # the joint that moves the link
    name = "link_torsion"
    noun = "the torsion of the link behind joint"
    equation = "end of link j turns about the link by c_j (M . e)"
    symbols = (("c_j", "rad/Nm"),)
    needs = "masses in robot.toml"
    confirm = "a weight beside the link's axis, on one side and on the other: the link's end turns"
    bounds = (NaturalBound(1e-3, "rad/Nm", "half a metre of aluminium tube, 40 mm by 3 mm, twists by 2e-4 rad/Nm"),)
    notes = r"""
    $$ \phi = c_j \, ( M_j \cdot e_j ) \, e_j $$

    $e_j$ is the direction of the link, $M_j$ gravity's moment at its end. Links that lie along their joint's axis are
    left out: their torsion is that joint's compliance.
    """
    position = 28
    under_load = True
    linear = True
    parameters = (Parameter("c_rad_per_nm", "rad/Nm", 2e-5, "twist by a unit moment", positive=True),)

    def apply(self, state: RobotState, *, c_rad_per_nm: float) -> RobotState:
        """Robot state with the link's end turned: alpha and beta of the link, theta of the next row."""
        link, loaded = self.joint, state.loaded
        base_T_frame = loaded.chain.base_T_frame
        end = base_T_frame[:, link + 1]
        span_mm = end[:, :3, 3] - base_T_frame[:, link, :3, 3]
        length_mm = np.linalg.norm(span_mm, axis=1, keepdims=True)
        along = np.where(length_mm >= 1.0, span_mm / np.maximum(length_mm, 1.0), 0.0)
        moment = loaded.gravity.moment_about(end[:, :3, 3], link + 1)
        turn = np.sum(moment * along, axis=1, keepdims=True) * along
        in_link = c_rad_per_nm * np.einsum("nji,nj->ni", end[:, :3, :3], turn)
        return turned_end(state, link, in_link)

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each link off its joint's axis; others act as joint compliance."""
        rows = dataset.robot.table[:-1]
        out = np.abs(rows[:, 0]) > np.maximum(_SHORT_MM, 0.1 * np.abs(rows[:, 2]))
        members = tuple(cls(int(j)) for j in np.flatnonzero(out))
        if not members:
            along = "every link lies along its joint's axis, so that its torsion is the joint's compliance"
            return cls.untestable(along, "nothing: joint_compliance is tested", covered=True)
        return where_masses_are_known(Family(cls.name, members), dataset.robot)


@dataclass(frozen=True)
class BearingClearance(CatalogueEffect):
    """A bearing with clearance: the joint's axis leans by a fixed angle to the side that the moment pushes it to."""

    joint: int
    name = "bearing_clearance"
    noun = "the clearance in the bearing of joint"
    equation = "axis j leans by c_j toward the side that the moment across it pushes to"
    symbols = (("c_j", "rad"),)
    needs = "masses in robot.toml"
    confirm = "push the link by hand across its axis: it falls over from one side to the other"
    bounds = (NaturalBound(3e-3, "rad", "bearings of joints have less than 1e-3 rad of clearance"),)
    notes = r"""
    $$ \phi = c_j \, \frac{ M_\perp }{ \sqrt{ | M_\perp |^2 + M_0^2 } }, \qquad M_0 = 0.01 \text{ Nm} $$

    $M_\perp$ is gravity's moment across the joint's axis: the axis leans by the same angle to whatever side it is
    pushed to.
    """
    position = 29
    under_load = True
    members_of = "revolute joints"
    linear = True
    parameters = (Parameter("c_rad", "rad", 3e-4, "lean to either side", positive=True),)

    def apply(self, state: RobotState, *, c_rad: float) -> RobotState:
        """Robot state with the tilt added to the frame that carries the joint."""
        frame = state.loaded.chain.base_T_frame[:, self.joint]
        moment = state.loaded.gravity.moment_about(frame[:, :3, 3], self.joint)
        x, y, _ = np.einsum("nji,nj->ni", frame[:, :3, :3], moment).T
        size = np.sqrt(x**2 + y**2 + _STILL_NM**2)
        return tilted_axis(state, self.joint, c_rad * x / size, c_rad * y / size)

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each revolute joint, where the masses are known."""
        return where_masses_are_known(super().family(dataset), dataset.robot)


@dataclass(frozen=True)
class ToolSag(CatalogueEffect):
    """A tool that sags: it moves by R diag(c) R^T g, R = base_R_flange and g the unit vector along gravity."""

    name = "tool_sag"
    of = "target"
    noun = "the sag of the tool"
    equation = "target moves by R diag(c) R^T g"
    symbols = (("c", "mm"),)
    needs = "tool attitudes that vary"
    confirm = "one place reached with the tool in different attitudes"
    bounds = (NaturalBound(10.0, "mm", "a tool that is screwed on does not hang by so much"),)
    notes = r"""
    $$ \delta p = R \; \mathrm{diag}(c) \; R^T g $$

    $R$ is the flange's attitude, $g$ the unit vector along gravity: along each axis of the tool the target sags in
    proportion to gravity along that axis.
    """
    position = 14
    members_of = "cell"
    linear = True
    parameters = tuple(Parameter(f"{a}_mm", "mm", 0.1, f"sag with gravity along the tool's {a}") for a in "xyz")

    def apply(self, state: RobotState, *, x_mm: float, y_mm: float, z_mm: float) -> RobotState:
        """Robot state with the target displaced."""
        rotation = state.loaded.chain.base_T_flange[:, :3, :3]
        gravity_vector = np.array(state.robot.gravity_m_s2)
        down = gravity_vector / max(float(np.linalg.norm(gravity_vector)), 1e-12)
        in_tool = np.einsum("nji,j->ni", rotation, down) * np.array([x_mm, y_mm, z_mm])
        return state.displace(np.einsum("nij,nj->ni", rotation, in_tool))
