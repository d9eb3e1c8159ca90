"""Result of a fit: the parameters, their covariance, and the solver's iterations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray
from calib.brief import Brief
from calib.effects.effect import Parameter


@dataclass(frozen=True)
class Iteration(Brief):
    """Parameters and cost after one accepted step of the solver; the first iteration is the start."""

    x: Array  # (P,)
    cost: float  # sum of squared whitened residuals, without the prior
    step: float  # length of the step to it, in tolerances


@dataclass(frozen=True)
class Fit(Brief):
    """Least-squares solution of R equations for P parameters; `x` holds corrections in the parameters' own units."""

    parameters: tuple[Parameter, ...]
    x: Array  # (P,)
    covariance: Array  # (P, P) posterior: by the noise that the residual shows, and the prior where one was used
    undetermined: BoolArray  # (P,) neither data nor prior bound them; their covariance is meaningless
    iterations: tuple[Iteration, ...]
    converged: bool
    reason: str
    rank: int  # of the Jacobian at the nominal robot, where redundant parameters are exactly redundant
    known: int  # directions whose sigma by the data alone is below their tolerance
    rows: int  # R
    degrees_of_freedom: float
    reduced_chi: float  # sqrt of the reduced chi-square, residual sigma over declared sigma; nan without dof
    load_moves: Array | float = 0.0  # (P,) by one sigma of a load that no file tells, which hardly moves a prediction

    @property
    def sigma(self) -> Array:
        """Standard deviation (P,) of each parameter, in its unit; inf where neither data nor prior bound it."""
        return np.where(self.undetermined, np.inf, np.sqrt(np.diag(self.covariance) + np.square(self.load_moves)))

    @property
    def by_name(self) -> dict[str, tuple[float, float]]:
        """Value and standard deviation of each parameter, by its name."""
        return {p.name: (float(x), float(s)) for p, x, s in zip(self.parameters, self.x, self.sigma, strict=True)}
