"""The tool that gives way to what it carries: an effect that competes where differences of a payload are explained."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from calib.effects.catalogue.loads import ToolSag
from calib.effects.effect import NaturalBound, Parameter
from calib.effects.state import RobotState


@dataclass(frozen=True)
class ToolSagUnderPayload(ToolSag):
    """A tool that gives way to what it carries: it moves by payload times R diag(c) R^T g."""

    equation = "target moves by payload R diag(c) R^T g"
    symbols = (("c", "mm/kg"),)
    needs = "payload_kg that varies"
    bounds = (NaturalBound(1.0, "mm/kg", "a tool that gives way so much is loose"),)
    under_load: ClassVar[bool] = True
    parameters = tuple(
        Parameter(f"{a}_mm_per_kg", "mm/kg", 0.02, f"sag under 1 kg with gravity along the tool's {a}") for a in "xyz"
    )

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """Robot state with the target displaced, by as much as each pose's payload."""
        payload_kg = state.poses.payload_kg
        if payload_kg is None:
            return state
        per_kg = dict(zip(("x_mm", "y_mm", "z_mm"), values.values(), strict=True))
        unloaded = replace(state, displacement_mm=np.zeros((1, 3)))
        sag_mm = super().apply(unloaded, **per_kg).displacement_mm
        return state.displace(payload_kg[:, None] * sag_mm)
