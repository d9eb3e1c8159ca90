"""Laws of a joint's error with few parameters: over its angle, another joint's, both, its load, the way that it came.

Each is a short formula (`FormulaModes`): one term over one input, perhaps times another input. What is tried is the
same for every arm that has the inputs, and all of it is charged for (`law_search.py`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, Vector
from calib.dataset.input_names import history_input, quantity_of, summed_joints
from calib.effects.gravity import loaded_joints
from calib.effects.state import RobotState
from calib.screening.curves.smooth_joint_error import FormulaModes, FormulaTerm, input_values
from calib.statistics import rms

ANGLE = "own angle"
LOAD = "load"
LOAD_BY_ANGLE = "load by angle"
LOAD_OF_ANOTHER = "load of another joint"
COUPLING = "coupling"
COUPLING_WAVE = "wave of another joint"
TWO_JOINTS = "wave of two joints"
PRODUCT = "product of joints"
WAY = "way from the pose before"
DIRECTION = "direction of travel"
DIRECTION_BY_ANGLE = "direction by angle"
DIRECTION_BY_LOAD = "direction by load"
MEMORY = "slow recovery"
WEAR = "distance travelled"
TIME = "time or temperature"
LAW_KINDS = (
    *(
        ANGLE,
        LOAD,
        LOAD_BY_ANGLE,
        LOAD_OF_ANOTHER,
        COUPLING,
        COUPLING_WAVE,
        TWO_JOINTS,
        PRODUCT,
        WAY,
        DIRECTION,
        DIRECTION_BY_ANGLE,
    ),
    *(DIRECTION_BY_LOAD, MEMORY, WEAR, TIME),
)
OF_ONE_INPUT = (ANGLE, LOAD, TIME)
"""Kinds that a curve over that input follows as well."""

_OWN_WAVES = range(1, 61)
_LOAD_WAVES = range(1, 41)  # teeth and rollers that give way unevenly
_OTHER_WAVES = range(1, 13)
_SUM_WAVES = range(1, 5)  # a cable's or a hose's; waves of a sum of angles grow alike with each other's order
_SIDE_WAVES = range(1, 13)
_PLACES = 12
_BUMPS_RAD = (0.05, 0.12, 0.3)
_MEMORY_S = (60, 120, 240, 480, 960, 1920)
_MEMORY_POSES = (2, 4, 8, 16)
_LEAST_VARIATION = 1e-9


@dataclass(frozen=True)
class LawForm:
    """A law that may be tried: the joint that errs, and the form of its error."""

    joint: int  # from 0
    modes: FormulaModes

    @property
    def kind(self) -> str:
        """Kind of the law, of `LAW_KINDS`."""
        return law_kind(self.joint, self.modes)


def law_kind(joint: int, modes: FormulaModes) -> str:
    """Kind of a joint's law, of `LAW_KINDS`, by its inputs and terms."""
    over, by = modes.input, modes.factor
    if _is_side(by) or _is_side(over):
        if not by:
            return DIRECTION
        return DIRECTION_BY_LOAD if quantity_of(over) == "torque" else DIRECTION_BY_ANGLE
    if (way := history_input(over)) is not None:
        return {"travel": WAY, "previous": WAY, "travelled": WEAR}.get(way.quantity, MEMORY)
    if quantity_of(by) == "torque":
        return LOAD_BY_ANGLE
    if quantity_of(over) == "torque":
        return LOAD if over == f"torque{joint + 1}" else LOAD_OF_ANOTHER
    if by:
        return PRODUCT
    if summed_joints(over) is not None:
        return TWO_JOINTS
    if over == f"q{joint + 1}":
        return ANGLE
    if quantity_of(over) == "q":
        return COUPLING_WAVE if modes.terms[0].kind == "harmonic" else COUPLING
    return TIME


def _is_side(name: str) -> bool:
    way = history_input(name)
    return quantity_of(name) == "approach" or (way is not None and way.quantity == "direction")


def laws_tried(state: RobotState) -> tuple[LawForm, ...]:
    """All laws that the poses of a state have the inputs for and of which the inputs vary."""
    robot = state.robot
    sizes = _Sizes(state)
    return tuple(
        LawForm(j, modes)
        for j in range(robot.n_joints)
        for modes in _of_joint(j, sizes)
        if all(name == "" or sizes.of(name) > 0.0 for name in (modes.input, modes.factor))
    )


class _Sizes:
    """Usual sizes of inputs over the poses of a state."""

    def __init__(self, state: RobotState) -> None:
        self.state = state
        self._kept: dict[str, Vector] = {}

    def range_of(self, name: str) -> tuple[float, float]:
        """Smallest and largest value of an input."""
        return self._known(name)[1:]

    def of(self, name: str) -> float:
        """Root mean square of an input; 0 where it does not vary or is not known everywhere."""
        return self._known(name)[0]

    def _known(self, name: str) -> Vector:
        if name not in self._kept:
            values = input_values(self.state, name)
            low, high = float(np.min(values)), float(np.max(values))
            varies = np.all(np.isfinite(values)) and high - low > _LEAST_VARIATION * max(1.0, abs(low), abs(high))
            self._kept[name] = (rms(values) if varies else 0.0, low, high)
        return self._kept[name]


def _of_joint(j: int, sizes: _Sizes) -> Iterator[FormulaModes]:
    """Every law of a joint's error."""
    state = sizes.state
    robot, poses = state.robot, state.poses
    own, load, others = f"q{j + 1}", f"torque{j + 1}", [k for k in range(robot.n_joints) if k != j]
    turns = robot.joints[j].is_revolute
    loaded = j in loaded_joints(robot)
    sides = [f"direction{j + 1}"] if poses.approach is None else [f"approach{j + 1}"]

    def line(name: str, factor: str = "") -> FormulaModes:
        return _modes(name, FormulaTerm("line", width=sizes.of(name) or 1.0), factor)

    def waves(name: str, orders: range, factor: str = "") -> Iterator[FormulaModes]:
        return (_modes(name, FormulaTerm("harmonic", order=n), factor) for n in orders)

    def _modes(name: str, term: FormulaTerm, factor: str = "") -> FormulaModes:
        return FormulaModes(name, (term,), factor, (sizes.of(factor) or 1.0) if factor else 1.0)

    if turns:
        yield from waves(own, _OWN_WAVES)
    yield from (_modes(own, term) for term in _placed_terms(*sizes.range_of(own), bumps=turns))
    if loaded:
        low, high = sizes.range_of(load)
        yield line(load)
        yield _modes(load, FormulaTerm("square"))
        yield from (_modes(load, term) for term in _placed_terms(low, high, bumps=False))
        if turns:
            yield from waves(own, _LOAD_WAVES, load)
        yield line(own, load)
        yield from (line(load, side) for side in sides)
    for k in others:
        other = f"q{k + 1}"
        yield line(other)
        if k in loaded_joints(robot):
            yield line(f"torque{k + 1}")
        if robot.joints[k].is_revolute:
            yield from waves(other, _OTHER_WAVES)
        yield from (line(f"q{low + 1}", f"q{high + 1}") for low, high in _products(j, k, others))
        yield from (line(f"{name}{k + 1}") for name in ("travel", "direction"))
        if turns and robot.joints[k].is_revolute:
            low, high = min(j, k) + 1, max(j, k) + 1
            yield from (one for sign in "+-" for one in waves(f"q{low}{sign}q{high}", _SUM_WAVES))
    yield from (line(f"{name}{j + 1}") for name in ("travel", "travelled", "direction"))
    if turns:
        yield from waves(f"previous{j + 1}", range(1, 4))
        yield from (one for side in sides for one in waves(own, _SIDE_WAVES, side))
    yield from (line(own, side) for side in sides)
    reaches = [f"{s}s" for s in _MEMORY_S] if poses.time_s is not None else [f"{n}poses" for n in _MEMORY_POSES]
    for reach in reaches:
        yield line(f"lagged{j + 1}_{reach}")
        if loaded:
            yield line(f"crept{j + 1}_{reach}")
    for name in ("time_s", "temperature_c"):
        if getattr(poses, name) is not None:
            low, high = sizes.range_of(name)
            yield _modes(name, FormulaTerm("line", place=low, width=max(high - low, 1e-9)))


def _products(j: int, k: int, others: list[int]) -> Iterator[tuple[int, int]]:
    """Pairs of joints whose angles' product may move joint j, each once: with its own, and of two others."""
    yield (min(j, k), max(j, k))
    yield from ((k, m) for m in others if m > k)


def _placed_terms(low: float, high: float, *, bumps: bool) -> Iterator[FormulaTerm]:
    """Kinks, hinges, steps, bumps and roots at places of a range."""
    for place in np.linspace(low, high, _PLACES + 2)[1:-1].tolist():
        yield FormulaTerm("kink", place=place)
        yield FormulaTerm("hinge", place=place, width=max(high - low, 1e-9))
        yield FormulaTerm("step", place=place)
        yield from (FormulaTerm("bump", place=place, width=w) for w in (_BUMPS_RAD if bumps else ()) if w < high - low)
    yield from (FormulaTerm("root", place=end, width=max(high - low, 1e-9)) for end in (low, high))
    if low < 0.0 < high:
        yield FormulaTerm("kink", place=0.0)


def law_motions(state: RobotState, forms: list[LawForm]) -> list[Array]:
    """Motions (N, K) of its joint by unit amounts of each law's terms, inputs evaluated once."""
    inputs: dict[str, Array] = {}

    def of(name: str) -> Array:
        if name not in inputs:
            inputs[name] = input_values(state, name)
        return inputs[name]

    out = []
    for form in forms:
        motions = form.modes.at(of(form.modes.input))
        out.append(
            motions * (of(form.modes.factor) / form.modes.factor_size)[:, None] if form.modes.factor else motions
        )
    return out
