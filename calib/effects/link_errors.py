"""The link errors of the five-parameter model: the effect that every calibration starts with."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calib.effects.effect import Parameter
from calib.effects.state import RobotState
from calib.kinematics.robot import LENGTH_KINDS, PARAMETER_KINDS, Robot

TOLERANCE_MM = 1.0
"""Manufacturing tolerance of a length, the default prior's sigma."""
TOLERANCE_RAD = math.radians(0.5)
"""Manufacturing tolerance of an angle, the default prior's sigma."""


@dataclass(frozen=True)
class LinkErrors:
    """Errors of every a, alpha, d, theta and beta of a robot's table (Jang 2025 eq 3), constant over the poses.

    `tolerances` gives single parameters, by name, another tolerance than the two defaults; mm or rad.
    """

    robot: Robot
    tolerances: Mapping[str, float] = field(default_factory=dict)
    name = "link_errors"
    linear = True
    changes_table = True

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """a1 alpha1 d1 theta1 beta1 ... betaTCP."""
        names = self.robot.parameter_names
        kinds = [kind for _ in self.robot.frame_names for kind in PARAMETER_KINDS]
        return tuple(
            Parameter(
                name,
                unit="mm" if kind in LENGTH_KINDS else "rad",
                scale=self.tolerances.get(name, TOLERANCE_MM if kind in LENGTH_KINDS else TOLERANCE_RAD),
                doc=f"{kind} of frame {name.removeprefix(kind)}",
                nominal=float(value),
            )
            for name, kind, value in zip(names, kinds, self.robot.table.ravel(), strict=True)
        )

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """The table with the errors added; mm and rad, by the names of the table's entries."""
        errors = np.array([values[p.name] for p in self.parameters])
        return replace(state, table=state.table + errors.reshape(state.table.shape[1:]))
