"""What stands around an arm, in its base frame: the floor and boxes that the arm keeps clear of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from calib.kinematics.robot import Vector


@dataclass(frozen=True)
class Box:
    """A box along the base's axes, between two of its corners."""

    name: str
    min_mm: Vector
    max_mm: Vector


@dataclass(frozen=True)
class Surroundings:
    """The floor's height and boxes, base frame; `floor_z_mm` None: not known."""

    floor_z_mm: float | None = None
    boxes: tuple[Box, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)
