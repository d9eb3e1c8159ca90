"""The unknown smooth error of one joint: a curve over an input, learned from the residual of a fit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from calib.array_types import Array, IndexArray
from calib.dataset.further_columns import is_number
from calib.dataset.input_names import (
    CONDITIONS,
    HistoryInput,
    further_inputs,
    history_input,
    joint_input,
    summed_joints,
)
from calib.effects.effect import NaturalBound, Parameter, full_name
from calib.effects.state import RobotState
from calib.errors import FitError

LEARNED = "smooth_joint_error"
ALL_JOINTS = "all joints"  # what couplings run over
LAW_BOUNDS = (NaturalBound(3e-2, "rad", "a joint that errs by over 1.7 deg has another zero, sign or gear", 1.0),)


@dataclass(frozen=True, eq=False)
class CurveModes:
    """K error curves over an input u, each a sum of harmonics, scaled to unit size over the poses used for learning.

    f_k(u) = sum over n of W[2 i, k] sin(n phase) + W[2 i + 1, k] cos(n phase), phase = rate (u - start), u kept within
    [low, high]: a curve is bounded where nothing was measured.
    """

    input: str  # as `input_values` names it: q5, q2+q3, torque2, temperature_c, time_s, a further column
    orders: IndexArray  # (H,) n
    weights: Array  # (2 H, K)
    start: float = 0.0
    rate: float = 1.0
    low: float = -np.inf
    high: float = np.inf
    whole_rad: float = 0.0  # usual size of the whole curve, of which the modes are what the poses used show

    def phase(self, u: Array) -> Array:
        """Phase (N,), rad, of the harmonics at inputs (N,)."""
        return self.rate * (np.clip(u, self.low, self.high) - self.start)

    def at(self, u: Array) -> Array:
        """Values (N, K) of the curves at inputs (N,)."""
        return harmonics(self.phase(u), self.orders) @ self.weights

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the K curves."""
        return tuple(f"mode{k + 1}" for k in range(self.weights.shape[1]))


@dataclass(frozen=True, eq=False)
class CouplingModes:
    """K errors over the angles of the whole arm, each a sum of a sine and cosine of every input, of unit size.

    f_k = sum over i of W[2 i, k] sin(u_i) + W[2 i + 1, k] cos(u_i), u_i an angle, or the sum or difference of two.
    """

    inputs: tuple[str, ...]  # (I,) as `input_values` names them: q5, q2+q3
    weights: Array  # (2 I, K)

    @property
    def input(self) -> str:
        """What stands for all inputs."""
        return ALL_JOINTS

    def at_state(self, state: RobotState) -> Array:
        """Values (N, K) of the errors at the poses of a state."""
        angles = np.column_stack([input_values(state, name) for name in self.inputs])
        waves = np.stack([np.sin(angles), np.cos(angles)], axis=-1).reshape(len(angles), -1)
        return waves @ self.weights

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the K errors."""
        return tuple(f"mode{k + 1}" for k in range(self.weights.shape[1]))


@dataclass(frozen=True)
class FormulaTerm:
    """One term of a short formula over an input u: a harmonic, bump, kink, hinge, step, signed square, line or root.

    harmonic: a sin(n u) + b cos(n u); bump: h exp(-(u - u0)^2 / 2 w^2); kink: k abs(u - u0); hinge: k (u - u0) / w from
    u0 on; step: s from u0 on; square: c u abs(u), which a spring that stiffens makes of a torque; line: k (u - u0) / w;
    root: k sqrt(abs(u - u0) / w), of which w is a usual size of u, so that k is an angle.
    """

    kind: str
    order: int = 0  # n
    place: float = 0.0  # u0
    width: float = 0.0  # w

    def at(self, u: Array) -> Array:
        """Values of the term at inputs (N,): (N, 1), or (N, 2) for a harmonic's sine and cosine."""
        off = u - self.place
        if self.kind == "harmonic":
            return np.stack([np.sin(self.order * u), np.cos(self.order * u)], axis=1)
        columns: dict[str, Callable[[], Any]] = {
            "bump": lambda: np.exp(-0.5 * (off / max(self.width, 1e-300)) ** 2),
            "kink": lambda: np.abs(off),
            "hinge": lambda: np.maximum(off, 0.0) / self.width,
            "step": lambda: 1.0 * (off > 0.0),
            "square": lambda: u * np.abs(u),
            "line": lambda: off / self.width,
            "root": lambda: np.sqrt(np.abs(off) / self.width),
        }
        return np.asarray(columns[self.kind]())[:, None]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the term's parameters."""
        return (f"sin{self.order}", f"cos{self.order}") if self.kind == "harmonic" else (self.kind,)


@dataclass(frozen=True)
class FormulaModes:
    """Short formula over an input: a sum of terms, or such a sum times a factor, another input over its usual size."""

    input: str
    terms: tuple[FormulaTerm, ...]
    factor: str = ""  # an input's name; "" where nothing multiplies the sum
    factor_size: float = 1.0  # of that input, at which the sum counts as it is

    def at(self, u: Array) -> Array:
        """Values (N, K) of the formula's terms at inputs (N,), term by term."""
        return np.concatenate([term.at(u) for term in self.terms], axis=1)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the formula's K parameters, numbered where two would be the same."""
        plain = [name for term in self.terms for name in term.names]
        return tuple(
            name if plain.count(name) == 1 else f"{name}_{plain[: k + 1].count(name)}" for k, name in enumerate(plain)
        )


def harmonics(phase: Array, orders: IndexArray) -> Array:
    """Sine and cosine (N, 2 H) of H orders, side by side, at phases (N,)."""
    angle = phase[:, None] * orders
    return np.stack([np.sin(angle), np.cos(angle)], axis=-1).reshape(len(phase), -1)


@dataclass(frozen=True, eq=False)
class SmoothJointError:
    """Smooth error theta_j += f(u) of one joint, where f is a sum of modes supported by the data.

    The modes and their prior sigmas were chosen by evidence. It is added where no named effect explains as much, and it
    names no cause.
    """

    joint: int
    modes: CurveModes | FormulaModes | CouplingModes
    prior_sigma_rad: tuple[float, ...]  # (K,)
    name = LEARNED
    equation = "theta_j += f_j(q_j), f_j a smooth curve learned from the data"
    symbols = (("mode_k", "rad"),)
    needs = "no named effect that explains as much; joint angles over a good range"
    confirm = "one joint alone over its whole range in small steps: its curve comes back"
    linear = True
    held_by_prior = True  # more unknowns than the data would settle: their prior is part of the model

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters, one per mode: its rms over the training poses, rad (mm for a prismatic joint)."""
        prefix = "" if runs_over_own_angle(self) else f"{_identifier(inputs_named(self.modes))}_"
        return tuple(
            Parameter(f"{prefix}{name}_rad", "rad", sigma, f"{name} over {self.modes.input}")
            for name, sigma in zip(self.modes.names, self.prior_sigma_rad, strict=True)
        )

    @property
    def bounds(self) -> tuple[NaturalBound, ...]:
        """Natural bound of a law's size; none for a mode of a curve, of which many share an error."""
        return LAW_BOUNDS if isinstance(self.modes, FormulaModes) else ()

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """State with the joint's error added."""
        return state.add_joint_error(self.joint, self.joint_motions(state) @ np.array(list(values.values())))

    def joint_motions(self, state: RobotState) -> Array:
        """Error (N, K) of the joint at N poses by a unit of each parameter."""
        return motions_of(self.modes, state)

    def unseen_variance(self, state: RobotState) -> Array:
        """Variance (N,), rad^2, of what the curve does at N poses where none of those it was learned from shows it."""
        if not isinstance(self.modes, CurveModes):
            return np.zeros(len(state.poses))
        seen = np.sum((self.joint_motions(state) * np.array(self.prior_sigma_rad)) ** 2, axis=1)
        return np.maximum(self.modes.whole_rad**2 - seen, 0.0)


Modes = CurveModes | FormulaModes | CouplingModes


def motions_of(modes: Modes, state: RobotState) -> Array:
    """Motions (N, K) of a joint at the poses of a state by unit amounts of K modes, times their factor's values."""
    if isinstance(modes, CouplingModes):
        return modes.at_state(state)
    motions = modes.at(input_values(state, modes.input))
    if isinstance(modes, FormulaModes) and modes.factor:
        motions = motions * (input_values(state, modes.factor) / modes.factor_size)[:, None]
    return motions


def runs_over_own_angle(member: SmoothJointError) -> bool:
    """Whether a curve is one over its joint's own position and nothing else."""
    return member.modes.input == f"q{member.joint + 1}" and not factor_of(member.modes)


def is_law(member: SmoothJointError) -> bool:
    """Whether what was learned of a joint is a short formula, and not a curve of many modes."""
    return isinstance(member.modes, FormulaModes)


def factor_of(modes: Modes) -> str:
    """Name of the input that multiplies some modes; "" for none."""
    return modes.factor if isinstance(modes, FormulaModes) else ""


def inputs_named(modes: Modes) -> str:
    """Name of what some modes run over: "q3", or "torque3 x q3" where a factor multiplies them."""
    factor = factor_of(modes)
    return f"{factor} x {modes.input}" if factor else modes.input


def joints_of(members: Iterable[SmoothJointError]) -> tuple[int, ...]:
    """Joints that carry a curve, counted from 1."""
    return tuple(sorted({member.joint + 1 for member in members}))


def inputs_of(members: Iterable[SmoothJointError]) -> tuple[str, ...]:
    """Names of the inputs that learned curves depend on."""
    return tuple(dict.fromkeys(inputs_named(member.modes) for member in members))


def formula_text(members: Sequence[SmoothJointError], values: Mapping[str, float]) -> str | None:
    """Formulas of some learned curves with their fitted values; None where a curve has no formula."""
    lines = []
    for member in members:
        if not isinstance(member.modes, FormulaModes):
            return None
        lines.append(_formula_of(member, member.modes, values))
    return "; ".join(lines)


def _formula_of(member: SmoothJointError, modes: FormulaModes, values: Mapping[str, float]) -> str:
    fitted = iter(values[full_name(member, p)] for p in member.parameters)
    u = modes.input
    parts = []
    for term in modes.terms:
        if term.kind == "harmonic":
            parts += [f"{next(fitted):+.3g} sin({term.order} {u})", f"{next(fitted):+.3g} cos({term.order} {u})"]
            continue
        shape = {
            "bump": f"exp(-(({u} - {term.place:.3g}) / {term.width:.3g})^2 / 2)",
            "kink": f"abs({u} - {term.place:.3g})",
            "hinge": f"max({u} - {term.place:.3g}, 0) / {term.width:.3g}",
            "step": f"({u} > {term.place:.3g})",
            "square": f"{u} abs({u})",
            "line": f"({u} - {term.place:.3g}) / {term.width:.3g}" if term.place else f"{u} / {term.width:.3g}",
            "root": f"sqrt(abs({u} - {term.place:.3g}) / {term.width:.3g})",
        }[term.kind]
        parts.append(f"{next(fitted):+.3g} {shape}")
    total = " ".join(parts).removeprefix("+")
    if modes.factor:
        total = f"{modes.factor} / {modes.factor_size:.3g} ({total})"
    return f"theta{member.joint + 1} += {total} rad"


def input_values(state: RobotState, name: str) -> Array:
    """Values (N,) of a curve's input at the poses of a state.

    name: q5 (rad or mm), q2+q3, q2-q3, torque2 (Nm), an input of a joint's way (travel3, crept2_200s, see
    `calib.dataset.input_names`), temperature_c, time_s, payload_kg, or a further column of poses.csv.

    Raises FitError where the poses do not have it.
    """
    poses, of_joint, summed = state.poses, joint_input(name), summed_joints(name)
    if summed is not None:
        first, sign, second = summed
        return poses.q[:, first] + sign * poses.q[:, second]
    history = history_input(name)
    if history is not None:
        return _way_values(state, history)
    if of_joint is not None:
        quantity, joint = of_joint
        if quantity == "torque":
            of_all: Array | None = state.loaded.gravity_torques_nm
        else:
            of_all = poses.q if quantity == "q" else poses.approach
        values: Any = None if of_all is None else of_all[:, joint]
    elif name in CONDITIONS:
        values = getattr(poses, name)
    else:
        columns = further_inputs(poses)
        values = poses.extra.by_name[columns[name]] if name in columns else None
        if values is not None and not is_number(values):
            raise FitError(f"a learned curve runs over column {columns[name]!r}; found words there, numbers are needed")
    if values is None:
        raise FitError(f"a learned curve runs over {name}; give it for each pose, as poses.csv does")
    return np.asarray(values, dtype=float)


def _way_values(state: RobotState, history: HistoryInput) -> Array:
    """Values (N,) of an input of a joint's way; 0 at poses after all measured ones, such as targets of a correction.

    Every pose that was measured counts, in the order of measuring, used by the fit or not.
    """
    poses, joint = state.poses, history.joint
    if history.quantity == "travel":
        return poses.motion[:, joint]
    if history.quantity == "previous":
        return poses.came_from[:, joint]
    sequence = poses.sequence
    way = np.diff(sequence.q[:, joint], prepend=sequence.q[0, joint])
    if history.quantity == "travelled":
        return poses.from_sequence(np.cumsum(np.abs(way)))
    if history.quantity == "direction":
        last = np.maximum.accumulate(np.where(way != 0.0, np.arange(len(way)), 0))
        return poses.from_sequence(np.sign(way[last]))
    course = sequence.q[:, joint]
    if history.quantity == "crept":
        course = RobotState.nominal(state.robot, sequence).gravity_torques_nm[:, joint]
    if history.unit == "s":
        if sequence.time_s is None and not np.isfinite(poses.order).any():
            return np.zeros(len(poses))
        if sequence.time_s is None:
            raise FitError("a learned curve runs over what was before in time; give time_s for each pose")
        waited = np.diff(sequence.time_s)
    else:
        waited = np.ones(len(course) - 1)
    faded = faded_average(np.asarray(course), waited / history.reach)
    return poses.from_sequence(faded if history.quantity == "crept" else course - faded)


def faded_average(course: Array, waited: Array) -> Array:
    """Average (L,) of what a course (L,) was before, fading with time constant 1 over waits (L - 1,) between values.

    Each value holds from its own time to the next; the average starts from the first value.
    """
    average = [float(course[0])]
    for kept, value in zip(np.exp(-np.maximum(waited, 0.0)).tolist(), course[:-1].tolist(), strict=True):
        average.append(kept * average[-1] + (1.0 - kept) * value)
    return np.array(average)


def _identifier(name: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in name.replace("+", "_plus_").replace("-", "_minus_"))
