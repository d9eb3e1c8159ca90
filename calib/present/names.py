"""What things of a dataset are called in a sentence."""

from __future__ import annotations

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
