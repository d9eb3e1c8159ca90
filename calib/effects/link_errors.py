"""Corrections of robot.toml, which every calibration starts with: errors of the links and of targets' positions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.effects.effect import Parameter, Parameters
from calib.effects.state import RobotState
from calib.kinematics.robot import LENGTH_KINDS, PARAMETER_KINDS, Robot, Target

TOLERANCE_MM = 1.0
"""Manufacturing tolerance of a length, the default prior's sigma."""
TOLERANCE_RAD = math.radians(0.5)
"""Manufacturing tolerance of an angle, the default prior's sigma."""


@dataclass(frozen=True)
class LinkErrors(Brief):
    """Errors of every a, alpha, d, theta and beta of a robot's table (Jang 2025 eq 3), constant over the poses.

    `tolerances` gives single parameters, by name, another tolerance than the two defaults; mm or rad.
    """

    robot: Robot
    tolerances: Mapping[str, float] = field(default_factory=dict)
    name = "link_errors"
    linear = True
    corrects_robot = True

    @cached_property
    def parameters(self) -> Parameters:
        """Errors of the table's entries: a1 alpha1 d1 theta1 beta1 ... betaTCP."""
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
        """Robot state with the errors added to its table; values in mm and rad, by the names of the table's entries."""
        errors = np.array([values[p.name] for p in self.parameters])
        return replace(state, table=state.table + errors.reshape(state.table.shape[1:]))

    def corrected(self, robot: Robot, values: Array) -> Robot:
        """Robot with the errors added to its table."""
        return robot.with_table(robot.table + values.reshape(robot.table.shape))

    def _brief(self) -> str:
        return f"{len(self.parameters)} parameters of {self.robot.name}"


@dataclass(frozen=True)
class TargetOffsets:
    """Errors of the positions of further targets on the tool, along x, y and z of their link's frame, mm.

    `tolerances` gives single offsets, by name, another tolerance than their target's.
    """

    targets: tuple[Target, ...]
    tolerances: Mapping[str, float] = field(default_factory=dict)
    name = "target_offsets"
    linear = True
    corrects_robot = True

    @cached_property
    def parameters(self) -> Parameters:
        """Errors of each target's coordinates: smr2.x smr2.y smr2.z ..."""
        return tuple(
            Parameter(
                name,
                unit="mm",
                scale=self.tolerances.get(name, target.tolerance_mm),
                doc=f"{name[-1]} of target {target.name}",
                nominal=float(value),
            )
            for target in self.targets
            for name, value in zip(target_parameter_names(target), target.xyz_mm, strict=True)
        )

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """Robot state with the targets moved; values in mm, by the parameters' names."""
        moved = {
            target.name: state.target_offsets_mm[target.name]
            + np.array([values[name] for name in target_parameter_names(target)])
            for target in self.targets
        }
        return replace(state, target_offsets_mm={**state.target_offsets_mm, **moved})

    def corrected(self, robot: Robot, values: Array) -> Robot:
        """Robot with the offsets added to its targets' positions."""
        offset_mm = dict(zip((target.name for target in self.targets), values.reshape(-1, 3), strict=True))

        def moved(target: Target) -> Target:
            if target.name not in offset_mm:
                return target
            x, y, z = (np.array(target.xyz_mm) + offset_mm[target.name]).tolist()
            return replace(target, xyz_mm=(x, y, z))

        return replace(robot, targets=tuple(map(moved, robot.targets)))


def target_parameter_names(target: Target) -> tuple[str, ...]:
    """Names of a target's coordinates as parameters: smr2.x smr2.y smr2.z."""
    return tuple(f"{target.name}.{axis}" for axis in "xyz")
