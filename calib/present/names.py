"""What things of a dataset are called in a sentence."""

from __future__ import annotations

from calib.dataset.input_names import PLACES, joint_input
from calib.present.blocks import Span, joint

_CONDITIONS = {
    "payload_kg": "the payload",
    "temperature_c": "the temperature",
    "time_s": "time",
    "order": "the order of measuring",
}
ROLES = {"reference": "reference", "train": "training", "test": "test"}


def role(name: str) -> str:
    """The role of a pose: "training" of "train"."""
    return ROLES.get(name, name)


def change(what: str, joint: int | None, parameter: str = "") -> str:
    """A kind of change of a cell: "zero of joint 3", "length a2", "tool"."""
    if parameter and what in ("length", "angle"):
        return f"{what} {parameter}"
    noun = "zero" if what == "joint_zero" else what
    return noun if joint is None else f"{noun} of joint {joint}"


def input_name(name: str) -> Span:
    """An input that a residual may depend on, in a sentence; a column of the user's own stays as it is."""
    of_joint = joint_input(name)
    if of_joint is not None:
        quantity, index = of_joint
        number = index + 1
        return {
            "q": joint(number, f"joint {number} (q{number})"),
            "torque": joint(number, f"gravity's torque on joint {number}"),
            "approach": joint(number, f"the approach of joint {number}"),
        }[quantity]
    if name in PLACES:
        return f"{name} of the scanner's frame"
    return _CONDITIONS.get(name, name)
