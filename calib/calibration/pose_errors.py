"""Errors of a calibration at each measured pose, with the inputs on which the errors may depend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib import frames
from calib.array_types import Array, BoolArray, IndexArray
from calib.calibration.evaluation import Evaluation, scanner_T_base_of_points
from calib.calibration.noise_level import NoiseLevel, noise_level
from calib.calibration.result import Calibration
from calib.dataset.dataset import Poses
from calib.dataset.further_columns import is_number
from calib.dataset.input_names import CONDITIONS, ORDER, PLACES, further_inputs
from calib.effects.gravity import loaded_joints
from calib.effects.state import RobotState
from calib.fitting.model import Model
from calib.fitting.observations import Observations, linearise_points, with_scanner_frames
from calib.frames import frames_by_name
from calib.kinematics.robot import Robot
from calib.lazy_modules import pd
from calib.statistics import chi2_ppf, group_means, group_sums


def inputs_at(robot: Robot, poses: Poses, state: RobotState) -> dict[str, Array]:
    """Values (N,) of every input that varies over the poses (angle, torque, time ...), by the input's name.

    Angles in rad, prismatic joints and places in mm (scanner frame), torques of gravity in N m, conditions in the unit
    that their name says. Texts of a column become numbers in the order of their first appearance. `state` is that
    of the arm at these poses.
    """
    inputs = {f"q{j + 1}": poses.q[:, j] for j in range(robot.n_joints)}
    if loaded := loaded_joints(robot):
        torques = state.gravity_torques_nm
        inputs |= {f"torque{j + 1}": torques[:, j] for j in loaded}
    for name in CONDITIONS:
        values = getattr(poses, name)
        if values is not None:
            inputs[name] = values
    if poses.approach is not None:
        inputs |= {f"approach{j + 1}": poses.approach[:, j] for j in range(robot.n_joints)}
    seen = state.seen
    if seen is not None:
        inputs |= {axis: seen.scanner_mm[:, k] for k, axis in enumerate(PLACES)}
    inputs[ORDER] = np.arange(len(poses), dtype=float)
    for name, of in further_inputs(poses).items():
        column = poses.extra.by_name[of]
        inputs[name] = column.astype(float) if is_number(column) else _order_of_appearance(column)
    return {name: v for name, v in inputs.items() if len(np.unique(v)) > 1}


def _order_of_appearance(texts: Array) -> Array:
    """Number (N,) of each text in the order in which they first appear, from 0."""
    first: dict[str, int] = {}
    return np.array([first.setdefault(text, len(first)) for text in texts.tolist()], dtype=float)


def directions_at(model: Model, x: Array, observed: Observations, base_to_residual: Array) -> list[Array]:
    """Derivative (M, C) of the whitened points by each joint's motion, per rad (per mm for a prismatic joint).

    A joint moves as its theta does (d for a prismatic joint); zeros where that parameter is fixed.

    Args:
        model: the fitted model.
        x: (P,) values of its parameters.
        observed: M points whose scanner is placed.
        base_to_residual: (M, C, 3), from a displacement in the base frame, mm, to the whitened residual.
    """
    by_x = linearise_points(model, x, observed)[1]
    names = [p.name for p in model.parameters]
    directions = []
    for j, joint in enumerate(model.robot.joints):
        kind = "theta" if joint.is_revolute else "d"
        name = f"{kind}{j + 1}"
        if name in names:
            column = by_x[:, :, [names.index(name)]]
            directions.append((base_to_residual @ column)[..., 0])
        else:
            directions.append(np.zeros(base_to_residual.shape[:2]))
    return directions


_RANKS = 4  # points to either side that a running median takes


@dataclass(frozen=True)
class PoseErrors:
    """Errors at N measured poses, in the dataset's order, of an arm with n joints.

    Test poses took no part in the fit. Noise levels are of the measurement alone: where test poses exceed them
    more often than training poses do, the model does not generalise.
    """

    pose_ids: tuple[str, ...]
    is_test: BoolArray  # (N,)
    error_mm: Array  # (N, 3) predicted minus measured, scanner frame, mean over a pose's points
    place_mm: Array  # (N, 3) where the point was measured, base frame as the model places it
    noise: NoiseLevel  # what one coordinate may be off by noise alone
    apparent_joint_error: Array  # (N, n) rad or mm: the motion of each joint alone that would best explain the error
    inputs: dict[str, Array]  # what the error may depend on, (N,) each: `calib.calibration.pose_errors`
    apparent_joint_noise: Array  # (N, n) sigma of `apparent_joint_error` by noise alone; nan where no motion shows

    @property
    def noise_mm(self) -> float:
        """Sigma per coordinate, mm, that noise alone causes."""
        return self.noise.sigma_mm

    @property
    def error_length_mm(self) -> Array:
        """Length (N,) of the 3D error, mm."""
        return np.linalg.norm(self.error_mm, axis=1)

    @property
    def length_noise_mm(self) -> float:
        """3D error, mm, that noise alone exceeds at one pose in twenty (chi of 3 degrees of freedom, 1 for lengths)."""
        return self.noise_mm * float(np.sqrt(chi2_ppf(0.95, self.noise.coordinates)))

    def joint_noise(self, joint: int) -> float:
        """Sigma of a joint's apparent error from noise alone, median over the poses, rad or mm; or nan."""
        noise = self.apparent_joint_noise[:, joint]
        return float(np.median(noise[np.isfinite(noise)])) if np.isfinite(noise).any() else float("nan")

    def to_frame(self) -> pd.DataFrame:
        """Table with one row per pose: role, errors, apparent joint errors (rad or mm), place, and every input."""
        columns: dict[str, object] = {"pose": self.pose_ids, "role": np.where(self.is_test, "test", "train")}
        columns |= {f"error_{axis}_mm": self.error_mm[:, k] for k, axis in enumerate("xyz")}
        columns["error_mm"] = self.error_length_mm
        columns |= {
            f"apparent_{j + 1}": self.apparent_joint_error[:, j] for j in range(self.apparent_joint_error.shape[1])
        }
        columns |= {f"base_{axis}_mm": self.place_mm[:, k] for k, axis in enumerate("xyz")}
        return pd.DataFrame(columns | self.inputs)

    def worst(self, count: int = 5) -> tuple[str, ...]:
        """Names of the poses with the largest errors, training or test."""
        order = np.argsort(-self.error_length_mm, kind="stable")
        return tuple(self.pose_ids[i] for i in order[:count])


def pose_errors_of(calibration: Calibration) -> PoseErrors:
    """Errors of a calibration at all measured poses."""
    return pose_errors_at(calibration, calibration.model, calibration.fit.x, calibration.after)


def pose_errors_at(calibration: Calibration, model: Model, x: Array, evaluation: Evaluation) -> PoseErrors:
    """Errors of a model with parameters x (P,) at all measured poses of a calibration's dataset.

    The apparent error of joint j at a pose is the least-squares motion of that joint alone, -d_j . e / |d_j|^2 with the
    whitened error e and the derivative d_j of the measured point by the joint. Joints are taken one at a time, so these
    errors do not add up.
    """
    dataset, level = calibration.dataset, noise_level(calibration)
    everything = Observations.of_all(dataset)
    trained = ~dataset.poses.is_test[everything.points.pose]
    if evaluation.is_outlier is not None:
        trained &= ~evaluation.is_outlier[everything.points.pose]
    observed = with_scanner_frames(everything, model, x, trained)
    poses, row = observed.used_poses
    scanner_T_base = frames_by_name(evaluation.scanner_T_base, observed.setup)
    whiten = observed.whiten
    error_mm = evaluation.error_mm
    raw = np.einsum("mij,mj->mi", whiten, error_mm)
    apparent = np.zeros((len(poses), model.robot.n_joints))
    noise = np.full_like(apparent, np.nan)
    for j, direction in enumerate(directions_at(model, x, observed, whiten @ scanner_T_base[:, :3, :3])):
        along = group_sums(np.sum(direction * raw, axis=1), row, len(poses))
        size = group_sums(np.sum(direction**2, axis=1), row, len(poses))
        # A joint whose axis passes close to the point moves it little: its apparent motion would be noise.
        usable = size > 1e-4 * max(float(size.max()), 1e-300)
        apparent[usable, j] = -along[usable] / size[usable]
        noise[usable & (size > 0.0), j] = level.ratio / np.sqrt(size[usable & (size > 0.0)])
    placed = scanner_T_base_of_points(evaluation, model, x, dataset)
    base_mm = frames.apply(frames.invert(placed), observed.points.xyz_mm)
    return PoseErrors(
        pose_ids=poses.ids,
        is_test=poses.is_test,
        error_mm=group_means(error_mm, row, len(poses)),
        place_mm=group_means(base_mm, row, len(poses)),
        noise=level,
        apparent_joint_error=apparent,
        inputs=inputs_at(model.robot, poses, model.state(x, poses, observed.seen(observed.first_target))),
        apparent_joint_noise=noise,
    )


def running_median(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Running median of y (N,) over x (N,), over up to `_RANKS` neighbours on either side.

    A gap in x separates two curves by a row of nan, and no median takes points from both sides. Fewer than three
    points between two gaps give no curve. Equal x give one value. Towards the ends the window shrinks symmetrically, so
    that a slope keeps its direction there.
    """
    across, values = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    known = np.isfinite(across) & np.isfinite(values)
    order = np.argsort(across[known], kind="stable")
    across, values = across[known][order], values[known][order]
    out: list[tuple[float, float]] = []
    for part in np.split(np.arange(len(across)), _gaps(across)):
        if len(part) < 3:
            continue
        if out:
            out.append((float("nan"), float("nan")))
        at, first, count = np.unique(across[part], return_index=True, return_counts=True)
        for place, start, ties in zip(at, first, count, strict=True):
            half = min(_RANKS, start, len(part) - start - ties)
            out.append((place, float(np.median(values[part[start - half : start + ties + half]]))))
    smooth = np.array(out).reshape(-1, 2)
    return smooth[:, 0], smooth[:, 1]


def _gaps(x: Array) -> IndexArray:
    """Indices of the first point after each gap in sorted x (N,).

    The largest step among N points spread evenly at random is about ln N / N of their range; half as much again is a
    gap. Up to four values are levels (of a temperature, a payload), and all between them is a gap.
    """
    steps = np.diff(x)
    levels = np.count_nonzero(steps) + 1
    share = 0.0 if levels <= 4 else float(np.clip(1.5 * np.log(levels) / levels, 0.05, 0.35))
    return np.flatnonzero(steps > share * np.sum(steps)) + 1
