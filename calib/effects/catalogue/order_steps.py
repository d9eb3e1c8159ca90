"""Changes at one pose: a slip, a knock, a bolt that works loose, which persist from then on in the order of measuring.

Poses that come after all that were measured, such as the targets of a correction, are as after the last pose.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.array_types import Array, BoolArray, Vector
from calib.dataset.dataset import Dataset, Poses
from calib.effects.catalogue.loads import where_masses_are_known
from calib.effects.catalogue.scanner import field_of
from calib.effects.effect import Effect, Family, NaturalBound, Parameter, Parameters
from calib.effects.shaped import (
    BaseTilt,
    JointOffset,
    LinkBend,
    PayloadDeflection,
    ScannerMotion,
    ScannerScaling,
    ShapedEffect,
    TargetShift,
)
from calib.effects.state import RobotState

_SEEN = 3.0  # multiple of these bounds that is seen with bare eyes
AT_ENDS = 4
"""Fewest training poses before a step, and from it on."""
MOST_CHANGES = 3
"""Most steps of one family in a model: a part that moves more often drifts or is loose, and has not slipped."""
MOST_STEPS = 200
"""Most poses that are tried as the first after a step; of more poses they are taken evenly."""
MOST_LINK_STEPS = 100
"""The same for knocks that bend a link, which have six parameters for each link."""
_BENDS_MM = 100.0  # a shorter link is as stiff as a housing
_LOADED_NM = 0.05  # torque of 1 kg at the flange below which a joint does not show it: a lever of 5 mm


@dataclass(frozen=True)
class ChangePoint:
    """Place in the order of measuring where a change sets in, and the first training pose after it.

    Test poses between that pose and the training pose before it belong to neither side (`in_gap_of_steps`); a
    prediction takes them as after the change.
    """

    first: int
    pose: str

    @property
    def word(self) -> str:
        """The id of the change's first pose as a part of a parameter's name."""
        return re.sub(r"\W", "_", self.pose)

    def after(self, state: RobotState) -> Array:
        """Mask (N, 1) of the poses from the change on: 0 before the change, 1 from its first pose on."""
        return (state.poses.order >= self.first).astype(float)[:, None]


def in_gap_of_steps(effects: Iterable[Effect], poses: Poses) -> BoolArray:
    """Mask (N,) of test poses for which it is unknown whether they precede or follow a step among some effects.

    They come after the last training pose before a step, and before the first one after it: no fit can tell.
    """
    order = dict(zip(poses.ids, poses.order.tolist(), strict=True))
    gap = np.zeros(len(poses), dtype=bool)
    for effect in effects:
        start = getattr(effect, "start", None)
        if isinstance(start, ChangePoint) and start.pose in order:
            gap |= (poses.order >= start.first) & (poses.order < order[start.pose])
    return gap & poses.is_test


def is_measured_for_training(dataset: Dataset) -> BoolArray:
    """Mask (N,) of training poses with a measured point; of all training poses where no points are measured yet."""
    training = ~dataset.poses.is_test
    if dataset.points is None:
        return training
    return training & np.isin(np.arange(len(dataset.poses)), dataset.points.pose)


def change_points(dataset: Dataset, most: int = MOST_STEPS, *, at_setups: bool = True) -> list[ChangePoint]:
    """Change points before training poses, each with enough training poses on both sides to determine a step.

    At most `most`, evenly, and none near a change of setup, where the scanner's frame changes too. With `at_setups`
    those just at a change of setup as well: what was done overnight or while the scanner was moved.
    """
    poses = dataset.poses
    sequence = np.argsort(poses.order, kind="stable")
    sequence = sequence[is_measured_for_training(dataset)[sequence]]
    count = len(sequence) - 2 * AT_ENDS + 1
    if count < 1:
        return []
    at = AT_ENDS + np.unique(np.linspace(0, count - 1, min(most, count)).astype(int))
    setup = poses.setup[sequence]
    moved = 1 + np.flatnonzero(setup[1:] != setup[:-1])  # the first pose of each setup
    if at_setups:
        at = np.union1d(at, moved[(moved >= AT_ENDS) & (moved <= len(sequence) - AT_ENDS)])
    apart = np.abs(at[:, None] - moved)
    at = at[np.all((apart >= AT_ENDS) | (at_setups & (apart == 0)), axis=1)]
    firsts = np.array([_first_after(poses, sequence[k - 1], sequence[k]) for k in at], dtype=int)
    ids = [poses.ids[k] for k in sequence[at]]
    if len({re.sub(r"\W", "_", pose_id) for pose_id in ids}) < len(ids):  # two names would be one
        ids = [f"row{k + 1}" for k in sequence[at]]
    return [ChangePoint(first, pose_id) for first, pose_id in zip(firsts.tolist(), ids, strict=True)]


def _first_after(poses: Poses, last: int, first: int) -> int:
    """Place in the order of measuring from which poses count as after a change between two training poses.

    Where the setup changes between them, it is that of the first pose with the new setup.
    """
    if poses.setup[last] == poses.setup[first]:
        return int(poses.order[last]) + 1
    between = (poses.order > poses.order[last]) & (poses.order <= poses.order[first])
    return int(poses.order[between & (poses.setup == poses.setup[first])].min())


def _family(
    dataset: Dataset,
    name: str,
    members: Callable[[ChangePoint], list[ShapedEffect]],
    most: int = MOST_STEPS,
    *,
    at_setups: bool = True,
) -> Family:
    """Family of a step effect with members for each change point; marked as not testable with too few poses."""
    points = change_points(dataset, most, at_setups=at_setups)
    if not points:
        few = f"fewer than {2 * AT_ENDS} training poses show no step"
        return Family(name, (), few, "measure more poses")
    found = tuple(member for point in points for member in members(point))
    return Family(name, found, sparse=True, most_members=MOST_CHANGES)


class Step(ShapedEffect):
    """An effect that is absent before one pose and constant from it on."""

    start: ChangePoint

    def shapes(self, state: RobotState) -> Array:
        """Indicator (N, 1) of the poses after the step: 0 before, 1 from the first pose after it."""
        return self.start.after(state)

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """First pose after the step, as text."""
        return f"from pose {self.start.pose} on"


@dataclass(frozen=True)
class JointStep(Step):
    """A joint's zero that slips: theta has a constant error from one pose on."""

    joint: int
    start: ChangePoint
    unit: str = "rad"  # "mm" for a prismatic joint
    name = "joint_step"
    title = "step of a joint's zero"
    noun = "a step in the zero of joint"
    changes_arm = True
    equation = "theta_j += s from pose k on"
    symbols = (("s", "rad"),)
    needs = "poses in the order they were measured: time_s, else the rows"
    confirm = "a pose from before the step once more: it is off by the step now"
    bounds = (
        NaturalBound(5e-2, "rad", "a clutch or an encoder that slips by more is seen", _SEEN),
        NaturalBound(20.0, "mm", "a slide that slips by more is seen", _SEEN),
    )
    notes = r"""
    $$ \delta \theta_j = s \quad \text{from pose } k \text{ on}, \qquad 0 \text{ before} $$

    One member a joint and pose. A controller that lost counts, a clutch or a belt that slipped. A joint that creeps is
    no step: where a slow course says more, no step is named.
    """
    position = 17

    @property
    def displacement(self) -> JointOffset:
        return JointOffset(self.joint)

    @cached_property
    def parameters(self) -> Parameters:
        """Size of the step, with the pose in its name, as a joint may slip more than once."""
        scale = 3e-4 if self.unit == "rad" else 0.1
        return (Parameter(f"from_{self.start.word}_{self.unit}", self.unit, scale, "size of the step"),)

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Joint, size and first pose after the step, as text."""
        size = f"{value:+.2g} mm" if self.unit == "mm" else f"{np.degrees(value):+.2g}\N{DEGREE SIGN}"
        return f"joint {self.joint + 1} is off by {size} from pose {self.start.pose} on"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each joint and each pose that may be the first after a step."""
        units = ["rad" if joint.is_revolute else "mm" for joint in dataset.robot.joints]
        return _family(dataset, cls.name, lambda at: [cls(j, at, unit) for j, unit in enumerate(units)])


@dataclass(frozen=True)
class TargetStep(Step):
    """A target that shifts on the tool at one pose and stays there."""

    start: ChangePoint
    name = "target_step"
    of = "target"
    title = "step of a target"
    noun = "a shift of the target on the tool"
    changes_arm = True
    equation = "target shifted on the tool by s from pose k on"
    symbols = (("s", "mm"),)
    needs = "poses in the order they were measured: time_s, else the rows"
    confirm = "the target's mount by eye, and one pose from before the step once more in several wrist attitudes"
    bounds = (NaturalBound(20.0, "mm", "a target that moved by more has come off", _SEEN),)
    notes = r"""
    $$ \delta p = R \, s \quad \text{from pose } k \text{ on} $$

    $R$ is the flange's attitude. The jig or mirror was touched. If the wrist does not turn, a {doc}`scanner_step` is
    the same.
    """
    position = 19

    @property
    def displacement(self) -> TargetShift:
        return TargetShift()

    @cached_property
    def parameters(self) -> Parameters:
        """The shift along the flange's x, y and z axes."""
        return tuple(
            Parameter(f"{axis}_from_{self.start.word}_mm", "mm", 0.1, f"shift along the flange's {axis}")
            for axis in "xyz"
        )

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each pose that may be the first after a step."""
        return _family(dataset, cls.name, lambda at: [cls(at)])


@dataclass(frozen=True)
class ScannerStep(Step):
    """A scanner, or the foot of the arm, that is knocked at one pose and stays displaced."""

    start: ChangePoint
    centre_mm: Vector
    half_mm: float
    name = "scanner_step"
    of = "instrument"
    title = "step of the scanner"
    noun = "a move of the instrument"
    equation = "p += v + w x p from pose k on"
    symbols = (("v", "mm"), ("w", "rad"))
    needs = "poses in the order they were measured: time_s, else the rows"
    confirm = "fixed marks beside the arm, before and after"
    bounds = (
        NaturalBound(200.0, "mm", "a knock moves an instrument by less", _SEEN),
        NaturalBound(0.1, "rad", "a knock turns an instrument by less", _SEEN),
    )
    notes = r"""
    $$ \delta p = v + w \times ( p - p_0 ) \quad \text{from pose } k \text{ on} $$

    The tripod was knocked, or the foot of the arm: both move everything as one body. Where it is known, write a new
    `setup` into poses.csv.
    """
    position = 20

    @property
    def displacement(self) -> ScannerMotion:
        return ScannerMotion(self.centre_mm)

    @cached_property
    def parameters(self) -> Parameters:
        """Shift of the reported points, and turn about the field's middle; usual sizes move a point by 0.1 mm."""
        turn = 0.1 / self.half_mm
        return (
            *(Parameter(f"v{a}_from_{self.start.word}_mm", "mm", 0.1, f"shift along {a}") for a in "xyz"),
            *(Parameter(f"w{a}_from_{self.start.word}_rad", "rad", turn, f"turn about {a}") for a in "xyz"),
        )

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """First pose after the step, and a turn in degrees, as text."""
        turned = f"{np.degrees(value):+.2g}\N{DEGREE SIGN} " if parameter.unit == "rad" else ""
        return f"{turned}from pose {self.start.pose} on"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each pose that may be the first after a step."""
        centre_mm, half_mm = field_of(dataset)
        return _family(dataset, cls.name, lambda at: [cls(at, centre_mm, half_mm)], at_setups=False)


@dataclass(frozen=True)
class ScaleStep(Step):
    """An instrument whose scale changes at one pose: other air, a warm camera, a compensation that was switched."""

    start: ChangePoint
    name = "scale_step"
    of = "instrument"
    title = "step of the instrument's scale"
    noun = "a change of the instrument's scale"
    equation = "p times 1 + s from pose k on"
    symbols = (("s", "1"),)
    needs = "poses in the order they were measured: time_s, else the rows"
    confirm = "a certified length (a ball bar) on both days; the tracker's weather station"
    bounds = (NaturalBound(2e-3, "1", "a camera's scale moves by 1e-4 a kelvin, a tracker's by 1e-6", _SEEN),)
    notes = r"""
    $$ \delta p = s \, p \quad 	ext{from pose } k 	ext{ on}, \qquad p 	ext{ from the instrument's origin} $$

    What a laser tracker makes of 10 K or 40 hPa that its weather station does not know is 1e-5, ten micrometres a
    metre; a photogrammetric camera that warms up is off by ten times as much. A scale that never changes cannot be told
    from longer links ({doc}`scanner_scale`); one that changes can.
    """
    position = 35

    @property
    def displacement(self) -> ScannerScaling:
        return ScannerScaling()

    @cached_property
    def parameters(self) -> Parameters:
        """Relative change of the scale."""
        return (Parameter(f"from_{self.start.word}", "1", 1e-5, "relative change of all distances"),)

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Change in mm a metre and first pose after it, as text."""
        return f"{1e3 * value:+.2g} mm a metre from pose {self.start.pose} on"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each pose that may be the first after the change."""
        return _family(dataset, cls.name, lambda at: [cls(at)])


@dataclass(frozen=True)
class BaseLoosening(Step):
    """A bolt of the foot that works loose: the base gives way to the overturning moment from one pose on."""

    start: ChangePoint
    name = "base_loosening"
    noun = "a base that came loose"
    changes_arm = True
    equation = "base turns by C M(q) from pose k on"
    symbols = (("cx", "rad/Nm"), ("cy", "rad/Nm"))
    needs = "masses in robot.toml, and the order of the poses"
    confirm = "the bolts of the foot by hand; a dial gauge at the foot while the arm swings round stretched out"
    bounds = (NaturalBound(1e-3, "rad/Nm", "a base that gives way so far is seen to rock"),)
    notes = r"""
    $$ \phi = \mathrm{diag}( c_x, c_y, 0 ) \, M(q) \quad \text{from pose } k \text{ on} $$

    As {doc}`base_compliance`, which is there from the first pose on.
    """
    position = 21

    @property
    def displacement(self) -> BaseTilt:
        return BaseTilt()

    @cached_property
    def parameters(self) -> Parameters:
        """Compliances of the base about its x and y axes."""
        return tuple(
            Parameter(
                f"c{axis}_from_{self.start.word}_rad_per_nm",
                "rad/Nm",
                2e-6,
                f"tilt about {axis} by a unit moment",
                positive=True,
            )
            for axis in "xy"
        )

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each pose that may be the first after the bolt gave way."""
        family = _family(dataset, cls.name, lambda at: [cls(at)])
        return where_masses_are_known(family, dataset.robot)


@dataclass(frozen=True)
class PayloadStep(Step):
    """A payload that changes at one pose and that nobody wrote down: joints give way to its torque from then on.

    The mass and the joints' compliances show as their products alone, one for each joint. The products share a sign,
    that of a mass put on or taken off, which is not asked for.
    """

    joints: tuple[int, ...]  # that a mass at the flange turns
    start: ChangePoint
    name = "payload_step"
    of = "load"
    title = "change of the payload"
    noun = "a payload that changed unsaid"
    changes_arm = True
    equation = "theta_j += (c_j m) torque of 1 kg at the flange about joint j, from pose k on"
    symbols = (("c_j m", "rad kg/Nm"),)
    needs = "poses in the order they were measured: time_s, else the rows"
    confirm = "weigh what hangs at the flange, and write it into payload_kg at every pose"
    bounds = (NaturalBound(5e-2, "rad kg/Nm", "that is 50 kg on the smallest strain wave gear (1 kNm/rad)", _SEEN),)
    notes = r"""
    $$ \delta \theta_j = ( c_j \, m ) \; z_j \cdot ( p - o_j ) \times g \quad \text{from pose } k \text{ on} $$

    $p$ is where robot.toml has the payload (`payload_com_mm`), else the tool point; $m$ is below zero for a mass that
    was taken off. A change back is a second step. Masses in robot.toml are not needed. Compliance and mass cannot be
    told apart: divide by the compliance, of a data sheet or of {doc}`joint_compliance`, for the mass.

    A {doc}`joint_step` is the same at every pose, and a {doc}`base_loosening` tilts the whole arm, where a mass turns
    joint by joint as the arm reaches out.
    """
    position = 30

    @property
    def displacement(self) -> PayloadDeflection:
        return PayloadDeflection(self.joints)

    @cached_property
    def parameters(self) -> Parameters:
        """Compliance times the mass, for each joint that a mass at the flange turns."""
        doc = "compliance times the mass put on, of joint"
        return tuple(
            Parameter(f"J{joint + 1}_from_{self.start.word}_rad_kg_per_nm", "rad kg/Nm", 1e-4, f"{doc} {joint + 1}")
            for joint in self.joints
        )

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Largest turn of the joint over all poses, and the first pose with the changed payload, as text."""
        joint = self.joints[[p.name for p in self.parameters].index(parameter.name)]
        largest = float(np.abs(state.gravity.held_torque(joint)).max(initial=0.0))
        turned = f"joint {joint + 1} turns by up to {abs(np.degrees(value)) * largest:.2g}\N{DEGREE SIGN}"
        return f"{turned} from pose {self.start.pose} on"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each pose that may be the first with another payload."""
        robot = dataset.robot
        gravity = RobotState.nominal(robot, dataset.poses).gravity
        loaded = tuple(
            j
            for j, joint in enumerate(robot.joints)
            if joint.is_revolute and np.abs(gravity.held_torque(j)).max() > _LOADED_NM
        )
        if not loaded:
            return cls.untestable("a mass at the flange turns no joint", "nothing: no joint gives way to it")
        return _family(dataset, cls.name, lambda at: [cls(loaded, at)])


@dataclass(frozen=True)
class LinkStep(Step):
    """A link that is bent by a knock: the frame at its end shifts and turns at one pose and stays so."""

    joint: int  # that moves the link
    start: ChangePoint
    name = "link_step"
    title = "step of a link"
    noun = "a knock that bent the link behind joint"
    changes_arm = True
    equation = "end of link j shifts by v and turns by w (a, alpha, d, beta of its row) from pose k on"
    symbols = (("v", "mm"), ("w", "rad"))
    needs = "poses in the order they were measured: time_s, else the rows"
    confirm = "a pose from before the step once more, and the link by eye; fixed marks beside the arm have not moved"
    bounds = (
        NaturalBound(10.0, "mm", "a link that a knock bent by more is seen to be bent", _SEEN),
        NaturalBound(5e-2, "rad", "a link that a knock bent by more is seen to be bent", _SEEN),
    )
    notes = r"""
    $$ \delta x = v + w \times ( x - x_j ) \quad \text{from pose } k \text{ on} $$

    for all that lies beyond the link's end $x_j$. The arm ran into something: $a$, $\alpha$, $d$ and $\beta$ of the
    link's row change, and what of the bend turns about the joints at both its ends. A {doc}`joint_step` is a part of
    that, and is told where it says as much; behind the first joint it is nearly a {doc}`scanner_step`. Links shorter
    than 100 mm are left out, and those with fewer than two joints beyond, where it would be a {doc}`target_step`. With
    more than 100 poses only 100 of them, evenly, are tried as the first after the knock. Calibrate anew before the arm
    is used.
    """
    position = 31

    @property
    def displacement(self) -> LinkBend:
        return LinkBend(self.joint)

    @cached_property
    def parameters(self) -> Parameters:
        """Shift of the link's end along, and turn about, the axes of the frame at it."""
        word = self.start.word
        return (
            *(Parameter(f"{a}_from_{word}_mm", "mm", 0.1, f"shift of its end along {a}") for a in "xyz"),
            *(Parameter(f"about_{a}_from_{word}_rad", "rad", 3e-4, f"turn of its end about {a}") for a in "xyz"),
        )

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        """Row, first pose after the step, and a turn in degrees, as text."""
        turned = f"{np.degrees(value):+.2g}\N{DEGREE SIGN} " if parameter.unit == "rad" else ""
        return f"{turned}behind joint {self.joint + 1} from pose {self.start.pose} on"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member for each long link and each pose that may be the first after a knock.

        Two joints or more have to move what is beyond it: with fewer, it is a step of the target or of a joint. It is
        bent once: of two knocks in a session that bend a link, the second is more likely something else.
        """
        rows = dataset.robot.table[:-3]
        links = np.flatnonzero(np.hypot(rows[:, 0], rows[:, 2]) >= _BENDS_MM).tolist()
        if not links:
            short = f"no link with two joints beyond it is {_BENDS_MM:g} mm long"
            return cls.untestable(short, "nothing: a knock that turns so short a link is a step of a joint")
        family = _family(dataset, cls.name, lambda at: [cls(j, at) for j in links], MOST_LINK_STEPS, at_setups=False)
        return replace(family, most_members=1, contains=(JointStep.name,))
