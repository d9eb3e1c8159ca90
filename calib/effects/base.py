"""What an effect is: named parameters with units, and one pure function from the robot's state to the robot's state.

Calibration is a list of effects with unknown parameters, simulation the same list with known ones. Every effect obeys
one law: **zero means absent**. At zero parameters `apply` returns the state bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.dataset import Poses
from calib.robot import PARAMETER_KINDS, Robot

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Parameter:
    """One unknown number. `scale` is its size in practice: the prior's sigma and the solver's unit for it."""

    name: str
    unit: str
    scale: float
    doc: str = ""
    nominal: float = 0.0  # what is reported is nominal + the fitted value


@dataclass(frozen=True)
class RobotState:
    """Where each parameter of the chain stands at each of N poses, before the forward pass.

    `table` (1 or N, n + 1, 5) rows a, alpha, d, theta, beta; its leading axis stays 1 until something depends on the
    pose. `target_offsets_mm`: places of the further targets in the last joint's frame, each (3,).
    """

    robot: Robot
    poses: Poses
    table: Array
    target_offsets_mm: Mapping[str, Array] = field(default_factory=dict)

    @classmethod
    def nominal(cls, robot: Robot, poses: Poses) -> RobotState:
        offsets = {target.name: np.array(target.xyz_mm) for target in robot.targets}
        return cls(robot, poses, robot.table[None], offsets)

    @property
    def q_rad(self) -> Array:
        """(N, n) joint positions as commanded; mm for prismatic joints."""
        return self.poses.q

    def add_link_error(self, frame: int, kind: str, error: ArrayLike) -> RobotState:
        """Add to one entry of the table: a scalar for all poses, or (N,) one a pose."""
        error = np.atleast_1d(np.asarray(error, dtype=float))  # (1 or N,)
        rows = max(len(self.table), len(error))
        table = np.repeat(self.table, rows, axis=0) if len(self.table) < rows else self.table.copy()
        table[:, frame, PARAMETER_KINDS.index(kind)] += error
        return replace(self, table=table)

    def add_joint_error(self, joint: int, error: ArrayLike) -> RobotState:
        """Add to where a joint stands: rad, or mm for a prismatic joint; a scalar or (N,)."""
        kind = "theta" if self.robot.joints[joint].is_revolute else "d"
        return self.add_link_error(joint, kind, error)


@runtime_checkable
class Effect(Protocol):
    """The contract. `apply` takes one value for each of `parameters`, by position in `values`."""

    @property
    def name(self) -> str:
        """The family's name, as the command line takes it."""
        ...

    @property
    def parameters(self) -> Sequence[Parameter]: ...

    def apply(self, state: RobotState, values: Array) -> RobotState: ...


def table_derivative(effect: Effect, state: RobotState, values: Array) -> list[Array]:
    """d table / d value for each parameter of an effect, applied to `state`: a list of (1 or N, n + 1, 5).

    Central differences of the effect's own map, which is cheap; the chain's part of the derivative is analytic.
    Steps are 1e-3 of a parameter's scale: exact to rounding for maps that are linear in their parameters.
    """
    out = []
    for k, parameter in enumerate(effect.parameters):
        step = np.zeros(len(values))
        step[k] = 1e-3 * parameter.scale
        high, low = effect.apply(state, values + step).table, effect.apply(state, values - step).table
        out.append((high - low) / (2.0 * step[k]))
    return out
