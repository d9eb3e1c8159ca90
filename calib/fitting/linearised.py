"""What a residual gives the solver at one x."""

from __future__ import annotations

from dataclasses import dataclass

from calib.effects.effect import Array


@dataclass(frozen=True)
class Linearised:
    """Residual (R,) and Jacobian (R, P), whitened."""

    residual: Array
    jacobian: Array
