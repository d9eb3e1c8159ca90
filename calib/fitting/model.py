"""Model of an arm: a robot with a list of effects; maps parameter names to the solver's vector, predicts points.

The vector x holds corrections, zero for the nominal robot. Parameters named in `fixed` stay at zero and are invisible
to the solver. Jacobians follow by the chain rule: d point / d state (analytic) x d state / d parameter (the effect's).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from calib import frames
from calib.array_types import Array, BoolArray
from calib.brief import Brief
from calib.dataset.dataset import Poses
from calib.effects.effect import (
    Effect,
    Parameter,
    Parameters,
    apply_values,
    corrects_robot,
    family_name,
    full_name,
    is_of_measuring,
    moves_one_joint,
    state_derivative,
)
from calib.effects.link_errors import LinkErrors, target_parameter_names
from calib.effects.state import RobotState, Seen, world_target, world_target_by_state, world_turn_by_state
from calib.errors import FitError
from calib.kinematics import chain as kinematics
from calib.kinematics.robot import TOOL_POINT, Robot


@dataclass(frozen=True)
class Model(Brief):
    """A robot with effects that predicts points from the solver's parameter vector."""

    robot: Robot
    effects: tuple[Effect, ...]
    fixed: frozenset[str] = frozenset()
    prior_sigmas: Mapping[str, float] = field(default_factory=dict)
    """Prior sigmas of parameters, by full name, in place of their usual scale."""
    loads_of: Robot | None = None
    """Robot at whose links gravity's loads are computed; None: at those of the state itself."""
    tool_found: Robot | None = None
    """The nominal robot with the tool point that was found, as the target "jig", where robot.toml's is far off."""
    prior_means: Mapping[str, float] = field(default_factory=dict)
    """Prior means of parameters, by full name; zero for all others."""
    of_arm_alone: bool = False
    """Whether effects of the instrument and of the target are left out of predictions, whatever their values."""
    _loaded: list[RobotState] = field(default_factory=list, init=False, compare=False, repr=False)

    @cached_property
    def _all_parameters(self) -> Parameters:
        return tuple(self._named(full_name(effect, p), p) for effect in self.effects for p in effect.parameters)

    def _named(self, name: str, parameter: Parameter) -> Parameter:
        mean = self.prior_means.get(name, 0.0)
        return replace(parameter, name=name, scale=self.prior_sigmas.get(name, parameter.scale), prior_mean=mean)

    @cached_property
    def _is_free(self) -> BoolArray:
        return np.array([p.name not in self.fixed for p in self._all_parameters], dtype=bool)

    @cached_property
    def parameters(self) -> Parameters:
        """Free parameters of the model, in the order of the solver's vector x."""
        return tuple(p for p in self._all_parameters if p.name not in self.fixed)

    @property
    def placed_robot(self) -> Robot:
        """Nominal robot with the found tool point, to which the scanner frames are fitted before a fit begins."""
        return self.robot if self.tool_found is None else self.tool_found

    def delivered(self, x: ArrayLike) -> Array:
        """Parameters (P,) of the arm as delivered: zero, except for a found tool point, which is taken from x."""
        own = None if self.tool_found is None else self.robot.own_tool_point
        names = () if own is None else target_parameter_names(own)
        is_place = np.array([p.name in names for p in self.parameters], dtype=bool)
        return np.where(is_place, np.asarray(x, dtype=float), 0.0)

    @property
    def at_tool(self) -> Model:
        """This model set to predict the tool point in the base frame, also where the arm carries the scanner.

        It is where the arm has the tool: what instrument and target did to the measurements is left out.
        """
        robot = replace(self.robot, carries_scanner=False) if self.robot.carries_scanner else self.robot
        return replace(self, robot=robot, of_arm_alone=True)

    @property
    def added_effects(self) -> tuple[Effect, ...]:
        """Effects of the model other than the corrections of robot.toml, in their order of addition."""
        return tuple(effect for effect in self.effects if not corrects_robot(effect))

    @property
    def geometry_names(self) -> tuple[str, ...]:
        """Names of the parameters that correct robot.toml: link errors and positions of measured targets."""
        return tuple(p.name for effect in self.effects if corrects_robot(effect) for p in effect.parameters)

    @property
    def family_names(self) -> tuple[str, ...]:
        """Names of the added effects (families), each once, in their order of addition."""
        return tuple(dict.fromkeys(family_name(effect) for effect in self.added_effects))

    @property
    def arm_family_names(self) -> tuple[str, ...]:
        """Names of the added effects that are of the arm or its load, each once: none of instrument or target."""
        of_arm = (effect for effect in self.added_effects if not is_of_measuring(effect))
        return tuple(dict.fromkeys(map(family_name, of_arm)))

    @property
    def scales(self) -> Array:
        """Prior sigma (P,) of each free parameter: its tolerance, or the usual size of the effect's parameter."""
        return np.array([p.scale for p in self.parameters])

    @property
    def means(self) -> Array:
        """Prior mean (P,) of each free parameter."""
        return np.array([p.prior_mean for p in self.parameters])

    def _acts(self, effect: Effect) -> bool:
        return not (self.of_arm_alone and is_of_measuring(effect))

    def with_fixed(self, names: ArrayLike) -> Model:
        """This model with further parameters fixed at zero. Raises FitError on an unknown name."""
        asked = frozenset(str(name) for name in np.atleast_1d(np.asarray(names, dtype=str)))
        unknown = sorted(asked - {p.name for p in self._all_parameters})
        if unknown:
            raise FitError(
                f"no parameter named {unknown[0]!r}; there are {self._all_parameters[0].name} ... "
                f"{self._all_parameters[-1].name}"
            )
        return replace(self, fixed=self.fixed | asked)

    def values_by_effect(self, x: ArrayLike) -> list[Array]:
        """Parameter values of each effect, with zeros for fixed parameters."""
        full = np.zeros(len(self._is_free))
        full[self._is_free] = np.asarray(x, dtype=float)
        ends = np.cumsum([len(effect.parameters) for effect in self.effects])
        return np.split(full, ends[:-1])

    def with_loads_at(self, x: ArrayLike) -> Model:
        """This model with gravity loads computed once, for the links with corrections x.

        Otherwise the loads would depend on the link errors, and the derivatives by these would need a further term.
        """
        return replace(self, loads_of=self.calibrated_robot(x))

    def _start(self, poses: Poses, seen: Seen | None) -> RobotState:
        start = RobotState.nominal(self.robot, poses, seen)
        if self.loads_of is None:
            return start
        loaded = self._loaded[0] if self._loaded else None
        if loaded is None or loaded.poses is not poses:  # a fit asks for the same poses again and again
            loaded = RobotState.nominal(self.loads_of, poses)
            self._loaded[:] = [loaded]
        return start.with_loads_at(loaded)

    def _states(self, x: ArrayLike, poses: Poses, seen: Seen | None) -> list[RobotState]:
        """Robot states before each effect is applied, in order, and after the last effect."""
        states = [self._start(poses, seen)]
        for effect, values in zip(self.effects, self.values_by_effect(x), strict=True):
            states.append(apply_values(effect, states[-1], values) if self._acts(effect) else states[-1])
        return states

    def state(self, x: ArrayLike, poses: Poses, seen: Seen | None = None) -> RobotState:
        """Robot state at every pose with all effects applied in order."""
        return self._states(x, poses, seen)[-1]

    def predict(self, x: ArrayLike, poses: Poses, target: str = "jig", seen: Seen | None = None) -> Array:
        """Position of a target at every pose (N, 3), mm: base frame, or flange's frame where that carries the scanner.

        With `seen`, errors of the scanner are included.
        """
        return place_of_target(self.state(x, poses, seen), target)

    def linearise(
        self, x: ArrayLike, poses: Poses, target: str = "jig", seen: Seen | None = None
    ) -> tuple[Array, Array]:
        """Position of a target (N, 3), mm in the base frame, and its derivative by the free parameters (N, 3, P).

        A dependence of a later effect on an earlier one's parameters is neglected; the catalogue's effects have none
        once the loads are computed at given links (`with_loads_at`).
        """
        *before, last = self._states(x, poses, seen)
        points_mm, by_state = point_by_state(last, target)
        return points_mm, self._by_parameters(x, before, by_state)

    def linearise_pose(self, x: ArrayLike, poses: Poses, seen: Seen | None = None) -> tuple[Array, Array, Array]:
        """Position of the jig (N, 3), mm, orientation base_R_tool (N, 3, 3), and their derivative (N, 6, P).

        The last three rows are the small turn about the base's axes, rad: base_R_tool becomes exp(turn) base_R_tool.
        """
        *before, last = self._states(x, poses, seen)
        points_mm, by_state = point_by_state(last)
        both = np.concatenate([by_state, turn_by_state(last)], axis=1)
        return points_mm, last.attitude, self._by_parameters(x, before, both)

    def _by_parameters(self, x: ArrayLike, before: list[RobotState], by_state: Array) -> Array:
        """Derivative (N, K, P) by the free parameters, from the derivative (N, K, S) by the state (chain rule)."""
        columns = [
            effect_columns(by_state, effect, state, values)
            if self._acts(effect)
            else np.zeros((*by_state.shape[:2], len(values)))
            for effect, state, values in zip(self.effects, before, self.values_by_effect(x), strict=True)
        ]
        return np.concatenate(columns, axis=-1)[..., self._is_free]

    def calibrated_robot(self, x: ArrayLike) -> Robot:
        """The robot with its link errors and target offsets at x; other effects cannot be written to robot.toml."""
        robot = self.robot
        for effect, values in zip(self.effects, self.values_by_effect(x), strict=True):
            if corrects_robot(effect):
                robot = effect.corrected(robot, values)
        return robot

    def _brief(self) -> str:
        effects = ", ".join(self.family_names) or "none"
        return f"{self.robot.name}: {len(self.parameters)} free parameters, effects: {effects}"


def geometric_model(robot: Robot) -> Model:
    """The five-parameter model of a robot: link errors alone."""
    return Model(robot, (LinkErrors(robot),))


def point_by_state(state: RobotState, target: str = "jig") -> tuple[Array, Array]:
    """Position of a target (N, 3), mm, and its analytic derivative by `state.vector` (N, 3, S)."""
    if state.robot.carries_scanner:
        return world_target_by_state(state, target)
    chain_mm = target_in_chain(state, target)
    if _is_row_end(state, target):
        by_table = kinematics.point_jacobian(state.chain, chain_mm)  # (N, 3, n + 1, 5)
    else:  # fixed to a link, not to the tool row
        by_table = kinematics.link_point_jacobian(state.chain, chain_mm, state.robot.target(target).joint)
    by_table = by_table.reshape(*by_table.shape[:2], -1)
    turned_mm = state.place(chain_mm) - state.displacement_mm
    by_turn = -frames.skew(turned_mm)
    if np.any(state.base_rotvec_rad):
        by_table = frames.rotation_from_rotvec(state.base_rotvec_rad) @ by_table
        # d exp(w) p / dw = -skew(exp(w) p) J(w), and J = 1 + skew(w) / 2 for the small turns that bases make
        by_turn = by_turn @ (np.eye(3) + 0.5 * frames.skew(state.base_rotvec_rad))
    eye = np.broadcast_to(np.eye(3), (len(chain_mm), 3, 3))
    still = np.zeros_like(eye)  # a turn of the target about its own point moves no point
    offsets = [_by_offset(state, name) if name == target else still for name in state.target_offsets_mm]
    return turned_mm + state.displacement_mm, np.concatenate([by_table, by_turn, eye, still, *offsets], axis=-1)


def _by_offset(state: RobotState, target: str) -> Array:
    """Derivative (N, 3, 3) of a further target's position by its coordinates in its link's frame."""
    turn = state.chain.base_T_link(state.robot.target(target).joint)[:, :3, :3]
    if np.any(state.base_rotvec_rad):
        turn = frames.rotation_from_rotvec(state.base_rotvec_rad) @ turn
    return turn


def turn_by_state(state: RobotState) -> Array:
    """Derivative (N, 3, S), rad, of the tool's rotation (the world's, for a scanner on the flange) by the state."""
    if state.robot.carries_scanner:
        return world_turn_by_state(state)
    by_table = kinematics.turn_jacobian(state.chain)
    by_table = by_table.reshape(*by_table.shape[:2], -1)
    eye = np.broadcast_to(np.eye(3), (len(by_table), 3, 3))
    by_base, by_target = eye, eye
    if np.any(state.base_rotvec_rad):
        by_table = frames.rotation_from_rotvec(state.base_rotvec_rad) @ by_table
        by_base = eye @ (np.eye(3) + 0.5 * frames.skew(state.base_rotvec_rad))  # as in `point_by_state`
    if np.any(state.target_rotvec_rad):
        turned = frames.rotation_from_rotvec(state.target_rotvec_rad)
        by_table, by_base = turned @ by_table, turned @ by_base
        by_target = eye @ (np.eye(3) + 0.5 * frames.skew(state.target_rotvec_rad))
    offsets = [np.zeros_like(eye) for _ in state.target_offsets_mm]
    return np.concatenate([by_table, by_base, np.zeros_like(eye), by_target, *offsets], axis=-1)


def place_of_target(state: RobotState, target: str = "jig") -> Array:
    """Position of a target (N, 3), mm in the base frame, or in the flange's where that carries the scanner."""
    return world_target(state, target) if state.robot.carries_scanner else state.place(target_in_chain(state, target))


def target_in_chain(state: RobotState, target: str) -> Array:
    """Position of a target on the arm (N, 3), mm, before the base's turn and the displacement (`RobotState.place`)."""
    if _is_row_end(state, target):
        return state.chain.target_mm
    link = state.chain.base_T_link(state.robot.target(target).joint)
    return link[:, :3, :3] @ state.target_offsets_mm[target] + link[:, :3, 3]


def _is_row_end(state: RobotState, target: str) -> bool:
    """Whether a target is the end of the tool's row, not an independent point."""
    return target == TOOL_POINT and target not in state.target_offsets_mm


def effect_columns(by_state: Array, effect: Effect, state: RobotState, values: Array) -> Array:
    """Derivative (N, 3, K) of a target's position by an effect's parameters, at the state before the effect.

    by_state  # (N, 3, S), derivative of the point by the state, from `point_by_state`
    """
    if isinstance(effect, LinkErrors):  # the table comes first in the state's vector
        return by_state[..., : len(values)]
    if moves_one_joint(effect):
        entry = state.entry_of_joint(effect.joint)
        return by_state[..., entry, None] * effect.joint_motions(state)[:, None, :]
    out = np.empty((*by_state.shape[:2], len(values)))
    for k, derivative in enumerate(state_derivative(effect, state, values)):
        touched = np.flatnonzero(derivative.any(axis=0))  # a few entries of the state's vector
        out[..., k] = np.sum(by_state[..., touched] * derivative[:, None, touched], axis=-1)
    return out
