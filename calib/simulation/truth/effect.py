"""Base class of the effects on a simulated cell: changes of the arm, or of the points that the scanner reports."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.simulation.truth.mechanism import Arm, Conditions


@dataclass(frozen=True, eq=False)
class TrueEffect:
    """A physical effect on the arm, or on the points that the scanner reports; no change at magnitude zero.

    `magnitude_fields` names the fields that are proportional to the effect; all others describe where or how it acts.
    """

    name: ClassVar[str]
    magnitude_fields: ClassVar[tuple[str, ...]]
    needs_equilibrium: ClassVar[bool] = False  # on the arm under load, not on the command alone

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        """The arm with this effect, by the torques and positions of `equilibrium`, the arm under all effects."""
        return arm

    def change_measurement(self, scanner_T_target: Array, conditions: Conditions, sign: float) -> Array:
        """Tool frame (N, 4, 4) as reported under this effect; the jig's apex points along `sign` times its z axis."""
        return scanner_T_target

    def scaled(self, factor: float) -> TrueEffect:
        """Effect that is `factor` times as large."""
        return replace(self, **{name: factor * getattr(self, name) for name in self.magnitude_fields})

    @property
    def is_absent(self) -> bool:
        """Whether the effect's magnitude is zero."""
        return not any(np.any(getattr(self, name)) for name in self.magnitude_fields)

    def parameters(self) -> dict[str, Any]:
        """All fields as plain numbers, for truth.json."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: np.asarray(value).tolist() for name, value in values.items()}


def needed(value: Array | None, column: str, effect: TrueEffect) -> Array:
    """Values of a condition that an effect requires. Raises CalibError where they are missing."""
    if value is None:
        raise CalibError(f"{effect.name} needs {column} at every pose; simulate with conditions")
    return value
