"""Drives and bearings: the angle, or the axis, of a joint is not as commanded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.effects.catalogue.loads import PLAY
from calib.effects.catalogue.order_steps import is_measured_for_training
from calib.effects.effect import CatalogueEffect, Effect, Family, NaturalBound, Parameter, Parameters
from calib.effects.shaped import JointLaw, tilted_axis
from calib.effects.state import RobotState

DENT_WIDTHS_DEG = (4, 7, 12, 20)  # standard deviations of a dent's shape
FEWEST_INSIDE = 3  # training poses within 1.2 of them: with fewer a dent is only an outlier
DEAD_CENTRE_STEP_DEG = 5
BALANCER_RATIOS_PCT = (20, 30, 40, 55, 70)  # of the distances of a balancing spring's ends from the joint's axis
_COUNTED = "gear ratios are whole numbers of teeth, and encoders count them to 1e-3 and better"


def harmonic(order: float, scale: float) -> Parameters:
    """Parameters of one harmonic of a joint: sin3_rad and cos3_rad for the third."""
    suffix = f"{order:g}_rad".replace(".", "_")
    return tuple(Parameter(part + suffix, "rad", scale, f"{part}({order:g} q) amplitude") for part in ("sin", "cos"))


def _waves(angle_rad: Array) -> Array:
    """Sine and cosine (N, 2) of angles (N,)."""
    return np.column_stack([np.sin(angle_rad), np.cos(angle_rad)])


@dataclass(frozen=True)
class TransmissionError(JointLaw):
    """An error with n periods per turn: theta += A sin(n q) + B cos(n q), n = 1, 2 or 3.

    n = 1 is eccentricity of an encoder or gear. Over a small range of the joint the cosine of n = 1 is nearly a joint
    offset, its sine nearly a wrong gear ratio.
    """

    order: float
    name = "transmission_error"
    noun = "the transmission error of joint"
    equation = "theta_j += A sin(n q_j) + B cos(n q_j), n = 1, 2, 3"
    symbols = (("sin_n", "rad"), ("cos_n", "rad"))
    needs = "joint angles over a good part of a turn"
    confirm = "one joint alone over a whole turn in small steps"
    bounds = (NaturalBound(3.5e-3, "rad", "robot gears are made to 3e-4 rad (one arc minute), simple ones to 3e-3"),)
    notes = r"""
    $$ \delta \theta_j = A \sin(n q_j) + B \cos(n q_j), \qquad n = 1, 2, 3 $$

    An encoder or a ring that sits eccentric errs once a turn, an oval one twice. Over a narrow range of the joint the
    cosine of $n = 1$ is nearly a joint offset, and the sine nearly a wrong ratio ({doc}`joint_scale`). On joint 2 of an
    arm that stands, once a turn, a balancing spring does nearly the same ({doc}`counterbalance`): both are left open.
    """
    position = 3
    members_of = "revolute joints"
    orders: ClassVar[Sequence[int]] = (1, 2, 3)
    usual_rad: ClassVar[float] = 3e-4  # amplitude

    @cached_property
    def parameters(self) -> Parameters:
        """Amplitudes of the error's sine and cosine."""
        return harmonic(self.order, self.usual_rad)

    def shapes(self, state: RobotState) -> Array:
        return _waves(self.order * state.q_rad[:, self.joint])


@dataclass(frozen=True)
class StrainWave(TransmissionError):
    """Ripple of a strain wave gear: a `TransmissionError` with n = gear ratio, or twice that."""

    name = "strain_wave"
    title = "strain wave gear ripple"
    noun = "the strain wave gear's error of joint"
    equation = "theta_j += A sin(n q_j) + B cos(n q_j), n = gear ratio and 2 x gear ratio"
    needs = "gear_ratio in robot.toml"
    confirm = "one joint alone in steps of a tenth of a motor turn"
    bounds = (NaturalBound(1e-3, "rad", "strain wave gears are made to 4e-4 rad (makers' tables: 1.5 arc minutes)"),)
    notes = r"""
    $$ \delta \theta_j = A \sin(n q_j) + B \cos(n q_j), \qquad n = G, \, 2 G, \quad G \text{ the gear ratio} $$

    Without its column it looks like white noise: the poses do not sample so fast a wave. Over the angle within a motor
    turn it is a plain sine.
    """
    position = 4

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect, one member for each of two harmonics of each revolute joint of known gear ratio."""
        members = tuple(
            cls(j, factor * joint.gear_ratio)
            for j, joint in enumerate(dataset.robot.joints)
            if joint.gear_ratio is not None and joint.is_revolute
            for factor in (1.0, 2.0)
        )
        if members:
            return Family(cls.name, members)
        return cls.untestable("robot.toml has no gear_ratio", "add gear_ratio to each [[joints]]")


@dataclass(frozen=True)
class HighHarmonic(TransmissionError):
    """Error of gear teeth, or of encoder lines: theta += A sin(n q) + B cos(n q), n = 4 to 20."""

    name = "high_harmonic"
    title = "high harmonic of a joint"
    noun = "a high harmonic in the gear of joint"
    equation = "theta_j += A sin(n q_j) + B cos(n q_j), n = 4 ... 20"
    confirm = "one joint alone over 90 degrees in steps of a degree"
    bounds = (NaturalBound(1e-3, "rad", "encoders interpolate to 1e-3 rad and better"),)
    notes = r"""
    $$ \delta \theta_j = A \sin(n q_j) + B \cos(n q_j), \qquad n = 4 \dots 20 $$

    Teeth, bearing balls, or the lines of an encoder. On real arms several joints have many of them at once; then the
    learned curves say more ({doc}`/method/curves`).
    """
    position = 25
    orders = range(4, 21)
    is_sparse = True
    usual_rad = 1e-4


@dataclass(frozen=True)
class JointScale(JointLaw):
    """A wrong gear ratio or encoder scale: theta += k q."""

    name = "joint_scale"
    grows_with_angle = True
    noun = "a scale error of joint"
    equation = "theta_j += k_j q_j"
    symbols = (("k_j", "1"),)
    needs = "joint angles over a good range"
    confirm = "one joint alone from end to end of its range: a scale error grows with the angle, harmonics come back"
    bounds = (NaturalBound(5e-3, "1", _COUNTED),)
    notes = r"""
    $$ \delta \theta_j = k_j \, q_j $$

    The error grows with the angle, where a harmonic comes back. With a narrow range both are the same.
    """
    position = 5
    parameters = (Parameter("k", "1", 1e-4, "share of the commanded motion"),)

    def shapes(self, state: RobotState) -> Array:
        return state.q_rad[:, [self.joint]]

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Error over the joint's travel in all poses, as text."""
        travel = float(np.ptp(state.q_rad[:, self.joint]))
        if state.robot.joints[self.joint].is_revolute:
            turned = np.degrees(travel)
            return f"{turned * value:.2g}\N{DEGREE SIGN} over the {turned:.0f}\N{DEGREE SIGN} of its travel"
        return f"{travel * value:.2g} mm over the {travel:.0f} mm of its travel"


@dataclass(frozen=True)
class AsymmetricScale(JointLaw):
    """Scale error of an encoder or drive that has one sign on both sides of the joint's zero: theta += k |q|."""

    name = "asymmetric_scale"
    grows_with_angle = True
    noun = "a scale error that differs on both sides of zero of joint"
    equation = "theta_j += k_j abs(q_j)"
    symbols = (("k_j", "1"),)
    needs = "joint angles on both sides of zero"
    confirm = "one joint alone from end to end of its range: the error turns round at zero"
    bounds = (NaturalBound(5e-3, "1", _COUNTED),)
    notes = r"""
    $$ \delta \theta_j = k_j \, | q_j | $$

    With $q_j$ on one side of zero only it is {doc}`joint_scale`.
    """
    position = 24
    parameters = (Parameter("k", "1", 1e-4, "share of the commanded motion"),)

    def shapes(self, state: RobotState) -> Array:
        return np.abs(state.q_rad[:, [self.joint]])


@dataclass(frozen=True)
class JointCoupling(JointLaw):
    """A joint that turns along with another joint, as in wrists with bevel gears: theta_j += k q_i."""

    driver: int
    name = "joint_coupling"
    noun = "a coupling to its neighbour of joint"
    equation = "theta_j += k q_i, neighbours of the wrist"
    symbols = (("k", "1"),)
    needs = "three joints or more"
    confirm = "the driving joint alone with the driven one held still"
    bounds = (NaturalBound(5e-2, "1", "wrists couple by one over a gear ratio of 20 and more"),)
    notes = r"""
    $$ \delta \theta_j = k \, q_i $$

    In wrists with bevel gears a shaft runs through the joint before. Controllers know the coupling; what is left is an
    error of its ratio.
    """
    position = 6

    @cached_property
    def parameters(self) -> Parameters:
        """Coupling factor k, named after the driving joint, as a joint may have two drivers."""
        return (Parameter(f"k_of_J{self.driver + 1}", "1", 1e-4, "share of the neighbour's motion"),)

    def shapes(self, state: RobotState) -> Array:
        return state.q_rad[:, [self.driver]]

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Error per degree of the driving joint, as text."""
        return f"{value:.2g}\N{DEGREE SIGN} for each degree of the driving joint"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect: the last two joints each with the joint before, and the last with the third last."""
        n = dataset.robot.n_joints
        pairs = [(j, j - 1) for j in range(max(n - 2, 1), n)] + ([(n - 1, n - 3)] if n >= 3 else [])
        if n < 2:
            return cls.untestable("the arm has one joint", "nothing: there is no neighbour")
        return Family(cls.name, tuple(cls(joint, driver) for joint, driver in pairs))


@dataclass(frozen=True)
class CableDrag(JointLaw):
    """A cable over two neighbouring joints that pulls one of them: harmonics of the angles' sum or difference."""

    other: int
    sign: int  # 1 for the sum, -1 for the difference
    order: int
    name = "cable_drag"
    title = "cable drag"
    noun = "the drag of the cables at joint"
    equation = "theta_j += A sin(n u) + B cos(n u), u = q_j +- q_(j+1) or q_j +- q_(j-1), n = 1, 2"
    symbols = (("sin_n", "rad"), ("cos_n", "rad"))
    needs = "two neighbouring joints over a good part of a turn, each for itself"
    confirm = "the same poses with the cable or hose taken off"
    bounds = (NaturalBound(3.5e-3, "rad", "a drive gives way to a cable by 0.2 deg at the most"),)
    notes = r"""
    $$ \delta \theta_j = A \sin(n u) + B \cos(n u), \qquad
    u = q_j \pm q_{j+1} \text{ or } q_j \pm q_{j-1}, \quad n = 1, 2 $$

    A cable or hose over two neighbouring joints pulls at one of them, as both angles together have it.
    """
    position = 26

    @cached_property
    def parameters(self) -> Parameters:
        """Amplitudes of the error's sine and cosine, with the neighbouring joint in their names."""
        way = "with" if self.sign > 0 else "against"
        return tuple(
            Parameter(f"{part}{self.order}_{way}_J{self.other + 1}_rad", "rad", 3e-4, f"{part} amplitude")
            for part in ("sin", "cos")
        )

    def shapes(self, state: RobotState) -> Array:
        return _waves(self.order * (state.q_rad[:, self.joint] + self.sign * state.q_rad[:, self.other]))

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect: each joint of each pair of revolute neighbours, two harmonics of sum or difference."""
        turning = dataset.robot.revolute_joints
        pairs = [(j, k) for j in turning for k in turning if abs(j - k) == 1]
        if not pairs:
            return cls.untestable("no two neighbouring joints turn", "nothing: no cable runs so")
        members = [cls(j, k, sign, order) for j, k in pairs for sign in (1, -1) for order in (1, 2)]
        return Family(cls.name, tuple(members), sparse=True)


@dataclass(frozen=True)
class Counterbalance(JointLaw):
    """A spring or gas cylinder that balances gravity at joint 2, and that the controller does not know well enough.

    It acts between a point behind the joint and one on the link: with the distances R and rho R of both from the axis,
    its length is R l, l^2 = 1 + rho^2 - 2 rho cos u, its lever R rho sin u / l. A force F + K l gives the torque's law.
    """

    dead_centre_deg: int  # q at which the spring's line passes through the axis and the spring is at its shortest
    ratio_pct: int  # rho
    name = "counterbalance"
    title = "balancing spring"
    noun = "the balancing spring of joint"
    equation = "theta_j += (K + F / l(u)) sin u, u = q_j - q_0, l^2 = 1 + rho^2 - 2 rho cos u"
    symbols = (("K", "rad"), ("F", "rad"))
    needs = "a joint 2 that turns across joint 1, over a good part of its range"
    confirm = (
        "the spring's pressure or preload by its gauge; the same poses after it was set as the maker's manual says"
    )
    bounds = (NaturalBound(5e-3, "rad", "a spring that balances 3 kNm turns a drive of 600 kNm/rad by so much"),)
    notes = r"""
    $$ \delta \theta_2 = \left( K + \frac{F}{\ell} \right) \sin u, \qquad u = q_2 - q_0, \quad
    \ell^2 = 1 + \rho^2 - 2 \rho \cos u $$

    Heavy arms carry a coil spring ($K$) or a gas cylinder ($F$) at joint 2; its torque turns the drive as a weight
    does, and the controller reckons with its nominal force. All of it is a function of one angle, so that
    {doc}`transmission_error` of joint 2 with $n = 1, 2$ follows it nearly exactly: expect both to stay open, and look
    at the spring before a gear is opened.
    """
    position = 32

    @cached_property
    def parameters(self) -> Parameters:
        """Turns by the parts of the force that grow with the spring's length, and that do not."""
        place = f"{self.dead_centre_deg}deg_{self.ratio_pct}pct"
        return (
            Parameter(f"spring_from_{place}_rad", "rad", 3e-4, "turn by the spring's rate"),
            Parameter(f"force_from_{place}_rad", "rad", 3e-4, "turn by its constant force"),
        )

    def shapes(self, state: RobotState) -> Array:
        u, rho = state.q_rad[:, self.joint] - np.radians(self.dead_centre_deg), 0.01 * self.ratio_pct
        length = np.sqrt(1.0 + rho**2 - 2.0 * rho * np.cos(u))
        return np.column_stack([np.sin(u), np.sin(u) / length])

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect for joint 2, with a member for each of 72 dead centres and five ratios."""
        robot = dataset.robot
        if robot.n_joints < 2 or not all(joint.is_revolute for joint in robot.joints[:2]):
            return cls.untestable("joints 1 and 2 do not both turn", "nothing: such an arm has no such spring")
        if abs(np.cos(robot.table[0, 1])) > 0.5:
            return cls.untestable("joint 2 does not turn across joint 1", "nothing: no weight has to be balanced there")
        members = tuple(cls(1, deg, pct) for deg in range(0, 360, DEAD_CENTRE_STEP_DEG) for pct in BALANCER_RATIOS_PCT)
        return Family(cls.name, members, sparse=True, most_members=1, finer=_around)


def _around(member: Effect) -> tuple[Counterbalance, ...]:
    """Springs with dead centres and ratios between one of the family's grid and those next to it."""
    assert isinstance(member, Counterbalance)
    degrees = range(member.dead_centre_deg - DEAD_CENTRE_STEP_DEG + 1, member.dead_centre_deg + DEAD_CENTRE_STEP_DEG)
    ratios = sorted(BALANCER_RATIOS_PCT)
    at = ratios.index(member.ratio_pct)
    below, above = ratios[max(at - 1, 0)], ratios[min(at + 1, len(ratios) - 1)]
    between = {(below + member.ratio_pct) // 2, member.ratio_pct, (member.ratio_pct + above) // 2}
    springs = [Counterbalance(member.joint, deg % 360, pct) for deg in degrees for pct in sorted(between)]
    return tuple(spring for spring in springs if spring != member)


@dataclass(frozen=True)
class Backlash(JointLaw):
    """Backlash, with the sign of the side that the joint came from: theta += b / 2 sign(approach)."""

    name = "backlash"
    noun = "the backlash of joint"
    equation = "theta_j += b_j / 2 sign(approach_j)"
    symbols = (("b_j", "rad"),)
    needs = "approach1 ... in poses.csv, from both sides"
    needed_conditions = ("approach",)
    confirm = "each pose twice, coming from the one side and from the other"
    bounds = (NaturalBound(9e-3, "rad", PLAY),)
    notes = r"""
    $$ \delta \theta_j = \frac{b_j}{2} \, \mathrm{sign}( \text{approach}_j ) $$

    Always approached from one side it is a joint offset, and untestable.
    """
    position = 7
    parameters = (Parameter("b_rad", "rad", 5e-4, "width of the play"),)

    def shapes(self, state: RobotState) -> Array:
        if state.poses.approach is None:
            return np.zeros((len(state.poses), 1))
        return 0.5 * np.sign(state.poses.approach[:, [self.joint]])

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each joint that training poses approach from both sides."""
        poses = dataset.poses
        if poses.approach is None:
            return cls.untestable(
                "poses.csv has no approach columns",
                "move to each pose from both sides and write approach1 ... (-1 or 1)",
            )
        sides = [np.unique(poses.approach[~poses.is_test, j]) for j in range(dataset.robot.n_joints)]
        both = [j for j, of_joint in enumerate(sides) if len(of_joint) > 1]
        if not both:
            return cls.untestable(
                "every joint always came from the same side: backlash is then a joint offset",
                "come to some poses from the other side",
            )
        return Family(cls.name, tuple(cls(j) for j in both))


@dataclass(frozen=True)
class FollowingError(JointLaw):
    """A joint that is measured before it has settled: a share of the motion from the previous pose is still missing.

    Poses after all measured ones, such as the targets of a correction, are taken as settled.
    """

    name = "following_error"
    noun = "the following error of joint"
    changes_arm = True
    equation = "theta_j += k_j (q_j - q_j of the pose before)"
    symbols = (("k_j", "1"),)
    needs = "poses in the order they were measured: time_s, else the rows"
    confirm = "the same poses after a longer wait"
    bounds = (
        NaturalBound(5e-2, "1", "a drive at rest lags by less than a twentieth of its last move"),
        NaturalBound(0.15, "rad", "the same after half a turn"),
    )
    notes = r"""
    $$ \delta \theta_j = k_j \, ( q_j - q_j^{\text{before}} ) $$

    The point was taken before the joint stood still, or the controller stops within a window. Poses need the order in
    which they were measured. The way to the first one is in no table: what is missing there is fitted by itself.
    """
    position = 23
    parameters = (
        Parameter("k", "1", 1e-4, "share of the way from the pose before"),
        Parameter("at_first_rad", "rad", 1e-4, "what is missing at the first pose"),
    )

    def shapes(self, state: RobotState) -> Array:
        poses = state.poses
        is_first = poses.from_sequence((np.arange(len(poses.sequence)) == 0).astype(float))
        return np.column_stack([poses.motion[:, self.joint], is_first])


@dataclass(frozen=True)
class JointDent(JointLaw):
    """A damaged place in a gear: theta += h exp(-(q - place)^2 / 2 width^2), an error in a narrow range."""

    place_deg: int
    width_deg: int
    name = "joint_dent"
    title = "dent in a joint's gear"
    noun = "a dent in the gear of joint"
    equation = "theta_j += h in a narrow range of q_j"
    symbols = (("h", "rad"),)
    needs = "three poses or more within the range"
    confirm = "one joint alone in steps of a degree through the place, from both sides"
    bounds = (NaturalBound(9e-3, "rad", "a tooth that is gone shows by less than half a degree"),)
    notes = r"""
    $$ \delta \theta_j = h \exp \left( - \frac{ (q_j - q_0)^2 }{ 2 w^2 } \right), \qquad w = 4, 7, 12, 20° $$

    A damaged tooth or a dirty track of an encoder. Three poses or more have to lie within the range.
    """
    position = 18

    @cached_property
    def parameters(self) -> Parameters:
        """Height of the dent, with the dent's place and width in the parameter's name."""
        place = f"{'minus' if self.place_deg < 0 else ''}{abs(self.place_deg)}"
        return (Parameter(f"at_{place}deg_{self.width_deg}deg_wide_rad", "rad", 3e-4, "height of the dent"),)

    def shapes(self, state: RobotState) -> Array:
        off = state.q_rad[:, self.joint] - np.radians(self.place_deg)
        near = np.remainder(off + np.pi, 2.0 * np.pi) - np.pi  # over the nearer way round
        return np.exp(-0.5 * (near[:, None] / np.radians(self.width_deg)) ** 2)

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Angle, width and height of the dent, as text."""
        degree = "\N{DEGREE SIGN}"
        return (
            f"joint {self.joint + 1} is off by {np.degrees(value):+.2g}{degree} around {self.place_deg}{degree}, "
            f"{self.width_deg}{degree} wide (one sigma)"
        )

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each revolute joint, width and place that enough poses cover."""
        poses = dataset.poses
        q_deg = np.degrees(poses.q[is_measured_for_training(dataset)])
        members = []
        for joint in dataset.robot.revolute_joints:
            angle = q_deg[:, joint]
            for width_deg in DENT_WIDTHS_DEG:
                places = np.arange(np.floor(angle.min()), angle.max() + 1.0, width_deg // 2)
                off = np.remainder(angle[:, None] - places + 180.0, 360.0) - 180.0
                inside = np.count_nonzero(np.abs(off) < 1.2 * width_deg, axis=0)
                members += [cls(joint, int(p), width_deg) for p in places[inside >= FEWEST_INSIDE]]
        if members:
            return Family(cls.name, tuple(members), sparse=True)
        few = f"nowhere are {FEWEST_INSIDE} poses within a few degrees of a joint"
        return cls.untestable(few, "measure more poses")


@dataclass(frozen=True)
class AxisWobble(CatalogueEffect):
    """A joint's axis that tilts, about its own origin, by cosine and sine of n q as the joint turns, n = 1 or 2.

    The part of n = 1 that turns with the link is a constant link error and is left out. The rest tilts the axis in the
    link before, about that link's x and y: alpha and beta of the row before, or the base for the first joint.
    """

    joint: int
    order: int
    name = "axis_wobble"
    noun = "the wobble of the axis of joint"
    equation = "axis j tilts about its origin by sin, cos of n q_j, n = 1, 2"
    symbols = (("x_sin_n", "rad"), ("y_cos_n", "rad"))
    needs = "joint angles over a good part of a turn"
    confirm = "one joint alone over a whole turn, with points at two distances from its axis"
    bounds = (NaturalBound(2e-3, "rad", "bearings of joints run true to 1e-4 rad, bad ones to ten times that"),)
    notes = r"""
    $$ \delta \alpha_{j-1} = x_s \sin(n q_j) + x_c \cos(n q_j), \qquad
    \delta \beta_{j-1} = y_s \sin(n q_j) + y_c \cos(n q_j), \qquad
    n = 1, 2 $$

    The tilt is about the joint's own origin, so it stands in the row before (for the first joint, in the base). The
    part of $n = 1$ that turns with the link is plain geometry. Wobble of the last joint with $n = 2$ can be the same as
    {doc}`transmission_error` of it with $n = 1$: then both stay open.
    """
    position = 11
    members_of = "revolute joints"
    orders = (1, 2)
    linear = True

    @cached_property
    def parameters(self) -> Parameters:
        """Amplitudes (sine and cosine) of the axis' tilt about x and about y."""
        return tuple(
            Parameter(f"{axis}_{part}{self.order}_rad", "rad", 3e-4, f"tilt about {axis}, {part}({self.order} q)")
            for axis in ("x", "y")
            for part in ("sin", "cos")
        )

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """Robot state with the tilt added to the frame that carries the joint."""
        x_sin, x_cos, y_sin, y_cos = values.values()
        turned = self.order * state.q_rad[:, self.joint]
        about_x = x_sin * np.sin(turned) + x_cos * np.cos(turned)
        about_y = y_sin * np.sin(turned) + y_cos * np.cos(turned)
        return tilted_axis(state, self.joint, about_x, about_y)
