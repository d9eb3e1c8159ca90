"""Compensation: joint targets with which the real arm goes where the nominal arm was commanded to.

Robot controllers compute with their own table and cannot load another. So the targets are corrected: for each nominal
joint vector q0 find q near it with F(q) = F0(q0), where F0 is the nominal and F the calibrated forward
map of the measured point and the tool's axes, effects included (`calib.kinematics.inverse`). Redundant arms move the
least.

A correction is no finer than the fit. Measured points determine the last joint's axis, but not how the tool is turned
behind it: where the attitude's sigma (`calib.compensation.attitude`) is not smaller than the turn that a correction
would make, only the position is met, and the free motion balances the remaining turn, by its sigma, against the joints'
motion, by their tolerance. A pose near a singular posture may take large turns of the wrist for a small turn of the
tool: there the attitude is met to its sigma.

Joints stay inside a box: their limits and a largest change from q0, six tolerances of an angle or twice the joint's own
zero error. A target that needs more is not reached.

Targets count as later than all that was measured: an effect that sets in at a pose, or settles in time, is taken as
after the last pose, and no joint is still moving.

Limits: with an unknown scanner frame, link errors that only move or turn the base (d1, theta1, beta1) cannot be
identified and stay nominal, so corrected targets are right relative to each other, up to one motion of the base common
to all. A scanner on the flange sees neither the tool nor errors of the last row: they stay nominal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from calib import frames
from calib.array_types import Array, BoolArray
from calib.blas_threads import one_blas_thread
from calib.compensation.attitude import FitKnowledge
from calib.compensation.correction import Correction, Corrects
from calib.compensation.tool_problem import ToolProblem
from calib.dataset.dataset import Poses
from calib.dataset.input_names import CONDITIONS
from calib.dataset.signals import has_stand_in
from calib.effects.effect import family_name
from calib.effects.link_errors import TOLERANCE_RAD
from calib.errors import CalibError, FitError
from calib.fitting.model import Model, geometric_model
from calib.kinematics import chain as kinematics
from calib.kinematics.cartesian import require_links
from calib.kinematics.inverse import solve_inverse
from calib.kinematics.joint_range import joint_limits
from calib.kinematics.robot import PARAMETER_KINDS, Robot
from calib.options import CORRECTION_KINDS

POSITION_TOLERANCE_MM = 1e-9
ORIENTATION_TOLERANCE_RAD = 1e-12
MAX_CHANGE_RAD, MAX_CHANGE_MM = 6.0 * TOLERANCE_RAD * (1.0 - 1e-9), 50.0
"""Largest change of a joint: 3 deg, less what rounding in degrees may add, or 3 deg at 1 m."""
_ZEROS = 2.0  # largest change in multiples of the joint's own zero error, where that is more
_TURN_WEIGHTS = (10.0, 5.0, 3.0, 2.0, 1.0, 0.5, 0.0)
"""Weights of the tool's turn against the joints' motion, tried one after another."""
_MOST_OF_BOX = 0.9  # share of the box beyond which a motion is large, and the next weight is tried
MOST_RAD = 4.0 * np.pi  # two turns: joint values beyond that are degrees
_KNOWN = 0.5  # share of a correction's turn below which a sigma makes the turn known
_SINGULAR = 0.02
"""Smallest over largest singular value of the Jacobian, below which a posture is near singular."""


@one_blas_thread()
def correction_of(
    nominal: Robot,
    calibrated: Corrects | Robot | Model,
    q_nominal: ArrayLike,
    *,
    x: ArrayLike | None = None,
    conditions: Poses | None = None,
    kind: str | None = None,
    known: FitKnowledge | None = None,
    ids: Sequence[str] | None = None,
) -> Correction:
    """Joint vectors that give the calibrated arm the nominal arm's tool frame: see `calib.corrected_joints`."""
    if isinstance(calibrated, Corrects):
        if x is not None or known is not None:
            raise FitError(f"a {type(calibrated).__name__} has its own parameters; leave out x and known")
        return calibrated.correct(q_nominal, conditions, kind, nominal, ids)
    model, x = _model(calibrated, x)
    q0 = np.array(q_nominal, dtype=float)
    _check(nominal, model, q0, conditions)
    if kind not in (None, *CORRECTION_KINDS):
        raise FitError(f"cannot correct {kind!r}; there are {' and '.join(CORRECTION_KINDS)}")
    conditions = plain_poses(q0) if conditions is None else replace(conditions, q=q0).measured_later()
    chain = kinematics.nominal_chain(nominal, q0)
    goal = chain.base_T_frame[:, -1]
    measured = nominal.own_tool_point is not None and model.robot.own_tool_point is not None
    if measured:
        goal = frames.make_transform(goal[:, :3, :3], kinematics.tool_points(nominal, chain))
    problem = ToolProblem(model, x, conditions, goal, False, measured)
    uncorrected_mm, uncorrected_rad = problem.errors(q0)
    sigma_rad = None if known is None or not len(q0) else known.attitude_sigma_rad(model, x, conditions)
    kind = kind or _known_kind(nominal, sigma_rad, uncorrected_rad)
    problem = replace(problem, with_orientation=kind == "pose")
    box = _box(nominal, model, x, q0)
    q = solve_inverse(problem, q0, *box) if kind == "pose" else _at_positions(problem, q0, box)
    reached = _reached(problem, q)
    if sigma_rad is not None and kind == "pose":
        q, reached = _with_known_attitude(problem, q0, q, box, sigma_rad, reached)
    error_mm, turn_rad = problem.errors(q)
    everyone = np.arange(len(q))
    spectrum = np.linalg.svd(problem.linearise(q, everyone)[1], compute_uv=False)
    singular = spectrum[:, -1] < _SINGULAR * spectrum[:, 0]
    reasons = []
    for i in everyone:
        missed = f"{error_mm[i]:.3g} mm" + (f" and {turn_rad[i]:.3g} rad" if kind == "pose" else "")
        words = _reason(nominal, q[i], q0[i], (box[0][i], box[1][i]), missed, bool(singular[i]))
        reasons.append("" if reached[i] else words)
    trained = None if known is None else known.trained
    names = [f"target {i + 1}" for i in everyone] if ids is None else ids
    return Correction(
        robot=nominal,
        kind=kind,
        q_nominal=q0,
        q=q,
        reached=reached,
        position_error_mm=error_mm,
        orientation_error_rad=turn_rad if kind == "pose" else np.full(len(q), np.nan),
        uncorrected_mm=uncorrected_mm,
        uncorrected_rad=uncorrected_rad,
        reasons=tuple(reasons),
        changed=tuple(dict.fromkeys(family_name(e) for e in model.added_effects if getattr(e, "changes_arm", False))),
        attitude_sigma_rad=sigma_rad,
        is_outside=None if trained is None else trained.outside(nominal, q0),
        outside_words="" if trained is None else trained.words(nominal, q0, names),
        sigma_mm=None if known is None or not len(q) else known.position_sigma_mm(model, x, replace(conditions, q=q)),
    )


def _known_kind(nominal: Robot, sigma_rad: Array | None, uncorrected_rad: Array) -> str:
    """Part of the tool frame to correct: "pose" if the fit supports attitudes too, else "position"."""
    if nominal.n_joints < 6:
        return "position"
    if sigma_rad is None:
        return "pose"
    return "pose" if np.mean(sigma_rad**2) < _KNOWN**2 * np.mean(uncorrected_rad**2) else "position"


def _at_positions(problem: ToolProblem, q0: Array, box: tuple[Array, Array]) -> Array:
    """Joint vectors (N, n) that meet the positions; a redundant arm also turns the tool towards its goal.

    A turn of the tool counts so much more than a motion of the joints as keeps these small: near a singular posture a
    small turn would take a large motion, and counts less and less.
    """
    q, open_ = q0.copy(), np.arange(len(q0))
    for weight in _TURN_WEIGHTS:
        if not len(open_):
            break
        part = problem.of(open_)
        low, high = box[0][open_], box[1][open_]
        q[open_] = solve_inverse(part, q0[open_], low, high, prefer=part.attitude_left(weight))
        room = _MOST_OF_BOX * np.maximum(high - q0[open_], q0[open_] - low)
        open_ = open_[~_reached(part, q[open_]) | (np.abs(q[open_] - q0[open_]) > room).any(axis=1)]
    return q


def _with_known_attitude(
    problem: ToolProblem, q0: Array, q: Array, box: tuple[Array, Array], sigma_rad: Array, reached: BoolArray
) -> tuple[Array, BoolArray]:
    """Joint vectors and mask of reached targets; near singularities an attitude within its sigma counts as met."""
    near = _at_positions(replace(problem, with_orientation=False), q0, box)
    error_mm, turn_rad = problem.errors(near)
    met = ~reached & (error_mm <= POSITION_TOLERANCE_MM) & (turn_rad <= sigma_rad)
    return np.where(met[:, None], near, q), reached | met


def _reached(problem: ToolProblem, q: Array) -> BoolArray:
    error_mm, turn_rad = problem.errors(q)
    reached = error_mm <= POSITION_TOLERANCE_MM
    return np.asarray(reached & (turn_rad <= ORIENTATION_TOLERANCE_RAD) if problem.with_orientation else reached)


def _box(nominal: Robot, model: Model, x: Array, q0: Array) -> tuple[Array, Array]:
    """Lower and upper bounds of the joints for a correction: joint limits, and the largest allowed change."""
    off = np.abs(model.calibrated_robot(x).table - nominal.table)[:-1]
    zero = np.where(nominal.is_revolute, off[:, PARAMETER_KINDS.index("theta")], off[:, PARAMETER_KINDS.index("d")])
    change = np.maximum(np.where(nominal.is_revolute, MAX_CHANGE_RAD, MAX_CHANGE_MM), _ZEROS * zero)
    limits = joint_limits(nominal)
    return np.clip(q0 - change, *limits), np.clip(q0 + change, *limits)


def needed_columns(model: Model, x: ArrayLike, poses: Poses) -> tuple[str, ...]:
    """Names of the columns of poses.csv, besides the joints, on which the tool's position or orientation depends.

    A column is needed where the model at x predicts another tool frame without it, or cannot predict. Targets count as
    later than all that was measured. Measured torques and link encoders have laws in their place.
    """
    poses = poses.measured_later()
    n = poses.q.shape[1]
    without: dict[tuple[str, ...], Poses] = {}
    for name in CONDITIONS:
        if getattr(poses, name) is not None:
            without[(name,)] = replace(poses, **{name: None})  # type: ignore[arg-type]
    if poses.approach is not None:
        without[tuple(f"approach{k + 1}" for k in range(n))] = replace(poses, approach=None)
    for name in (name for name in poses.extra.names if not has_stand_in(model.robot, name)):
        without[(name,)] = replace(poses, extra=poses.extra.without(name))
    model = model.at_tool
    there = _tool_frames(model, x, poses)
    needed: list[str] = []
    for columns, fewer in without.items():
        try:
            same = np.array_equal(_tool_frames(model, x, fewer), there)
        except CalibError:  # an effect that cannot do without the column
            same = False
        needed += [] if same else columns
    return tuple(needed)


def _tool_frames(model: Model, x: ArrayLike, poses: Poses) -> Array:
    """Orientation and position of the tool (N, 3, 4), base frame."""
    state = model.state(x, poses)
    return np.concatenate([state.attitude, state.place(state.chain.target_mm)[..., None]], axis=2)


def _model(calibrated: Robot | Model, x: ArrayLike | None) -> tuple[Model, Array]:
    if isinstance(calibrated, Robot):
        if x is not None:
            raise FitError("a calibrated robot has its parameters built in; leave x out, or give the model")
        model = geometric_model(calibrated).at_tool
        return model, np.zeros(len(model.parameters))
    if x is None or np.shape(x) != (len(calibrated.parameters),):
        found = "none" if x is None else f"shape {np.shape(x)}"
        raise FitError(f"a model needs its {len(calibrated.parameters)} fitted parameters x; found {found}")
    return calibrated.at_tool, np.asarray(x, dtype=float)


def require_joint_vectors(robot: Robot, q: Array, conditions: Poses | None) -> None:
    """Raise FitError unless q (N, n) are joint vectors of a robot in rad, and conditions, if any, as many."""
    if q.ndim != 2 or q.shape[1] != robot.n_joints:
        raise FitError(f"joint vectors for {robot.name} have shape (N, {robot.n_joints}), found {q.shape}")
    if conditions is not None and len(conditions) != len(q):
        raise FitError(f"found conditions of {len(conditions)} poses for {len(q)} joint vectors")
    far = np.argwhere(robot.is_revolute & (np.abs(q) > MOST_RAD))
    if len(far):
        row, joint = far[0]
        raise FitError(
            f"joint vector {row + 1} turns joint {joint + 1} by {q[row, joint]:.4g} rad, more than two turns: were "
            "these degrees? Give radians (np.radians)"
        )


def _check(nominal: Robot, model: Model, q: Array, conditions: Poses | None) -> None:
    require_links(nominal, "a correction of targets")
    require_joint_vectors(nominal, q, conditions)
    bad = np.flatnonzero(~np.all(np.isfinite(q), axis=1))
    if len(bad):
        raise FitError(f"joint vector {bad[0] + 1} of {len(q)} is not finite; correct or remove it")
    if not np.array_equal(nominal.is_revolute, model.robot.is_revolute):
        raise FitError(
            f"the nominal arm has {nominal.n_joints} joints, the calibrated one {model.robot.n_joints}, or their kinds "
            "differ; both must be the same arm"
        )


def plain_poses(q: Array) -> Poses:
    """Poses at joint vectors q (N, n), without conditions."""
    n = len(q)
    return Poses(tuple(map(str, range(n))), np.full(n, "train"), q, np.full(n, ""), ("",) * n).measured_later()


def _reason(robot: Robot, q: Array, q_nominal: Array, box: tuple[Array, Array], missed: str, singular: bool) -> str:
    """Text with the reason why a target is not reached."""
    held = []
    for k in np.flatnonzero((q <= box[0]) | (q >= box[1])):
        joint = robot.joints[k]
        name = joint.name or f"joint {k + 1}"
        scale, unit = (np.degrees(1.0), "°") if joint.is_revolute else (1.0, " mm")
        if q[k] in (joint.min, joint.max):
            held.append(f"{name} stands at its limit of {scale * q[k]:.6g}{unit}")
        else:
            held.append(f"{name} would have to change by more than {scale * abs(q[k] - q_nominal[k]):.4g}{unit}")
    if singular:
        held.append("the posture is near singular")
    return f"missed by {missed}: {', '.join(held) or 'out of reach'}"
