"""What things of a dataset are called in a sentence."""

from __future__ import annotations

ROLES = {"reference": "reference", "train": "training", "test": "test"}


def role(name: str) -> str:
    """The role of a pose: "training" of "train"."""
    return ROLES.get(name, name)
