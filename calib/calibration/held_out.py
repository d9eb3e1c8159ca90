"""Chi-squared test of the test poses' errors against the covariance that a fit predicts for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray, IndexArray
from calib.calibration.promise import NEW_PLACE
from calib.calibration.result import Calibration, declared_sigma_mm
from calib.calibration.uncertainty import JointKnowledge
from calib.dataset.repeats import SIGMA_DOUBT
from calib.effects.catalogue.order_steps import in_gap_of_steps
from calib.fitting.discrepancy import Discrepancy
from calib.fitting.observations import Observations, linearise_points
from calib.fitting.scanner_frame import orthonormal, whitened_motion
from calib.statistics import chi2_sf, covariance_root, f_sf

BY_CHANCE = 0.001
"""p, below which the test poses are off by more than was promised."""
_LEAST_POSES = 4
_GROSS = 8.0  # times the promise, in the mean over a pose's coordinates: so far off is a mistake of measuring
_MOST_GROSS = (3, 0.2)  # poses, and share of the test poses, that may be so; more are something else


@dataclass(frozen=True)
class HeldOutTest:
    """Result of the test whether noise and the fit's uncertainty explain the errors at the test poses."""

    poses: int  # that were tested
    rmse_mm: float  # 3D, of their points
    promised_mm: float  # 3D RMSE that was to be expected
    ratio: float  # root mean square of the errors in units of their covariance; 1 where the promise is kept
    p_value: float  # of a ratio so far above 1.25 by chance, without the pose that is off the most
    alone: tuple[str, ...] = ()  # ids of the few poses that are grossly off, where all others are as promised

    @property
    def is_broken(self) -> bool:
        """Whether the errors exceed their predicted covariance significantly, even without the worst pose."""
        return self.p_value < BY_CHANCE

    @property
    def shows_the_model_wrong(self) -> bool:
        """Whether the promise is broken by more than a few gross errors of measurement."""
        return self.is_broken and not self.alone


@dataclass(frozen=True)
class _Rows:
    """Whitened errors of test points, and a root of their covariance from uncertain parameters and frames."""

    error: Array  # (R,)
    root: Array  # (R, K)
    unit_mm: Array  # (R,) length of one unit of the errors
    pose: IndexArray  # (R,)
    spent: int  # rows that frames of setups without training poses took

    def square_and_dof(self, chosen: BoolArray) -> tuple[float, float]:
        """Chi-squared statistic e^T (1 + L L^T)^-1 e of chosen points' errors, and its degrees of freedom."""
        error, root = self.error[chosen], self.root[chosen]
        along = root.T @ error
        inner = np.linalg.solve(np.eye(root.shape[1]) + root.T @ root, along)
        return float(error @ error - along @ inner), len(error) * (1.0 - self.spent / len(self.error))


def held_out_test(
    calibration: Calibration, noise_mm: float, noise_from: str, discrepancy: Discrepancy | None = None
) -> HeldOutTest | None:
    """Chi-squared test of the test poses' errors; None with fewer than four test poses.

    With e the errors and L a root of their covariance by uncertain parameters and frames, all in units of the noise,
    e^T (1 + L L^T)^-1 e follows chi^2 with as many degrees of freedom as there are rows. As the error of one parameter
    shows at every pose, the poses are tested jointly. Repeats of a pose count once, by their mean. A setup without
    training poses has its frame from its own points, which costs up to six rows. Test poses between the last training
    pose before a step and the first one after it are left out, as no fit can tell on which side of the step they are.

    Args:
        calibration: a fit, with its errors at the test poses.
        noise_mm: sigma of a coordinate.
        noise_from: source of that sigma, "repeats", "dataset" or "fit". Each is taken as accurate to 25 %; the fit's
            own has its degrees of freedom in addition.
        discrepancy: what the model is known to miss (`calib.calibration.promise`), which then counts as noise; None to
            test against noise and the fit's uncertainty alone.
    """
    dataset, fit = calibration.fitted_dataset, calibration.fit
    noise = dataset.noise if calibration.options.noise is None else calibration.options.noise
    if dataset.points is None or not noise_mm > 0.0 or fit.undetermined.any():
        return None
    if noise is not None and noise.wander is not None:  # then errors of poses measured together are alike
        return None
    tested = dataset.poses.is_test & ~in_gap_of_steps(calibration.model.added_effects, dataset.poses)
    poses = np.unique(dataset.points.pose[tested[dataset.points.pose]])
    if len(poses) < _LEAST_POSES:
        return None
    observed = replace(Observations.of(dataset, tested), scanner_T_base=calibration.after.scanner_T_base)
    rows = _whitened(calibration, observed, noise_mm, discrepancy)
    everything = np.ones(len(rows.error), dtype=bool)
    square, dof = rows.square_and_dof(everything)
    by_pose = {pose: float(np.mean(rows.error[rows.pose == pose] ** 2)) for pose in poses}

    def p_without(left_out: Sequence[int]) -> float:
        less, less_dof = rows.square_and_dof(~np.isin(rows.pose, left_out))
        doubted = less / SIGMA_DOUBT**2
        if noise_from == "fit":
            return f_sf(doubted / less_dof, less_dof, max(fit.degrees_of_freedom, 1.0))
        return chi2_sf(doubted, less_dof)

    worst_first = sorted(by_pose, key=lambda pose: -by_pose[pose])
    p_value = p_without(worst_first[:1])
    gross = [pose for pose in worst_first if by_pose[pose] > _GROSS**2][: _MOST_GROSS[0]]
    alone = gross if len(gross) <= _MOST_GROSS[1] * len(poses) and p_without(gross) >= BY_CHANCE else []
    points = len(observed.points)
    variance = rows.unit_mm**2 * (1.0 + np.sum(rows.root**2, axis=1))
    return HeldOutTest(
        poses=len(poses),
        rmse_mm=float(np.sqrt(np.sum((rows.unit_mm * rows.error) ** 2) / points)),
        promised_mm=float(np.sqrt(np.sum(variance) / points)),
        ratio=float(np.sqrt(square / dof)),
        p_value=p_value,
        alone=tuple(dataset.poses.ids[pose] for pose in sorted(alone)),
    )


def _whitened(
    calibration: Calibration, observed: Observations, noise_mm: float, discrepancy: Discrepancy | None
) -> _Rows:
    """Errors of observed points in units of the noise, and a root of their covariance from the fit's uncertainty.

    With a discrepancy the noise includes it, and errors in a setup without training poses are those of a new place.
    """
    model, fit, after = calibration.model, calibration.fit, calibration.after
    parameters_root = covariance_root(fit.covariance)
    covariance_mm2 = observed.covariance_mm2 * (noise_mm / declared_sigma_mm(calibration.fitted_dataset)) ** 2
    missed_mm2 = np.zeros(len(observed.points))
    if discrepancy is not None:
        missed_mm2 = discrepancy.variance_mm2(observed.poses.q)[observed.points.pose]
    whiten = replace(observed, covariance_mm2=covariance_mm2 + missed_mm2[:, None, None] * np.eye(3)).whiten
    coordinates = whiten.shape[1]
    unit_mm = np.sqrt(noise_mm**2 + missed_mm2)
    new_place = 1.0 if discrepancy is None else NEW_PLACE
    at_mm, by_x = linearise_points(model, fit.x, observed)
    trained = set(map(str, Observations.of(calibration.fitted_dataset).setup))
    count = len(observed.points)
    error = np.empty((count, coordinates))
    root = np.empty((count, coordinates, len(fit.x)))
    own: list[Array] = []
    spent = 0
    for setup, rows in observed.rows_of_setups().items():
        scanner_T_base = after.scanner_T_base[setup]
        seen_mm = frames.apply(scanner_T_base, at_mm[rows])
        missed = np.einsum("mij,mj->mi", whiten[rows], seen_mm - observed.points.xyz_mm[rows])
        columns = whiten[rows] @ scanner_T_base[:3, :3] @ by_x[rows]
        if setup in trained:
            known = JointKnowledge.of(calibration, setup)
            motion = whitened_motion(seen_mm, known.centre_mm, whiten[rows])
            columns = columns + motion @ known.follows
            block = np.zeros((count, coordinates, known.frame_root.shape[1]))
            block[rows] = motion @ known.frame_root
            own.append(block.reshape(coordinates * count, -1))
        else:
            motion = whitened_motion(seen_mm, seen_mm.mean(axis=0), whiten[rows])
            motion = motion * (not observed.frame_is_known(rows))
            basis = orthonormal(motion.reshape(coordinates * len(rows), 6))
            spent += basis.shape[1]
            flat = columns.reshape(coordinates * len(rows), -1)
            columns = (flat - basis @ (basis.T @ flat)).reshape(columns.shape)
            missed = (missed.ravel() - basis @ (basis.T @ missed.ravel())).reshape(missed.shape) / new_place
            unit_mm[rows] *= new_place
        error[rows], root[rows] = missed, columns
    stacked = root.reshape(coordinates * count, -1) @ parameters_root
    columns = np.concatenate([stacked, *own], axis=1)
    unit_mm, pose = (np.repeat(of_point, coordinates) for of_point in (unit_mm, observed.points.pose))
    return _Rows(error.ravel(), columns, unit_mm, pose, spent)
