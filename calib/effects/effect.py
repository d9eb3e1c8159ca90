"""Effects: named parameters with units, and one pure function from the robot's state to the robot's state.

A model is a robot with a list of effects, whose parameters a fit finds. Every effect obeys one law: **zero means
absent**. At zero parameters `apply` returns the state bit for bit.

A user's own effect needs no more than this::

    @dataclass(frozen=True)
    class EncoderEccentricity:
        \"\"\"Once-per-turn encoder error of one joint: dq = c cos(q) + s sin(q).\"\"\"

        joint: int
        parameters = (
            Parameter("cos_rad", unit="rad", scale=1e-4, doc="cosine amplitude"),
            Parameter("sin_rad", unit="rad", scale=1e-4, doc="sine amplitude"),
        )

        def apply(self, state, *, cos_rad, sin_rad):
            q_rad = state.q_rad[:, self.joint]
            return state.add_joint_error(self.joint, cos_rad * np.cos(q_rad) + sin_rad * np.sin(q_rad))

It may carry what `CatalogueEffect` has besides: `noun`, `equation`, `needs`, `needed_conditions`,
`helpful_conditions`, `confirm`, `bounds`, `meaning`.
"""

from __future__ import annotations

import re
from abc import ABC
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, ClassVar, Literal, Protocol, TypeGuard, get_args, runtime_checkable

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.dataset.dataset import Dataset, PoseCondition
from calib.effects.checked_apply import checked_apply, checked_meaning, is_user_defined
from calib.effects.state import RobotState
from calib.kinematics.robot import Robot

PartOf = Literal["arm", "instrument", "target", "load"]
"""What an effect's cause is a part of: the arm, the instrument that measures it, the measured target, the payload."""


@dataclass(frozen=True)
class Parameter:
    """One unknown of an effect; `scale` is its usual size, in `unit`: the prior's sigma and the solver's unit."""

    name: str  # a Python identifier, the keyword by which `apply` gets the value
    unit: str  # "mm", "rad", "rad/Nm" ...; tables and pages show radians as degrees
    scale: float  # in `unit`, above 0
    doc: str = ""  # a few words
    nominal: float = 0.0  # what is reported is nominal + the fitted value
    positive: bool = False  # whether only this sign is possible, as of a compliance
    prior_mean: float = 0.0  # of the fitted value, where arms of its type tell it


Parameters = tuple[Parameter, ...]


@dataclass(frozen=True)
class NaturalBound:
    """Largest size that an effect's parameters of one unit have on real arms, with the source as a clause.

    A fitted value beyond it is hardly what its name says. The usual size, `Parameter.scale`, is far below. Bounds are
    generous, from makers' tables and the strength of materials.
    """

    size: float
    unit: str
    source: str
    refused: float = 10.0  # multiple of it from which no fit is believed; wrong masses make less than that


@runtime_checkable
class Effect(Protocol):
    """The interface of every effect: its parameters, and `apply`, with a keyword for each parameter's value."""

    @property
    def parameters(self) -> Sequence[Parameter]:
        """Unknowns of the effect, whose names are Python identifiers."""
        ...

    @property
    def apply(self) -> Callable[..., RobotState]:
        """Function `apply(state, **values)` that gives the robot state with the effect applied."""
        ...


class RobotCorrection(Effect, Protocol):
    """An effect whose values are errors of quantities in robot.toml."""

    def corrected(self, robot: Robot, values: Array) -> Robot:
        """Robot with given errors added to its quantities, in the order of the effect's parameters."""
        ...


class JointMotion(Effect, Protocol):
    """A linear effect on one joint whose derivatives by all parameters are computed at once."""

    @property
    def joint(self) -> int:
        """Index of the joint, counted from 0."""
        ...

    def joint_motions(self, state: RobotState) -> Array:
        """Change of the joint's position by one unit of each parameter: (N, K) rad, mm for a prismatic joint."""
        ...


@dataclass(frozen=True)
class Family(Brief):
    """An effect as a set of members, one for each joint (and harmonic, or place) that may show it."""

    name: str
    members: tuple[Effect, ...]
    why_not: str = ""  # why this dataset cannot test it, "" where it can
    would_help: str = ""  # what to measure or write down so that it can be tested
    note: str = ""  # what was assumed, such as unknown masses
    covered: bool = False  # whether another family tests the same cause where this one cannot
    sparse: bool = False  # whether members are places of one cause, few of which carry it; all equally wide
    most_members: int = 8  # of a sparse family, that may carry it
    superposed: bool = False  # whether several members of one place make up one cause, such as two time constants
    finer: Callable[[Effect], tuple[Effect, ...]] | None = None  # of one law with a grid of constants, of which one
    # holds: members around one of them
    confounded_with: tuple[str, ...] = ()  # families that these data cannot tell from it, whatever the fit gives
    contains: tuple[str, ...] = ()  # simpler families that are special cases of it, told where they say as much

    @property
    def description(self) -> Description:
        """Description of the effect; its name alone for a family without members."""
        return describe(self.members[0]) if self.members else Description(self.name)

    @property
    def never_testable(self) -> bool:
        """Whether no dataset of this format can test the effect, so that `why_not` says nothing about the data."""
        return self.covered or any(getattr(member, "testable", True) is False for member in self.members)

    def _brief(self) -> str:
        return f"{self.name}: {len(self.members)} members" if not self.why_not else f"{self.name}: {self.why_not}"


class CatalogueEffect(ABC):
    """Base class of the catalogue's effects; class attributes hold an effect's texts and bounds.

    A subclass with a `name` in a module of `calib.effects.catalogue` is registered as a family of the catalogue when it
    is defined; a subclass of that without a name of its own as a further kind of the family's members, such as those of
    an arm whose masses are not known. The exact law for simulations, which shares no code with it, is registered by the
    same name (`calib.simulation.truth.sampling.SampledEffect`).

    A user's own effect needs none of this. It may carry `title`, `noun`, `equation`, `needs`, `needed_conditions`,
    `helpful_conditions`, `confirm`, `bounds` and `of` too, and so may either have a method
    `meaning(parameter, value, state)`: what a value, in the parameter's unit, means on the arm at the poses of a state,
    such as degrees at the largest torque. Without it the unit alone decides: degrees, stiffness, per cent
    (`calib.present.effects.meaning`).
    """

    name: ClassVar[str]  # the key in commands and files
    title: ClassVar[str] = ""  # for people, such as "joint compliance"; "": the key with spaces
    noun: ClassVar[str]  # in a sentence, "the compliance of joint"; one that ends so is followed by the joint's number
    equation: ClassVar[str]
    symbols: ClassVar[tuple[tuple[str, str], ...]]  # the equation's unknowns: name, unit
    needs: ClassVar[str]  # what a dataset must hold, in words
    needed_conditions: ClassVar[tuple[PoseCondition, ...]] = ()  # that must vary over the poses for it to show
    helpful_conditions: ClassVar[tuple[PoseCondition, ...]] = ()  # that make it show better where they vary
    confirm: ClassVar[str] = ""  # a controlled change that shows this cause and leaves the others as they are
    bounds: ClassVar[tuple[NaturalBound, ...]]  # one for each unit of its parameters; () where none is known
    notes: ClassVar[str] = ""  # MyST for its page in the documentation: the law in LaTeX, what is known on real arms
    position: ClassVar[int] = 1000  # in the catalogue's order; equal ones follow by module and order of definition
    testable: ClassVar[bool] = True  # False where no dataset of this format can test it
    under_load: ClassVar[bool] = False  # whether it follows gravity's load, so that unknown masses confound it
    of: ClassVar[PartOf] = "arm"  # what its cause is a part of
    changes_arm: ClassVar[bool] = False  # whether it is another before and after a pose; later poses are as the last
    members_of: ClassVar[Literal["joints", "revolute joints", "cell"]] = "joints"  # what the family has one member for
    orders: ClassVar[Sequence[int]] = ()  # harmonics, of which each joint has a member each
    is_sparse: ClassVar[bool] = False  # whether few of the members carry it
    grows_with_angle: ClassVar[bool] = False  # whether it follows the size of one joint's angle, as a part of much does

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if not cls.__module__.startswith(_CATALOGUE) or not hasattr(cls, "name"):  # a user's, a test's; abstract
            return
        _MEMBER_KINDS.append(cls)
        if "name" in vars(cls):
            missing = [text for text in ("noun", "equation", "symbols", "needs", "bounds") if not hasattr(cls, text)]
            if missing or cls.name in _REGISTERED:
                trouble = f"lacks {', '.join(missing)}" if missing else f"has the name {cls.name!r} of another"
                raise TypeError(f"effect {cls.__qualname__} {trouble}")
            _REGISTERED[cls.name] = cls

    @classmethod
    def untestable(cls, why_not: str, would_help: str, *, covered: bool = False) -> Family:
        """Family of this effect without members, for data that cannot test it."""
        return Family(cls.name, (), why_not, would_help, covered=covered)

    @classmethod
    def untimed(cls, time_s: Array | None) -> Family:
        """Family of this effect without members, for poses whose times are not known, or all the same."""
        why_not = "poses.csv has no time_s" if time_s is None else "time_s is the same at every pose"
        return cls.untestable(why_not, "write down when each pose was measured")

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect for a dataset's robot and conditions; marked as untestable if data are missing.

        As it stands it has a member for each joint, each revolute joint, or one for the whole cell (`members_of`), and
        for each of its `orders`.
        """
        robot = dataset.robot
        joints = range(robot.n_joints) if cls.members_of == "joints" else robot.revolute_joints
        make: Any = cls  # its fields are those of a dataclass
        places = [()] if cls.members_of == "cell" else product(joints, cls.orders) if cls.orders else zip(joints)
        return Family(cls.name, tuple(make(*place) for place in places), sparse=cls.is_sparse)


_CATALOGUE = "calib.effects.catalogue."
_REGISTERED: dict[str, type[CatalogueEffect]] = {}  # by name; filled as the catalogue's modules are imported
_MEMBER_KINDS: list[type[CatalogueEffect]] = []  # these and their further kinds of members


def registered_effects() -> tuple[type[CatalogueEffect], ...]:
    """Effect classes of the catalogue defined so far, in the catalogue's order.

    `calib.effects.catalogue.CATALOGUE` is all of them.
    """
    return tuple(sorted(_REGISTERED.values(), key=lambda kind: kind.position))


def registered_member_kinds() -> tuple[type[CatalogueEffect], ...]:
    """All effect classes defined so far, further kinds of members included (such as for unknown masses)."""
    return tuple(_MEMBER_KINDS)


@dataclass(frozen=True)
class Description:
    """Texts that describe an effect ("" where missing), and the conditions of poses that the effect needs."""

    name: str
    title: str = ""
    noun: str = ""
    equation: str = ""
    symbols: tuple[tuple[str, str], ...] = ()  # name, unit
    needs: str = ""
    confirm: str = ""
    of: PartOf = "arm"
    needed_conditions: tuple[PoseCondition, ...] = ()
    helpful_conditions: tuple[PoseCondition, ...] = ()


def part_of(effect: Effect | type[CatalogueEffect]) -> PartOf:
    """What an effect's cause is a part of: the arm, unless the effect's attribute `of` says otherwise."""
    told: PartOf = getattr(effect, "of", "arm")
    return told if told in get_args(PartOf) else "arm"


def is_of_measuring(effect: Effect) -> bool:
    """Whether an effect is of the instrument or the target, and so no error of the arm."""
    return part_of(effect) in ("instrument", "target")


def family_name(effect: Effect) -> str:
    """Name of an effect's family: its attribute `name`, else its class's name in lower case with underscores."""
    name = getattr(effect, "name", None)
    return str(name) if name else re.sub(r"(?<!^)(?=[A-Z])", "_", type(effect).__name__).lower()


def full_name(effect: Effect, parameter: Parameter) -> str:
    """A parameter's name in a model: `family.parameter`, or `family.J2.parameter` where the effect is of a joint.

    Corrections of robot.toml keep their own names, a1 ... betaTCP and smr2.x.
    """
    if corrects_robot(effect):
        return parameter.name
    joint = getattr(effect, "joint", None)
    middle = "" if joint is None else f".J{int(joint) + 1}"
    return f"{family_name(effect)}{middle}.{parameter.name}"


def describe(effect: Effect | type[CatalogueEffect]) -> Description:
    """Description of an effect, from attributes of its class; an attribute of a wrong type counts as missing."""
    name = effect.name if isinstance(effect, type) else family_name(effect)
    values = {text: getattr(effect, text, "") for text in ("title", "noun", "equation", "needs", "confirm")}
    texts = {text: value for text, value in values.items() if isinstance(value, str)}
    texts["title"] = texts.get("title") or name.replace("_", " ")
    return Description(
        name,
        symbols=getattr(effect, "symbols", ()),
        of=part_of(effect),
        needed_conditions=_conditions(effect, "needed_conditions"),
        helpful_conditions=_conditions(effect, "helpful_conditions"),
        **texts,
    )


def _conditions(effect: Effect | type[CatalogueEffect], attribute: str) -> tuple[PoseCondition, ...]:
    """Conditions of poses that are listed in an attribute of an effect."""
    named = getattr(effect, attribute, ())
    return tuple(one for one in get_args(PoseCondition) if isinstance(named, Sequence) and one in named)


def parameters_by_name(effects: Sequence[Effect]) -> dict[str, tuple[Effect, Parameter]]:
    """Mapping from the full name of each parameter of some effects to the pair of effect and parameter."""
    return {full_name(effect, p): (effect, p) for effect in effects for p in effect.parameters}


def exceeded_bound(effect: Effect, parameter: Parameter, value: float, sigma: float) -> NaturalBound | None:
    """Natural bound that a parameter's value exceeds by more than two sigmas; None where it exceeds none."""
    for bound in getattr(effect, "bounds", ()):
        if bound.unit == parameter.unit:
            return bound if abs(value) - 2.0 * sigma > bound.size else None
    return None


def has_meaning(effect: Effect) -> bool:
    """Whether the effect describes in words what its values mean on the arm."""
    return callable(getattr(effect, "meaning", None))


def meaning_of(effect: Effect, parameter: Parameter, value: float, state: RobotState) -> str:
    """Text from an effect on what a parameter's value means on the arm, at the poses of a state.

    Raises CalibError where an effect from outside this package fails to say it.
    """
    say = getattr(effect, "meaning")  # noqa: B009  no part of the contract
    return (
        checked_meaning(effect, parameter, value, state)
        if is_user_defined(effect)
        else str(say(parameter, value, state))
    )


def families_from(effects: Sequence[Effect]) -> tuple[Family, ...]:
    """A user's own effects grouped into families by name."""
    names = list(dict.fromkeys(family_name(effect) for effect in effects))
    return tuple(Family(name, tuple(e for e in effects if family_name(e) == name)) for name in names)


def apply_values(effect: Effect, state: RobotState, values: Array) -> RobotState:
    """Robot state with an effect applied, for values in the order of the effect's parameters.

    Raises CalibError where an effect from outside this package fails.
    """
    named: dict[str, Any] = {p.name: float(v) for p, v in zip(effect.parameters, values, strict=True)}
    return checked_apply(effect, state, named) if is_user_defined(effect) else effect.apply(state, **named)


def corrects_robot(effect: Effect) -> TypeGuard[RobotCorrection]:
    """Whether the effect declares, by `corrects_robot = True`, that its values are errors of quantities in robot.toml.

    They can be built into it, and are part of every fit. For this package's own effects only: an effect that adds one
    value by `add_link_error` is something else.
    """
    return not is_user_defined(effect) and getattr(effect, "corrects_robot", False) is True


def is_held_by_prior(effect: Effect) -> bool:
    """Whether the effect declares, by `held_by_prior = True`, that its prior sigmas are part of the effect.

    It may then have more parameters than there are equations.
    """
    return getattr(effect, "held_by_prior", False) is True


def is_linear(effect: Effect) -> bool:
    """Whether the effect declares, by `linear = True`, that its change of the state is linear in each parameter."""
    return getattr(effect, "linear", False) is True


def moves_one_joint(effect: Effect) -> TypeGuard[JointMotion]:
    """Whether the effect is a `JointMotion` of this package: linear, on one joint, with all derivatives at once."""
    return not is_user_defined(effect) and is_linear(effect) and hasattr(effect, "joint_motions")


def state_derivative(effect: Effect, state: RobotState, values: Array) -> Iterator[Array]:
    """Derivatives of the state vector (1 or N, S) by each parameter of an effect, one by one.

    Differences of the effect's own map, which is cheap; the chain's part of the derivative is analytic. A linear effect
    has the same derivative everywhere: one step of a parameter's scale from zero, where the effect is absent. Others
    take central differences, steps of 1e-3 of the scale.
    """
    linear = is_linear(effect)
    for k, parameter in enumerate(effect.parameters):
        step = np.zeros(len(values))
        if linear:
            step[k] = parameter.scale
            yield (apply_values(effect, state, step).vector - state.vector) / step[k]
        else:
            step[k] = 1e-3 * parameter.scale
            high = apply_values(effect, state, values + step).vector
            low = apply_values(effect, state, values - step).vector
            yield (high - low) / (2.0 * step[k])
