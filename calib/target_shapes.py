"""Shapes of the targets that a scanner may measure: the three-faced jig, and others. Finders are in `calib.targets`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from calib.jig import Jig

SPHERE_MM = (4.0, 400.0)
"""Range of the diameters that are searched for where none is declared."""


@dataclass(frozen=True)
class Sphere:
    """A ball: the target is its centre."""

    diameter_mm: float | None = None  # None: not known, it is found with the centre


@dataclass(frozen=True)
class Spheres:
    """Three or more balls of one diameter, each a target, identified by the distances between them."""

    names: tuple[str, ...]  # of the targets that the centres are
    distances_mm: tuple[float, ...]  # between centres 1-2, 1-3, ..., 2-3, ...
    diameter_mm: float | None = None


@dataclass(frozen=True)
class Socket:
    """A ball or a socket that a touch probe measures: its contacts lie on a sphere, whose centre is the target."""

    diameter_mm: float | None = None  # of that sphere: the ball's and the probe's together, or their difference
    probe_sigma_mm: float = 0.005  # of one contact, along the surface's normal


@dataclass(frozen=True)
class OwnShape:
    """A target shape that only a finder of the user's own can find."""

    sizes: Mapping[str, Any] = field(default_factory=dict)  # all keys of its table in dataset.toml


Shape = Jig | Sphere | Spheres | Socket | OwnShape


@dataclass(frozen=True)
class DeclaredTarget:
    """A target as dataset.toml declares it: a name, as in robot.toml and points.csv, and a shape."""

    name: str
    shape: Shape

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the measured points that the target gives: one, or one for each ball."""
        return self.shape.names if isinstance(self.shape, Spheres) else (self.name,)
