"""Names of a dataset's objects in sentences."""

from __future__ import annotations

import re
from collections.abc import Sequence

from calib.dataset.dataset import Dataset
from calib.dataset.input_names import PLACES, history_input, input_unit, joint_input
from calib.effects.effect import Effect, parameters_by_name
from calib.kinematics.robot import PARAMETER_KINDS, Robot
from calib.rendering.blocks import Span, joined, joint, listed, plain
from calib.rendering.numbers import parameter_label

_CONDITIONS = {
    "payload_kg": "the payload",
    "temperature_c": "the temperature",
    "time_s": "time",
    "order": "the order of measuring",
}
ROLES = {"reference": "reference", "train": "training", "test": "test"}
_OF_JOINT = re.compile(r"(?:a|alpha|d|theta|beta)(\d+)")  # a parameter of the arm's table


def role(name: str) -> str:
    """Name of a pose's role: "training" for "train"."""
    return ROLES.get(name, name)


def parameter(name: str) -> Span:
    """Short name of a parameter; for a parameter in a joint's row of the table, as a reference to the joint."""
    of_joint = _OF_JOINT.fullmatch(name)
    return joint(int(of_joint[1]), parameter_label(name)) if of_joint else parameter_label(name)


def parameters(found: Sequence[str], last: str = "") -> tuple[Span, ...]:
    """List of parameters' short names: "a1, a2 and d3" with `last` "and", else "a1, a2, d3"."""
    named = list(map(parameter, found))
    return listed(named, last) if last else joined(named, ", ")


def joint_with_unit(number: int, unit: str = "") -> Span:
    """Name of a joint with its unit, for the head of a row: "joint 3, °"."""
    return joint(number, f"joint {number}" + (f", {unit}" if unit else ""))


def joints_by_parameter(robot: Robot, effects: Sequence[Effect] = ()) -> dict[str, int]:
    """Joint number, from 1, by name of each parameter of the table or of effects that belongs to a joint."""
    of_table = {f"{kind}{j + 1}": j + 1 for j in range(robot.n_joints) for kind in PARAMETER_KINDS}
    of_effects = {
        name: int(joint) + 1
        for name, (effect, _) in parameters_by_name(effects).items()
        if (joint := getattr(effect, "joint", None)) is not None
    }
    return of_table | of_effects


def _bare(name: str) -> str:
    return plain((input_name(name),))


def input_name(name: str) -> Span:
    """Name of a residual test's input for a sentence; a user's own column keeps its name."""
    factor, times, over = name.partition(" x ")
    if times and (joint_input(factor) or history_input(factor)):
        return f"{_bare(factor)} times {_bare(over)}"
    of_joint = joint_input(name)
    way = history_input(name)
    if way is not None:
        number = way.joint + 1
        what = {
            "travel": f"the way of joint {number} from the pose before",
            "previous": f"the place of joint {number} at the pose before",
            "travelled": f"all the way that joint {number} has gone",
            "direction": f"the direction in which joint {number} came",
            "crept": f"the load on joint {number} of the last {way.reach} {way.unit}",
            "lagged": f"the way of joint {number} from where it was in the last {way.reach} {way.unit}",
        }[way.quantity]
        return joint(number, what)
    if of_joint is not None:
        quantity, index = of_joint
        number = index + 1
        return {
            "q": joint(number, f"joint {number} (q{number})"),
            "torque": joint(number, f"gravity's torque on joint {number}"),
            "approach": joint(number, f"the approach of joint {number}"),
        }[quantity]
    if name in PLACES:
        return f"{name} of the instrument's frame"
    return _CONDITIONS.get(name, name)


def read_unit(unit: str) -> str:
    """Unit of an input as readers know it."""
    return {"deg": "°", "C": "°C"}.get(unit, unit)


def input_title(name: str, robot: Robot) -> str:
    """Title of an input with its unit: "q3" -> "joint 3 (q3), °"."""
    unit = read_unit(input_unit(name, robot))
    return _bare(name).removeprefix("the ") + (f", {unit}" if unit else "")


def instrument(dataset: Dataset) -> str:
    """Noun for the measuring device: "scanner", "camera", or "instrument" where neither faces nor a board were seen."""
    named = next((kind.instrument for kind in dataset.kinds_of_attachments if kind.instrument), "")
    return named or ("scanner" if dataset.shows_faces else "instrument")
