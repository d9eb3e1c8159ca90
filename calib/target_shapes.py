"""The targets that a scanner may look at besides the three-faced jig: spheres, a plate's corner, planes, a socket."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from calib.jig import Jig

SPHERE_MM = (4.0, 400.0)
"""Diameters of spheres that are looked for where no diameter is told."""


@dataclass(frozen=True)
class Sphere:
    """A ball: the target is its centre."""

    diameter_mm: float | None = None  # None: not known, it is found with the centre


Shape = Jig | Sphere


@dataclass(frozen=True)
class Target:
    """One target of a dataset: its name, as in robot.toml and points.csv, and what it looks like."""

    name: str
    shape: Shape
    extra: dict[str, Any] = field(default_factory=dict)
