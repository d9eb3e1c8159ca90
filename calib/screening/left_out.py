"""Errors at poses that a fit did not use: test poses, and training poses left out one by one (linearised)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.calibration.evaluation import Evaluation, evaluate_all
from calib.calibration.result import Calibration
from calib.errors import FitError
from calib.screening.projected_residual import ProjectedResidual, project_residual
from calib.statistics import axis_variances, group_means, left_out_by, rms

_FAR, _VERY_FAR = 1.5, 3.0  # times the largest error of a training pose left out
_FEWEST_FAR, _FEW = 3, 0.15  # test poses that are far off, in number and as a share of them: fewer are single poses
_BY_CHANCE = 0.001
_ALONE = 1e-6  # of 1, by which the leverage of a pose that alone determines a direction may be less


def left_out_errors_mm(
    projected: ProjectedResidual, columns: Array | None = None, spread: Array | None = None
) -> Array:
    """Error (R,), mm, of each coordinate when its pose is predicted from all other poses (linearised).

    e_i = (1 - H_ii)^-1 r_i for each pose's block of the hat matrix H of fitted directions and candidate; exact for a
    linear model with fixed sizes of the candidate's coefficients.

    Args:
        projected: residual of a fit.
        columns: (R, K) of a candidate, projected and whitened; None for the fit as it is.
        spread: (K,) prior sigmas of its coefficients.
    """
    residual = projected.residual
    shrunk = np.zeros((len(residual), 0)) if columns is None or spread is None else columns * spread
    nuisance = projected.nuisance
    if nuisance is not None:  # back to where each row is of one pose, with the nuisance as further columns
        uncertain = nuisance.directions * nuisance.sizes
        residual = nuisance.coloured(residual)
        shrunk = np.concatenate([uncertain, nuisance.coloured(shrunk)], axis=1)
    inner = np.linalg.inv(np.eye(shrunk.shape[1]) + shrunk.T @ shrunk)
    rest = residual - shrunk @ (inner @ (shrunk.T @ residual))
    observed = projected.residuals.observed
    sigma_mm = np.sqrt(axis_variances(observed.covariance_mm2))
    coordinates = projected.coordinates
    order = np.argsort(observed.points.pose, kind="stable")
    counts = np.unique(observed.points.pose, return_counts=True)[1]
    starts = np.cumsum(counts) - counts
    out = np.empty(len(residual))
    for count in np.unique(counts):  # all poses with this many points at once
        points = order[starts[counts == count][:, None] + np.arange(count)]  # (poses, count)
        rows = (coordinates * points[:, :, None] + np.arange(coordinates)).reshape(len(points), -1)
        fitted, extra = projected.basis[rows], shrunk[rows]
        hat = fitted @ np.swapaxes(fitted, 1, 2) + extra @ inner @ np.swapaxes(extra, 1, 2)
        error = np.linalg.solve(left_out_by(hat), rest[rows][..., None])[..., 0]
        out[rows] = error * np.repeat(sigma_mm[points], coordinates, axis=1)
    return out


def cross_validated_rmse_mm(
    projected: ProjectedResidual, columns: Array | None = None, spread: Array | None = None
) -> float:
    """RMS error per coordinate, mm, when each pose is predicted from all others (`left_out_errors_mm`)."""
    return rms(left_out_errors_mm(projected, columns, spread))


def far_test_poses(calibration: Calibration) -> tuple[str, ...]:
    """Test poses (ids) that are far more off than any training pose left out, the furthest first; () where few are.

    Far is three times as much, or half as much again where so many cannot be chance: if test poses are like training
    poses, all orders of their errors are about equally likely, so that the k largest of all are those of test poses
    with the probability of k draws without replacement. Nothing is assumed of the noise, nor that the fit determines
    every parameter. Poses count from three and a share of `_FEW` on.
    """
    try:
        projected = project_residual(calibration)
    except FitError:
        return ()
    after, points = _as_fitted(calibration), projected.residuals.observed.points
    errors_mm = left_out_errors_mm(projected).reshape(-1, projected.coordinates)
    left_out = _pose_means(np.sum(errors_mm**2, axis=1), points.pose)
    judged = after.is_tested[after.pose]
    tested = np.unique(after.pose[judged])
    squared = _pose_means(np.sum(after.error_mm[judged] ** 2, axis=1), after.pose[judged])
    order = np.argsort(-squared)
    most = left_out.max(initial=0.0)
    far, very_far = (int(np.count_nonzero(squared > times**2 * most)) for times in (_FAR, _VERY_FAR))
    drawn = np.arange(far)
    by_chance = float(np.prod((len(tested) - drawn) / (len(tested) + len(left_out) - drawn)))
    if by_chance > _BY_CHANCE:
        far = very_far
    if far < _FEWEST_FAR or far <= _FEW * len(tested):
        return ()
    return tuple(calibration.dataset.poses.ids[tested[k]] for k in order[:far])


@dataclass(frozen=True)
class LeftOutGain:
    """Gain of one fit over another at poses that neither used: test poses, and training poses left out one by one."""

    share: float  # by which the RMS error of all of them falls
    standard_errors: float  # of the mean fall of the squared error; above 0 where it falls


def left_out_gain(before: Calibration, after: Calibration) -> LeftOutGain | None:
    """Gain of one fit over another at left-out poses; None where too few equations are left.

    A pose that alone determines a parameter of the later fit, as a first pose its history, cannot be left out of it.
    """
    try:
        of_both = [_as_fitted(fit) for fit in (before, after)]
        judged = of_both[1].is_tested
        squared = [_squared_errors(fit, of, judged) for fit, of in zip((before, after), of_both, strict=True)]
        alone = _determines_alone(project_residual(after))
    except FitError:
        return None
    if len(squared[0]) != len(squared[1]):  # of other poses: a robust fit left out some
        return None
    kept = np.concatenate([~alone, np.ones(len(squared[0]) - len(alone), dtype=bool)])
    squared = [errors[kept] for errors in squared]
    fall = squared[0] - squared[1]
    error = float(fall.std(ddof=1) / np.sqrt(len(fall)))
    share = 1.0 - float(np.sqrt(squared[1].sum() / max(squared[0].sum(), 1e-300)))
    return LeftOutGain(share, float(fall.mean()) / max(error, 1e-300))


def _determines_alone(projected: ProjectedResidual) -> BoolArray:
    """Mask (K,) of the training poses without which the fit would leave a direction undetermined."""
    pose = projected.residuals.observed.points.pose
    blocks = [
        projected.basis.reshape(len(pose), projected.coordinates, -1)[pose == one].reshape(-1, projected.basis.shape[1])
        for one in np.unique(pose)
    ]
    return np.array([np.linalg.norm(block, 2) ** 2 > 1.0 - _ALONE for block in blocks])


def _squared_errors(calibration: Calibration, after: Evaluation, judged: BoolArray) -> Array:
    """Squared 3D error (K,), mm^2, at each training pose left out, then at each test pose, averaged over its points.

    Args:
        calibration: a fit.
        after: its errors at the points as it took them.
        judged: (N,) the test poses.
    """
    projected = project_residual(calibration)
    squared = np.sum(left_out_errors_mm(projected).reshape(-1, projected.coordinates) ** 2, axis=1)
    test = judged[after.pose]
    of_test = np.sum(after.error_mm[test] ** 2, axis=1)
    points = projected.residuals.observed.points
    return np.concatenate([_pose_means(squared, points.pose), _pose_means(of_test, after.pose[test])])


def _as_fitted(calibration: Calibration) -> Evaluation:
    """Errors of a fit at the points as it took them: where it took the means of repeats, test poses have theirs too."""
    if calibration.averaged is None:
        return calibration.after
    return evaluate_all(calibration.model, [calibration.fit.x], calibration.averaged, calibration.outliers)[0]


def _pose_means(values: Array, pose: IndexArray) -> Array:
    """Mean of values by measured point over the points of each pose that has points."""
    poses, row = np.unique(pose, return_inverse=True)
    return group_means(values, row, len(poses))
