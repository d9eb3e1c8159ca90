"""What an effect is: named parameters with units, and one pure function from the robot's state to the robot's state.

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
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, TypeGuard, runtime_checkable

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.display.brief import Brief
from calib.effects.checked_apply import checked_apply, checked_meaning, is_users
from calib.effects.state import RobotState
from calib.kinematics.robot import Robot


@dataclass(frozen=True)
class Parameter:
    """One unknown number. `scale` is its usual size, in `unit`: the prior's sigma and the solver's unit for it."""

    name: str  # a Python identifier, the keyword by which `apply` gets the value
    unit: str  # "mm", "rad", "rad/Nm" ...; tables and pages show radians as degrees
    scale: float  # in `unit`, above 0
    doc: str = ""  # a few words
    nominal: float = 0.0  # what is reported is nominal + the fitted value
    positive: bool = False  # whether only this sign is possible, as of a compliance


@runtime_checkable
class Effect(Protocol):
    """What every effect has: its parameters, and `apply`, which takes a value for each of them by its name."""

    @property
    def parameters(self) -> Sequence[Parameter]:
        """What is unknown about it; names are Python identifiers."""
        ...

    @property
    def apply(self) -> Callable[..., RobotState]:
        """`apply(state, **values)`: the state with the effect in it."""
        ...


class RobotCorrection(Effect, Protocol):
    """An effect whose values are errors of what robot.toml holds."""

    def corrected(self, robot: Robot, values: Array) -> Robot:
        """The robot with these errors, in the order of the parameters, built in."""
        ...


class JointMotion(Effect, Protocol):
    """A linear effect that adds to one joint and has so many parameters that its derivative is wanted at once."""

    @property
    def joint(self) -> int:
        """Counted from 0."""
        ...

    def joint_motions(self, state: RobotState) -> Array:
        """(N, K) what a unit of each parameter adds to the joint."""
        ...


@dataclass(frozen=True)
class Family(Brief):
    """An effect as it is named: one cause, with a member for each joint (and harmonic) that may carry it or not."""

    name: str
    members: tuple[Effect, ...]
    why_not: str = ""  # why this dataset cannot test it, "" where it can
    would_help: str = ""  # what to measure or write down so that it can be tested
    note: str = ""  # what was assumed, such as unknown masses
    covered: bool = False  # whether another family tests the same cause where this one cannot
    sparse: bool = False  # whether members are places of one cause, few of which carry it; all equally wide
    most_members: int = 8  # of a sparse family, that may carry it
    open_with: tuple[str, ...] = ()  # families that these data cannot tell from it, whatever they show

    @property
    def description(self) -> Description:
        """What the members' class says; of a family without members the name alone."""
        return describe(self.members[0]) if self.members else Description(self.name)

    @property
    def never_testable(self) -> bool:
        """Whether no dataset of this format can test it, so that its being untestable says nothing of the data."""
        return self.covered or any(getattr(member, "testable", True) is False for member in self.members)

    def _brief(self) -> str:
        return f"{self.name}: {len(self.members)} members" if not self.why_not else f"{self.name}: {self.why_not}"


class CatalogueEffect(ABC):
    """What the class of an effect of the catalogue has besides `parameters` and `apply`: all that is said about it.

    An effect of a user's own needs none of this. It may carry `equation`, `needs` and `confirm` too, and so may either
    have a method `meaning(parameter, value, state)`: what a value, in the parameter's unit, means on the arm at the
    poses of a state, such as degrees at the largest torque. Without it the unit alone decides: degrees, stiffness,
    per cent (`calib.diagnosis.parameter_meaning`).
    """

    name: ClassVar[str]  # as the command line and the files take it
    equation: ClassVar[str]
    symbols: ClassVar[tuple[tuple[str, str], ...]]  # the equation's unknowns: name, unit
    needs: ClassVar[str]  # what a dataset must hold
    testable: ClassVar[bool] = True  # False where no dataset of this format can test it
    # whether it is another before and after a pose; later poses are as the last one
    changes_arm: ClassVar[bool] = False
    confirm: ClassVar[str] = ""  # a controlled change that shows this cause and leaves the others as they are

    @classmethod
    @abstractmethod
    def family(cls, dataset: Dataset) -> Family:
        """The members for a robot and the conditions of its poses; where the data for them are missing, why not."""


@dataclass(frozen=True)
class Description:
    """What an effect's class says of it, "" where it says nothing."""

    name: str
    equation: str = ""
    symbols: tuple[tuple[str, str], ...] = ()  # name, unit
    needs: str = ""
    confirm: str = ""


def family_name(effect: Effect) -> str:
    """The name that the command line takes: the effect's own, else its class's in lower case with underscores."""
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
    """The texts on an effect's class."""
    name = effect.name if isinstance(effect, type) else family_name(effect)
    said = {text: getattr(effect, text, "") for text in ("equation", "needs", "confirm")}
    texts = {text: words for text, words in said.items() if isinstance(words, str)}  # a user's may be anything
    return Description(name, symbols=getattr(effect, "symbols", ()), **texts)


def parameters_by_name(effects: Sequence[Effect]) -> dict[str, tuple[Effect, Parameter]]:
    """By its full name, each parameter of these effects, with its effect."""
    return {full_name(effect, p): (effect, p) for effect in effects for p in effect.parameters}


def has_meaning(effect: Effect) -> bool:
    """Whether the effect itself says what its values mean on the arm."""
    return callable(getattr(effect, "meaning", None))


def meaning_of(effect: Effect, parameter: Parameter, value: float, state: RobotState) -> str:
    """What the effect says that a value of its parameter means on the arm, at the poses of a state.

    Raises CalibError where an effect from outside this package fails to say it.
    """
    say = getattr(effect, "meaning")  # noqa: B009  no part of the contract
    return checked_meaning(effect, parameter, value, state) if is_users(effect) else str(say(parameter, value, state))


def families_from(effects: Sequence[Effect]) -> tuple[Family, ...]:
    """Effects of a user's own, those of one name together."""
    names = list(dict.fromkeys(family_name(effect) for effect in effects))
    return tuple(Family(name, tuple(e for e in effects if family_name(e) == name)) for name in names)


def apply_values(effect: Effect, state: RobotState, values: Array) -> RobotState:
    """`apply` with the values in the order of the effect's parameters.

    Raises CalibError where an effect from outside this package fails.
    """
    named: dict[str, Any] = {p.name: float(v) for p, v in zip(effect.parameters, values, strict=True)}
    return checked_apply(effect, state, named) if is_users(effect) else effect.apply(state, **named)


def corrects_robot(effect: Effect) -> TypeGuard[RobotCorrection]:
    """Whether the effect says, by `corrects_robot = True`, that its values are errors of what robot.toml holds.

    They can be built into it, and are part of every fit. For this package's own effects only: whoever adds one value by
    `add_link_error` has another effect.
    """
    return not is_users(effect) and getattr(effect, "corrects_robot", False) is True


def is_held_by_prior(effect: Effect) -> bool:
    """Whether the effect says, by `held_by_prior = True`, that its prior sigmas are part of it: it may have more
    parameters than there are equations.
    """
    return getattr(effect, "held_by_prior", False) is True


def is_linear(effect: Effect) -> bool:
    """Whether the effect says, by `linear = True`, that it adds to the state a multiple of each parameter's value."""
    return getattr(effect, "linear", False) is True


def moves_one_joint(effect: Effect) -> TypeGuard[JointMotion]:
    """Whether the effect tells its derivative at once: a linear one of this package that adds to one joint only."""
    return not is_users(effect) and is_linear(effect) and hasattr(effect, "joint_motions")


def state_derivative(effect: Effect, state: RobotState, values: Array) -> Iterator[Array]:
    """d state.vector / d value for each parameter of an effect that acts on `state`, one by one: (1 or N, S).

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
