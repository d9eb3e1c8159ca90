"""What the residuals of measured points have in common: the model, what was observed, and their setups."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.array_types import IndexArray
from calib.brief import Brief
from calib.effects.effect import Parameter
from calib.fitting.model import Model
from calib.fitting.observations import Observations


@dataclass(frozen=True)
class ObservedResiduals(Brief):
    """A model and the points that it is to explain; classes below it say what of them is compared."""

    model: Model
    observed: Observations

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self.model.parameters

    @property
    def noise_floor(self) -> float:
        return self.observed.noise_floor

    @cached_property
    def _setup_rows(self) -> list[IndexArray]:
        """Numbers of the points of each setup."""
        setup = self.observed.setup
        return [np.flatnonzero(setup == name) for name in np.unique(setup)]
