"""Compensation: joint targets with which the real arm goes where the nominal arm was commanded to.

Robot controllers compute with their own table and cannot load another. So the targets are corrected: for each nominal
joint vector q0 find q near it with F(q) = F0(q0), where F0 is the nominal and F the calibrated forward
map, effects included (`calib.kinematics.inverse`). Redundant arms move the least.

Joints stay inside a box: their limits and a largest change from q0. Near a singular posture a small error would need a
large turn of the wrist.

Targets come after all that was measured: an effect that sets in at a pose, or settles in time, is taken as after the
last pose, and no joint is still on its way.

Limits: with an unknown scanner frame, link errors that only move or turn the base (d1, theta1, beta1) cannot be
identified and stay nominal, so corrected targets are right relative to each other, up to one motion of the base common
to all. Measured points do not depend on the tool's turn about its own point: a corrected orientation is as accurate as
the fit's last joint frame. A scanner on the flange sees neither the tool nor errors of the last row: they stay nominal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from calib import frames
from calib.array_types import Array, BoolArray
from calib.blas_threads import one_blas_thread
from calib.compensation.tool_problem import ToolProblem
from calib.dataset.dataset import Poses
from calib.effects.effect import family_name
from calib.errors import CalibError, FitError
from calib.fitting.model import Model, geometric_model
from calib.kinematics import chain as kinematics
from calib.kinematics.inverse import solve_inverse
from calib.kinematics.robot import Robot
from calib.options import CORRECTION_KINDS

POSITION_TOLERANCE_MM = 1e-9
ORIENTATION_TOLERANCE_RAD = 1e-12
MAX_CHANGE_RAD, MAX_CHANGE_MM = np.radians(15.0), 100.0  # of a joint, from its nominal value
_SINGULAR = (
    0.02  # smallest over largest singular value of the Jacobian, below which a posture is near singular
)


@dataclass(frozen=True)
class Correction:
    """Corrected joint vectors of N targets. Errors are of the calibrated arm against the nominal arm's tool frame."""

    robot: Robot  # nominal
    what: str  # "position" or "pose"
    q_nominal: Array  # (N, n) rad, mm for prismatic joints
    q: Array  # (N, n) corrected; where `reached` is false, the nearest that limits allow
    reached: BoolArray  # (N,) to 1e-9 mm, and 1e-12 rad where the orientation counts
    position_error_mm: Array  # (N,) with q
    orientation_error_rad: Array  # (N,) with q; nan where only the position counts
    uncorrected_mm: Array  # (N,) position error with q_nominal
    reasons: tuple[str, ...]  # (N,) why a target is not reached, as text; "" where it is
    changed: tuple[
        str, ...
    ] = ()  # effects that changed the arm as it was measured: it is taken as it was in the end

    @property
    def change(self) -> Array:
        """(N, n) q - q_nominal: rad, mm for prismatic joints."""
        return self.q - self.q_nominal

    def summary(self, ids: Sequence[str] | None = None) -> str:
        """As text, with the targets' names where they have any."""
        if len(self.q) == 0:
            return "no target"
        turning = self.robot.is_revolute
        largest = [
            f"{np.degrees(np.abs(self.change[:, turning]).max()):.3g} deg" if turning.any() else "",
            f"{np.abs(self.change[:, ~turning]).max():.3g} mm" if not turning.all() else "",
        ]
        lines = [
            f"{int(self.reached.sum())} of {len(self.q)} targets reached ({self.what}); without correction the arm "
            f"misses them by {self.uncorrected_mm.mean():.3g} mm on average, {self.uncorrected_mm.max():.3g} mm at "
            f"most; largest change of a joint {' and '.join(filter(None, largest))}"
        ]
        if self.changed:
            lines.append(
                f"the arm is taken as it is after the last measured pose ({', '.join(self.changed)})"
            )
        missed = np.flatnonzero(~self.reached)
        names = ids or [f"target {i + 1}" for i in range(len(self.q))]
        lines += [f"{names[i]}: {self.reasons[i]}" for i in missed[:20]]
        if len(missed) > 20:
            lines.append(f"and {len(missed) - 20} more")
        return "\n".join(lines)

    def to_frame(self) -> pd.DataFrame:
        """One row a target: reached, errors before and after, and why not."""
        return pd.DataFrame(
            {
                "reached": self.reached,
                "uncorrected_mm": self.uncorrected_mm,
                "position_error_mm": self.position_error_mm,
                "orientation_error_rad": self.orientation_error_rad,
                "reason": self.reasons,
            }
        )


@one_blas_thread()
def corrected_joints(
    nominal: Robot,
    calibrated: Robot | Model,
    q_nominal: ArrayLike,
    *,
    x: ArrayLike | None = None,
    conditions: Poses | None = None,
    what: str | None = None,
) -> Correction:
    """Joint vectors that give the calibrated arm the tool frame that the nominal arm has with `q_nominal`.

    Args:
        nominal: the robot that the controller computes with; its joint limits hold.
        calibrated: the fitted robot, or a model, whose effects are then part of the calibrated arm.
        q_nominal: (N, n) rad, mm for prismatic joints.
        x: (P,) the model's fitted parameters; needed with a model.
        conditions: payload, temperature ... of each target, for effects that depend on them; its own q is not used.
        what: "pose" (position and orientation of the tool frame) or "position" alone; where None, a pose for six
            joints and more.

    Raises:
        FitError: joint vectors of the wrong shape or not finite, arms that differ in their joints, or a model
            without x.
    """
    model, x = _model(calibrated, x)
    q0 = np.array(q_nominal, dtype=float)
    _check(nominal, model, q0, conditions)
    if what is None:
        what = "pose" if nominal.n_joints >= 6 else "position"
    if what not in CORRECTION_KINDS:
        raise FitError(f"cannot correct {what!r}; there are {' and '.join(CORRECTION_KINDS)}")
    conditions = plain_poses(q0) if conditions is None else replace(conditions, q=q0).measured_later()
    first = nominal.base_T_first
    goal = kinematics.forward(nominal.table, q0, nominal.is_revolute, first).base_T_frame[:, -1]
    if model.tool_found is not None:  # its row may be turned to reach the point: that turns no tool
        found = model.tool_found.table
        turned = kinematics.forward(found, q0, nominal.is_revolute, first).base_T_frame[:, -1]
        goal = frames.make_transform(turned[:, :3, :3], goal[:, :3, 3])
    problem = ToolProblem(model, x, conditions, goal, what == "pose")
    change = np.where(nominal.is_revolute, MAX_CHANGE_RAD, MAX_CHANGE_MM)
    limits = _limits(nominal)
    low, high = np.clip(q0 - change, *limits), np.clip(q0 + change, *limits)
    q = solve_inverse(problem, q0, low, high)
    error_mm, turn_rad = problem.errors(q)
    reached = error_mm <= POSITION_TOLERANCE_MM
    if problem.with_orientation:
        reached &= turn_rad <= ORIENTATION_TOLERANCE_RAD
    everyone = np.arange(len(q))
    spectrum = np.linalg.svd(problem.linearise(q, everyone)[1], compute_uv=False)
    singular = spectrum[:, -1] < _SINGULAR * spectrum[:, 0]
    reasons = []
    for i in everyone:
        missed = f"{error_mm[i]:.3g} mm" + (f" and {turn_rad[i]:.3g} rad" if what == "pose" else "")
        words = _reason(nominal, q[i], q0[i], (low[i], high[i]), missed, bool(singular[i]))
        reasons.append("" if reached[i] else words)
    return Correction(
        robot=nominal,
        what=what,
        q_nominal=q0,
        q=q,
        reached=reached,
        position_error_mm=error_mm,
        orientation_error_rad=turn_rad,
        uncorrected_mm=problem.errors(q0)[0],
        reasons=tuple(reasons),
        changed=tuple(
            dict.fromkeys(family_name(e) for e in model.added_effects if getattr(e, "changes_arm", False))
        ),
    )


def needed_columns(model: Model, x: ArrayLike, poses: Poses) -> tuple[str, ...]:
    """Columns of poses.csv beside the joints' that the tool's position or orientation depends on, by their names there.

    A column is needed where the model at x predicts another tool frame without it, or cannot predict. Targets are later
    than all that was measured.
    """
    poses = poses.measured_later()
    n = poses.q.shape[1]
    without: dict[tuple[str, ...], Poses] = {}
    if poses.payload_kg is not None:
        without[("payload_kg",)] = replace(poses, payload_kg=None)
    if poses.temperature_c is not None:
        without[("temperature_c",)] = replace(poses, temperature_c=None)
    if poses.time_s is not None:
        without[("time_s",)] = replace(poses, time_s=None)
    if poses.approach is not None:
        without[tuple(f"approach{k + 1}" for k in range(n))] = replace(poses, approach=None)
    for name in poses.extra.columns:
        without[(str(name),)] = replace(poses, extra=poses.extra.drop(columns=name))
    model = model.at_tool
    there = _tool_frames(model, x, poses)
    needed: list[str] = []
    for columns, fewer in without.items():
        try:
            same = np.array_equal(_tool_frames(model, x, fewer), there)
        except CalibError:  # of an effect that cannot do without
            same = False
        needed += [] if same else columns
    return tuple(needed)


def _tool_frames(model: Model, x: ArrayLike, poses: Poses) -> Array:
    """(N, 3, 4) orientation and position of the tool."""
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


def _check(nominal: Robot, model: Model, q: Array, conditions: Poses | None) -> None:
    if q.ndim != 2 or q.shape[1] != nominal.n_joints:
        raise FitError(
            f"joint vectors for {nominal.name} have shape (N, {nominal.n_joints}), found {q.shape}"
        )
    bad = np.flatnonzero(~np.all(np.isfinite(q), axis=1))
    if len(bad):
        raise FitError(f"joint vector {bad[0] + 1} of {len(q)} is not finite; correct or remove it")
    if not np.array_equal(nominal.is_revolute, model.robot.is_revolute):
        raise FitError(
            f"the nominal arm has {nominal.n_joints} joints, the calibrated one {model.robot.n_joints}, or their kinds "
            "differ; both must be the same arm"
        )
    if conditions is not None and len(conditions) != len(q):
        raise FitError(f"found conditions of {len(conditions)} targets for {len(q)} joint vectors")


def _limits(robot: Robot) -> tuple[Array, Array]:
    low = np.array([-np.inf if joint.min is None else joint.min for joint in robot.joints])
    high = np.array([np.inf if joint.max is None else joint.max for joint in robot.joints])
    return low, high


def plain_poses(q: Array) -> Poses:
    """Poses at joint vectors q (N, n) of which nothing else is known."""
    n = len(q)
    return Poses(
        tuple(map(str, range(n))), np.full(n, "train"), q, np.full(n, ""), ("",) * n
    ).measured_later()


def _reason(
    robot: Robot, q: Array, q_nominal: Array, box: tuple[Array, Array], missed: str, singular: bool
) -> str:
    """Why a target is not reached, as text; `box` has its own lower and upper bounds (n,)."""
    held = []
    for k in np.flatnonzero((q <= box[0]) | (q >= box[1])):
        joint = robot.joints[k]
        name = joint.name or f"joint {k + 1}"
        scale, unit = (np.degrees(1.0), "deg") if joint.is_revolute else (1.0, "mm")
        if q[k] in (joint.min, joint.max):
            held.append(f"{name} stands at its limit of {scale * q[k]:.6g} {unit}")
        else:
            held.append(
                f"{name} would have to change by more than {scale * abs(q[k] - q_nominal[k]):.4g} {unit}"
            )
    if singular:
        held.append("the posture is near singular")
    return f"missed by {missed}: {', '.join(held) or 'out of reach'}"
