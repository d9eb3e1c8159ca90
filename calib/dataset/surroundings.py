"""What an arm keeps clear of, in its base frame: the floor, boxes, and its own singularities."""

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
    """The floor's height and boxes, base frame, and how far the arm keeps from singularities.

    `floor_z_mm` None: not known. `least_manipulability` is that of `calib.workcell.measurable.manipulability`, 0 to 1.
    """

    floor_z_mm: float | None = None
    boxes: tuple[Box, ...] = ()
    least_manipulability: float = 0.0
    extra: Mapping[str, Any] = field(default_factory=dict)
