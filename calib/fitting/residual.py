"""Interface of a least-squares problem for the solver: parameters, residual and Jacobian.

All residuals are whitened: with the declared sigmas right and the model complete, each row has variance 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from calib.array_types import Array
from calib.effects.effect import Parameter


@dataclass(frozen=True)
class Linearisation:
    """Whitened residual (R,) and Jacobian (R, P) at one parameter vector x."""

    residual: Array
    jacobian: Array


class Residuals(Protocol):
    """A least-squares problem of R equations for P parameters."""

    @property
    def parameters(self) -> tuple[Parameter, ...]: ...

    @property
    def degrees_spent(self) -> int:
        """Number of unknowns that are eliminated from the residual, as the scanner frames are."""
        ...

    @property
    def noise_floor(self) -> float:
        """Least possible noise over the declared sigma; a smaller residual means overfitting."""
        ...

    def residual(self, x: Array) -> Array:
        """Whitened residual (R,) at x (P,)."""
        ...

    def linearise(self, x: Array) -> Linearisation:
        """Whitened residual (R,) and Jacobian (R, P) at x (P,)."""
        ...
