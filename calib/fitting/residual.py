"""What the solver knows of a problem: its parameters, and at any x the residual and its Jacobian.

All residuals are whitened: with the declared sigmas right and the model complete, each row has variance 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from calib.array_types import Array
from calib.effects.effect import Parameter


@dataclass(frozen=True)
class Linearisation:
    """A residual (R,) and its Jacobian (R, P) at one x, whitened; P parameters in their own units."""

    residual: Array
    jacobian: Array


class Residuals(Protocol):
    """R equations for P parameters."""

    @property
    def parameters(self) -> tuple[Parameter, ...]: ...

    @property
    def degrees_spent(self) -> int:
        """Unknowns that the residual has solved for by itself (the scanner's frames)."""
        ...

    @property
    def noise_floor(self) -> float:
        """The least that the noise can be, over the declared sigma: a residual below it is fitted to itself."""
        ...

    def residual(self, x: Array) -> Array:
        """(R,) at x (P,)."""
        ...

    def linearise(self, x: Array) -> Linearisation:
        """Residual and Jacobian at x (P,)."""
        ...
