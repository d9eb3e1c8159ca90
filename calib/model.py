"""The model: a robot, a list of effects, and the one bridge between parameter names and the solver's vector.

The vector x holds corrections, zero for the nominal robot. Parameters named in `fixed` stay at zero and are invisible
to the solver. Jacobians follow by the chain rule: d point / d table (analytic) x d table / d parameter (the effect's).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib import kinematics
from calib.dataset import Poses
from calib.effects.base import Array, Effect, Parameter, RobotState, table_derivative
from calib.effects.links import LinkErrors
from calib.errors import FitError
from calib.robot import Robot


@dataclass(frozen=True)
class Model:
    """A robot with effects. Build it with `geometric_model` for the five-parameter model alone."""

    robot: Robot
    effects: tuple[Effect, ...]
    fixed: frozenset[str] = frozenset()

    @cached_property
    def _all_parameters(self) -> tuple[Parameter, ...]:
        return tuple(p for effect in self.effects for p in effect.parameters)

    @cached_property
    def _is_free(self) -> NDArray[np.bool_]:
        return np.array([p.name not in self.fixed for p in self._all_parameters], dtype=bool)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """What the solver may move, in the order of x."""
        return tuple(p for p in self._all_parameters if p.name not in self.fixed)

    @property
    def scales(self) -> Array:
        """(P,) the size of each parameter in practice."""
        return np.array([p.scale for p in self.parameters])

    def hold(self, names: ArrayLike) -> Model:
        """The same model with further parameters held at zero. Raises FitError on an unknown name."""
        wanted = frozenset(str(name) for name in np.atleast_1d(np.asarray(names, dtype=str)))
        unknown = sorted(wanted - {p.name for p in self._all_parameters})
        if unknown:
            raise FitError(
                f"no parameter named {unknown[0]!r}; there are {self._all_parameters[0].name} ... "
                f"{self._all_parameters[-1].name}"
            )
        return replace(self, fixed=self.fixed | wanted)

    def _values_by_effect(self, x: ArrayLike) -> list[Array]:
        full = np.zeros(len(self._is_free))
        full[self._is_free] = np.asarray(x, dtype=float)
        ends = np.cumsum([len(effect.parameters) for effect in self.effects])
        return np.split(full, ends[:-1])

    def state(self, x: ArrayLike, poses: Poses) -> RobotState:
        """The chain's parameters at every pose, all effects applied in order."""
        state = RobotState.nominal(self.robot, poses)
        for effect, values in zip(self.effects, self._values_by_effect(x), strict=True):
            state = effect.apply(state, values)
        return state

    def predict(self, x: ArrayLike, poses: Poses, target: str = "jig") -> Array:
        """A target's place at every pose (N, 3), mm in the base frame."""
        state = self.state(x, poses)
        chain = kinematics.forward(state.table, poses.q, self.robot.is_revolute)
        return _target_mm(chain, state, target)

    def linearise(self, x: ArrayLike, poses: Poses, target: str = "jig") -> tuple[Array, Array]:
        """A target's place (N, 3) and its derivative by the free parameters (N, 3, P)."""
        state = self.state(x, poses)
        chain = kinematics.forward(state.table, poses.q, self.robot.is_revolute)
        points_mm = _target_mm(chain, state, target)
        by_table = kinematics.jacobian(chain, points_mm)  # (N, 3, n + 1, 5)
        if target != "jig":
            by_table[:, :, -1] = 0.0  # further targets do not ride on the tool row
        by_table = by_table.reshape(*by_table.shape[:2], -1)
        columns = [_columns(by_table, d) for d in self._table_derivatives(x, poses)]
        return points_mm, np.concatenate(columns, axis=-1)[..., self._is_free]

    def _table_derivatives(self, x: ArrayLike, poses: Poses) -> list[Array]:
        """For each effect d table / d its parameters (K, 1 or N, (n + 1) * 5).

        How a later effect changes with an earlier one's parameters is of second order and left out: the solver's
        residual is exact, so this costs it a little speed and no accuracy.
        """
        state = RobotState.nominal(self.robot, poses)
        out = []
        for effect, values in zip(self.effects, self._values_by_effect(x), strict=True):
            if isinstance(effect, LinkErrors):  # the identity: no need to difference it
                derivative = np.eye(state.table[0].size)[:, None]
            else:
                derivative = np.stack(
                    [d.reshape(len(d), -1) for d in table_derivative(effect, state, values)]
                )
            out.append(derivative)
            state = effect.apply(state, values)
        return out

    def calibrated_robot(self, x: ArrayLike) -> Robot:
        """The robot with its link errors built into the table; other effects have no place in robot.toml."""
        table = self.robot.table
        for effect, values in zip(self.effects, self._values_by_effect(x), strict=True):
            if isinstance(effect, LinkErrors):
                table = table + values.reshape(table.shape)
        return self.robot.with_table(table)


def geometric_model(robot: Robot) -> Model:
    """The five-parameter model: link errors and nothing else."""
    return Model(robot, (LinkErrors(robot),))


def _target_mm(chain: kinematics.Chain, state: RobotState, target: str) -> Array:
    if target == "jig":
        return chain.target_mm
    flange = chain.base_T_flange
    return flange[:, :3, :3] @ state.target_offsets_mm[target] + flange[:, :3, 3]


def _columns(by_table: Array, derivative: Array) -> Array:
    """(N, 3, T) x (K, 1 or N, T) -> (N, 3, K)."""
    if derivative.shape[1] == 1:
        return by_table @ derivative[:, 0].T
    return np.einsum("nit,knt->nik", by_table, derivative)
