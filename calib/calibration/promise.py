"""Standard deviation promised for the error of a pose that no fit saw: noise, parameters, and what the model misses.

Predicted minus measured of such a pose has, per coordinate, the variance

    noise + parameters and frame + discrepancy.

The first two are those of the linearised fit; of learned curves the parameters are what the fitted poses show, and what
the curves do between these is as uncertain as their prior says. The discrepancy is learned from training poses that are
left out with their nearest neighbours in joint space, 1, 2, 4 ... poses at a time: what the model misses is alike at
neighbouring poses, so that a pose left out alone is still half known by them. The error of a pose i left out with a
group G is

    e_G = (1 - H_GG)^-1 r_G,   of covariance noise (1 - H_GG)^-1 where nothing is missed,

H the hat matrix of parameters, prior and frames. What the squared errors have beyond that covariance is fitted as a
line over the distance r to the nearest pose that is left: discrepancy = a + b r, both at least zero.

A setup without training poses is a place of its own: there errors are alike too, and one place says little about the
next. Its standard deviations are multiplied by `NEW_PLACE`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from calib import frames
from calib.array_types import Array, BoolArray, IndexArray
from calib.brief import Brief
from calib.calibration.evaluation import Evaluation
from calib.calibration.noise_level import FIT, noise_level
from calib.calibration.pose_errors import directions_at
from calib.calibration.result import Calibration, declared_sigma_mm
from calib.calibration.uncertainty import JointKnowledge
from calib.dataset.dataset import Dataset
from calib.dataset.repeats import SIGMA_DOUBT
from calib.effects.state import RobotState
from calib.fitting.discrepancy import Discrepancy, distances
from calib.fitting.model import Model
from calib.fitting.observations import Observations, linearise_points
from calib.frames import frames_by_name
from calib.statistics import covariance_root, left_out_by

Z_90 = 1.6448536269514722
"""Standard deviations to either side that hold 90 % of a normal distribution."""
NEW_PLACE = 1.25
"""Factor of the standard deviation in a setup without training poses: by six recordings of Panda arms with a test place
of their own (docs/measured.md), between 1.08 and 1.35 where the recordings of any one arm are left out."""
_GROUPS = (1, 2, 4, 8, 16, 32)  # poses that are left out together
_MOST_GROUPS = 400  # of each size, spread evenly over the poses
_LEAST_LEFT = 0.5  # share of the poses that has to be left for the fit without a group
_REGIONS = (4, 8, 16)  # of joint space, that are left out one by one
_MOST_MEANS = 20  # iterations of k-means
_GRID = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 61)])  # discrepancies that are tried, in units of the noise


@dataclass(frozen=True)
class FitUncertainty(Brief):
    """What a prediction needs of a fit: model, values and covariance of its P parameters, noise, discrepancy."""

    model: Model
    x: Array  # (P,)
    covariance: Array  # (P, P)
    noise_ratio: float  # residual sigma over what the fitted points' covariances say
    single_ratio: float  # the same of a single measurement, which is no mean of repeats
    discrepancy: Discrepancy


@dataclass(frozen=True)
class PointPromise(Brief):
    """Errors of M measured points with the standard deviations promised for them, in the instrument's frame."""

    pose: IndexArray  # (M,)
    target: NDArray[np.str_]  # (M,)
    is_test: BoolArray  # (M,)
    error_mm: Array  # (M, 3) measured minus predicted; (M, 1) of lengths
    sigma_mm: Array  # (M, 3); (M, 1) of lengths

    @property
    def coverage_90(self) -> float | None:
        """Share of the test coordinates within 1.645 sigma, the interval that is to hold 90 %; None without any."""
        if not self.is_test.any():
            return None
        within = np.abs(self.error_mm) <= Z_90 * self.sigma_mm
        return float(np.mean(within[self.is_test]))


@dataclass(frozen=True)
class _Rows:
    """Changes (M, 3, K) of predicted points by K independent unit normal unknowns, mm, and each point's own noise."""

    root_mm: Array  # (M, 3, K)
    noise_mm2: Array  # (M, 3, 3)


def fit_uncertainty(calibration: Calibration, discrepancy: Discrepancy | None = None) -> FitUncertainty:
    """Uncertainty of a calibration, by default with the discrepancy that its left-out training poses show.

    Where repeats were averaged, a single measurement has the noise of one, and of what the model misses as much as
    their mean.
    """
    fit = calibration.fit
    noise = fit.reduced_chi if np.isfinite(fit.reduced_chi) else 1.0
    averaged = declared_sigma_mm(calibration.fitted_dataset) / declared_sigma_mm(calibration.dataset)
    single = np.sqrt(min(noise, 1.0) ** 2 + max(noise**2 - 1.0, 0.0) * averaged**2)
    known = learned_discrepancy(calibration) if discrepancy is None else discrepancy
    return FitUncertainty(calibration.model, fit.x, fit.covariance, noise, float(single), known)


def promised_at_points(fit: FitUncertainty, dataset: Dataset, evaluation: Evaluation) -> PointPromise:
    """Errors of a fit at all points of a dataset, each with the standard deviation promised for it.

    That of a training pose, too, is the one of a pose that the fit did not see.
    """
    poses = dataset.poses
    observed = Observations.of_all(dataset)
    fitted = ~poses.is_test[observed.points.pose]
    if evaluation.is_outlier is not None:
        fitted &= ~evaluation.is_outlier[observed.points.pose]
    placed = replace(observed, scanner_T_base=evaluation.scanner_T_base)
    rows = _rows(fit, placed, fitted)
    rows = replace(rows, root_mm=np.concatenate([rows.root_mm, _of_unseen_curves(fit, placed)], axis=2))
    missed = fit.discrepancy.variance_mm2(poses.q)[observed.points.pose]
    variance = np.sum(rows.root_mm**2, axis=2) + np.einsum("mii->mi", rows.noise_mm2) + missed[:, None]
    is_new_place = ~np.isin(observed.setup, observed.setup[fitted])
    error_mm, lengths = -evaluation.error_mm, observed.points.lengths
    if lengths is not None:  # one coordinate, along the line
        along = lengths.direction[:, None]
        noise = (along @ rows.noise_mm2 @ np.swapaxes(along, 1, 2))[..., 0]
        variance = np.sum((along @ rows.root_mm) ** 2, axis=2) + noise + missed[:, None]
        error_mm = np.sum(error_mm[:, None] * along, axis=2)
    return PointPromise(
        pose=observed.points.pose,
        target=observed.points.target,
        is_test=poses.is_test[observed.points.pose],
        error_mm=error_mm,
        sigma_mm=np.sqrt(variance) * np.where(is_new_place, NEW_PLACE, 1.0)[:, None],
    )


@lru_cache(maxsize=4)
def promise(calibration: Calibration) -> PointPromise:
    """Errors of a calibration at all its points, each with the standard deviation promised for it.

    >>> import calib
    >>> from calib.calibration.promise import promise
    >>> round(promise(calib.calibrate("sample_data/hidden_effect_a")).coverage_90, 2)
    0.92
    """
    return promised_at_points(fit_uncertainty(calibration), calibration.dataset, calibration.after)


def missed_variance(calibration: Calibration, q: Array) -> Array:
    """Variance (N,), mm^2 per coordinate, by which the model itself is off at joint vectors (N, n), without noise.

    It is the discrepancy and, where the noise is known, what the residual has beyond it: sigma^2 - (1.25 noise)^2, the
    noise being taken as accurate to 25 %. What the parameters' covariance says is not in it.
    """
    level = noise_level(calibration)
    beyond = 0.0
    if level.source != FIT and np.isfinite(calibration.sigma_mm):
        beyond = max(calibration.sigma_mm**2 - (SIGMA_DOUBT * level.sigma_mm) ** 2, 0.0)
    return beyond + learned_discrepancy(calibration).variance_mm2(q)


def _rows(fit: FitUncertainty, observed: Observations, fitted: BoolArray) -> _Rows:
    """Changes of the observed points by parameters and by frames fitted to the points in `fitted` (M,).

    A setup without fitted points has its frame from its own points, which takes their share of the noise away.
    """
    assert observed.scanner_T_base is not None
    at_mm, by_x = linearise_points(fit.model, fit.x, observed)
    count = len(at_mm)
    columns = np.empty_like(by_x)
    noise = fit.single_ratio**2 * observed.covariance_mm2
    own: list[Array] = []
    for setup, rows in observed.rows_of_setups().items():
        scanner_T_base = observed.scanner_T_base[setup]
        has_own = not fitted[rows].any()
        chosen = np.ones(len(rows), dtype=bool) if has_own else fitted[rows]
        seen_mm = frames.apply(scanner_T_base, at_mm[rows])
        turned = scanner_T_base[:3, :3] @ by_x[rows]
        known = JointKnowledge.of_points(
            fit.covariance,
            fit.noise_ratio,
            seen_mm[chosen],
            turned[chosen],
            observed.whiten[rows][chosen],
            known=observed.frame_is_known(rows),
        )
        motion = frames.frame_motion(seen_mm, known.centre_mm)
        columns[rows] = turned + motion @ known.follows
        of_frame = motion @ known.frame_root
        if has_own:
            noise[rows] -= of_frame @ np.swapaxes(of_frame, 1, 2)
        else:
            block = np.zeros((count, 3, of_frame.shape[2]))
            block[rows] = of_frame
            own.append(block)
    return _Rows(np.concatenate([columns @ covariance_root(fit.covariance), *own], axis=2), noise)


@runtime_checkable
class _Curve(Protocol):
    """An effect that moves a joint by a curve, of which its parameters are what the fitted poses show."""

    joint: int

    def unseen_variance(self, state: RobotState) -> Array:
        """Variance (N,), rad^2, of the rest of the curve at N poses."""
        ...


def _of_unseen_curves(fit: FitUncertainty, observed: Observations) -> Array:
    """Changes (M, 3, C) of the observed points by one sigma of what each of C curves does where no fitted pose was."""
    curves = [effect for effect in fit.model.effects if isinstance(effect, _Curve)]
    if not curves:
        return np.zeros((len(observed.points), 3, 0))
    assert observed.scanner_T_base is not None
    scanner_R_base = frames_by_name(observed.scanner_T_base, observed.setup)[:, :3, :3]
    directions = directions_at(fit.model, fit.x, observed, scanner_R_base)
    poses, row = observed.used_poses
    state = fit.model.state(fit.x, poses, observed.seen("jig"))
    moved = [directions[one.joint] * np.sqrt(one.unseen_variance(state))[row][:, None] for one in curves]
    return np.stack(moved, axis=2)


@dataclass(frozen=True)
class _LeftOut:
    """Errors of K training poses left out with their neighbours, squared, mm^2, per coordinate."""

    squared_mm2: Array  # (K,)
    expected_mm2: Array  # (K,) where nothing is missed
    distance: Array  # (K,) to the nearest pose that is left
    weight: Array  # (K,) one over the poses left out together, which tell of one place


def learned_discrepancy(calibration: Calibration) -> Discrepancy:
    """Discrepancy by the training poses left out with 0, 1, 3 ... 31 of their nearest neighbours in joint space.

    a and b maximise the likelihood of the left-out errors, each group counting once. Without a degree of freedom left
    both are zero.
    """
    return learned_with_gain(calibration)[0]


@lru_cache(maxsize=4)
def learned_with_gain(calibration: Calibration) -> tuple[Discrepancy, float]:
    """Discrepancy of `learned_discrepancy`, and by how much it raises the log likelihood over none.

    The sizes of groups tell of the same errors: the gain is a mean over them.
    """
    dataset, fit = calibration.fitted_dataset, calibration.fit
    observed = replace(Observations.of(dataset), scanner_T_base=calibration.after.scanner_T_base)
    used = np.unique(observed.points.pose)
    none = _joint_space(dataset.poses.q[used])
    if not np.isfinite(fit.reduced_chi) or not fit.reduced_chi > 0.0 or len(used) < 4:
        return none, 0.0
    left = _left_out(calibration, observed, none)
    constant, growth, fall = _most_likely(left)
    gain = 1.5 * fall * len(used) / float(left.weight.sum())
    return replace(none, constant_mm2=constant, growth_mm2=growth), gain


def _left_out(calibration: Calibration, observed: Observations, known: Discrepancy) -> _LeftOut:
    """Errors of training poses left out with 0, 1, 3 ... of their nearest neighbours."""
    noise = calibration.fit.reduced_chi
    whiten, residual, root = _whitened(calibration, observed, known)
    coordinates = whiten.shape[1]
    colour = np.linalg.inv(whiten) if coordinates == whiten.shape[2] else np.linalg.pinv(whiten)
    poses, row = observed.used_poses
    points = np.split(np.argsort(row, kind="stable"), np.cumsum(np.bincount(row))[:-1])
    tried = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), _MOST_GROUPS)).astype(int))
    counts = [count for count in _GROUPS if count == 1 or count <= (1.0 - _LEAST_LEFT) * len(poses)]
    squared, expected, distance = np.empty((3, len(tried), len(counts)))
    for k, pose in enumerate(tried):
        away = distances(known.trained[pose], known.trained, known.scale)
        away[pose] = -1.0  # before any other at the same joints
        nearest = np.argpartition(away, counts[-1])[: counts[-1] + 1]
        order = nearest[np.argsort(away[nearest], kind="stable")]
        own = len(points[pose])
        turn = colour[points[pose]]
        for j, count in enumerate(counts):
            group = np.concatenate([points[i] for i in order[:count]])
            flat = root[group].reshape(coordinates * len(group), -1)
            solved = np.linalg.inv(left_out_by(flat @ flat.T))
            missed = (solved[: coordinates * own] @ residual[group].ravel()).reshape(own, coordinates)
            of_points = [slice(coordinates * i, coordinates * (i + 1)) for i in range(own)]
            blocks = np.stack([solved[rows, rows] for rows in of_points])
            told = coordinates * own  # coordinates of this pose
            known_mm2 = np.sum(np.einsum("mij,mjk,mik->mi", turn, blocks, turn)) / told
            squared[k, j] = np.sum(np.einsum("mij,mj->mi", turn, missed) ** 2) / told
            expected[k, j] = noise**2 * max(known_mm2, np.sum(turn**2) / told)
            distance[k, j] = away[order[count]]
    weight = np.broadcast_to(1.0 / np.array(counts), squared.shape)
    return _LeftOut(squared.ravel(), expected.ravel(), distance.ravel(), weight.ravel())


def _whitened(calibration: Calibration, observed: Observations, known: Discrepancy) -> tuple[Array, Array, Array]:
    """Whitening matrices (M, C, 3) of the fitted points, their residual (M, C), and a root L (M, C, K) of H = L L^T."""
    fit = fit_uncertainty(calibration, known)
    at_mm = linearise_points(fit.model, fit.x, observed)[0]
    assert observed.scanner_T_base is not None
    placed = frames_by_name(observed.scanner_T_base, observed.setup)
    error_mm = np.einsum("mij,mj->mi", placed[:, :3, :3], at_mm) + placed[:, :3, 3] - observed.points.xyz_mm
    whiten = observed.whiten
    root = whiten @ _rows(fit, observed, np.ones(len(at_mm), dtype=bool)).root_mm / fit.noise_ratio
    return whiten, np.einsum("mij,mj->mi", whiten, error_mm), root


@lru_cache(maxsize=4)
def misfit_inflation(calibration: Calibration) -> float:
    """Factor, at least 1, of the parameters' covariance where what the model misses is alike at neighbouring poses.

    The poses are divided into regions G of the joint space. Without a region the parameters and frames move, in units
    of their covariance, by L_G^T (1 - H_GG)^-1 r_G, of expected square s^2 tr L_G^T (1 - H_GG)^-1 L_G where errors are
    independent. The factor is the ratio of the sums over all regions, its mean over 4, 8 and 16 regions.
    """
    dataset, noise = calibration.fitted_dataset, calibration.fit.reduced_chi
    observed = replace(Observations.of(dataset), scanner_T_base=calibration.after.scanner_T_base)
    used, row = np.unique(observed.points.pose, return_inverse=True)
    joints = _joint_space(dataset.poses.q[used])
    if not noise > 0.0 or len(used) < 2 * _REGIONS[-1]:
        return 1.0
    _, residual, root = _whitened(calibration, observed, joints)
    ratios = []
    for count in _REGIONS:
        region = _regions(joints.trained / joints.scale, count)[row]
        moved = expected = 0.0
        for k in np.unique(region):
            points = np.flatnonzero(region == k)
            flat = root[points].reshape(root.shape[1] * len(points), -1)
            # (1 - L L^T)^-1 L = L (1 - L^T L)^-1, which is small however many poses a region has
            solved = flat @ np.linalg.inv(left_out_by(flat.T @ flat))
            moved += float(np.sum((solved.T @ (residual[points].ravel() / noise)) ** 2))
            expected += float(np.sum(flat * solved))
        ratios.append(moved / max(expected, 1e-300))
    return max(1.0, float(np.mean(ratios)))


def _regions(places: Array, count: int) -> IndexArray:
    """Region (N,) of each of N places (N, n): k-means, from places that are as far apart as possible."""
    centres = places[[int(np.argmin(np.sum((places - places.mean(axis=0)) ** 2, axis=1)))]]
    for _ in range(count - 1):
        nearest = np.min(np.sum((places[:, None] - centres) ** 2, axis=2), axis=1)
        centres = np.concatenate([centres, places[[int(np.argmax(nearest))]]])
    region = np.zeros(len(places), dtype=np.int64)
    for _ in range(_MOST_MEANS):
        region = np.argmin(np.sum((places[:, None] - centres) ** 2, axis=2), axis=1)
        kept = np.unique(region)
        centres = np.stack([places[region == k].mean(axis=0) for k in kept])
    return np.argmin(np.sum((places[:, None] - centres) ** 2, axis=2), axis=1)


def _joint_space(trained: Array) -> Discrepancy:
    """No discrepancy, with the joint vectors (T, n) of the training poses and each joint's range over them."""
    return Discrepancy(0.0, 0.0, trained, np.maximum(trained.max(axis=0) - trained.min(axis=0), 1e-3))


def _most_likely(left: _LeftOut) -> tuple[float, float, float]:
    """a and b, mm^2, at least zero, most likely by left-out errors of variance expected + a + b r.

    Third, by how much the weighted surprise (twice the negative log likelihood per coordinate) falls below that of
    zero a and b.
    """
    unit = float(np.median(left.expected_mm2))
    farthest = float(left.distance.max())
    if not unit > 0.0 or not farthest > 0.0:
        return 0.0, 0.0, 0.0
    share = left.distance / farthest
    best, none = (np.inf, 0.0, 0.0), 0.0
    for constant in _GRID * unit:
        variance = left.expected_mm2 + constant + np.outer(_GRID * unit, share)
        surprise = (np.log(variance) + left.squared_mm2 / variance) @ left.weight
        i = int(np.argmin(surprise))
        none = float(surprise[0]) if constant == 0.0 else none
        best = min(best, (float(surprise[i]), float(constant), float(_GRID[i] * unit / farthest)))
    return best[1], best[2], none - best[0]
