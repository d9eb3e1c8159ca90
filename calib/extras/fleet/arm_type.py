"""What arms of a type share: mean and scatter of every parameter over a fleet, and another arm's fit that begins there.

Partial pooling: parameter j of an arm is normal about the type's mean m_j with the scatter t_j, both estimated from all
arms together by expectation maximisation. An arm that knows a parameter well tells much of m_j and t_j, one that does
not tells nothing: the information of its fit counts, without the fit's own prior. Tools and targets are no matter of
the type.

The fit of another arm has m_j as its prior mean and, as its sigma, the scatter with the uncertainty of the mean. The
arm's own points decide whether it is of that type: fits with and without it compete by their evidence (Laplace's
approximation, MacKay 1992).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.blas_threads import one_blas_thread
from calib.calibration.calibrate import fit_measured
from calib.calibration.promise import misfit_inflation
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.effects.catalogue import EffectChoice, effects_named
from calib.effects.effect import Effect
from calib.errors import CalibError, FitError
from calib.fitting.observations import Observations, with_nominal_scanner_frames
from calib.fitting.residual_kinds import make_residuals
from calib.options import NEW_ARM_POSES, FitOptions, TypePrior
from calib.presented import Presented

FEWEST_ARMS = 2
MIN_LEAD = 3.0  # log evidence by which the type has to be better than the arm alone
_USUAL = 0.5  # arms that the usual tolerance counts as, in the estimate of a scatter
_LEAST = 0.02  # of the usual tolerance, that a scatter may be
_ROUNDS, _SETTLED = 300, 1e-4
_NOISES = np.geomspace(0.5, 2.0, 41)  # of the noise that a fit has found


@dataclass(frozen=True)
class ArmType:
    """What arms of a type share."""

    robot: str
    arms: tuple[str, ...]  # datasets that it was learned from
    prior: TypePrior
    members: tuple[Effect, ...] = ()  # of effects that its arms have

    @property
    def parameters(self) -> list[dict[str, object]]:
        """Each parameter that the arms share, with its mean and the sigma of another arm's about it."""
        sigmas = self.prior.sigmas
        return [{"name": name, "mean": mean, "sigma": sigmas[name]} for name, mean in self.prior.means.items()]


@dataclass(frozen=True)
class PooledFit:
    """Fit of an arm that began from its type, where its own points speak for that."""

    calibration: Calibration
    alone: Calibration  # the best fit without the type
    log_bayes_factor: float  # of the fit with the type over the one alone

    @property
    def is_of_type(self) -> bool:
        """Whether the points speak for the type; if not the arm is fitted alone."""
        return self.log_bayes_factor >= MIN_LEAD


@dataclass(frozen=True)
class LeftOutArm:
    """An arm fitted from the type that all others tell, and alone, with few poses; errors at all other poses."""

    name: str
    poses: int  # that were fitted
    alone_mm: float  # 3D RMSE
    pooled_mm: float
    is_of_type: bool
    log_bayes_factor: float  # of the type over the arm alone

    @property
    def ratio(self) -> float:
        """Error with the type over the error alone."""
        return self.pooled_mm / self.alone_mm


@dataclass(frozen=True)
class TypeReport(Presented):
    """A type that was learned from several arms, with each arm left out in turn."""

    arm_type: ArmType
    left_out: tuple[LeftOutArm, ...]

    @property
    def mean_ratio(self) -> float:
        """Geometric mean of the errors with the type over those alone."""
        return float(np.exp(np.mean([np.log(one.ratio) for one in self.left_out])))

    def _brief(self) -> str:
        return (
            f"{self.arm_type.robot}: {len(self.arm_type.arms)} arms, error of a new one {self.mean_ratio:.2f} of alone"
        )


# ---- what arms share ------------------------------------------------------------------------------------------------


_Told = tuple[Array, Array]
"""What one arm tells of P parameters, in tolerances: information (P, P), and its product with the value (P,)."""


@one_blas_thread()
def learn_type(fits: Sequence[Calibration]) -> ArmType:
    """Type of several arms, from a fit of each.

    Raises CalibError for fewer than two arms, or arms with different tables.
    """
    if len(fits) < FEWEST_ARMS:
        raise CalibError(f"found {len(fits)} arm; what a type shares shows in {FEWEST_ARMS} or more")
    first = fits[0].dataset.robot
    for fit in fits[1:]:
        robot = fit.dataset.robot
        same = robot.is_revolute.tolist() == first.is_revolute.tolist() and np.allclose(
            robot.table[:-1], first.table[:-1], atol=1e-9
        )
        if not same:
            raise CalibError(
                f"{fit.dataset.name}: its nominal table is not that of {fits[0].dataset.name}, so these are no arms of "
                "a type; give datasets whose robot.toml have the same rows up to the tool's"
            )
    own = {name for fit in fits for name in _own_names(fit)}
    scales = {p.name: p.scale for fit in fits for p in fit.fit.parameters if p.name not in own}
    means, sigmas = _pooled([_told(fit, scales) for fit in fits])
    return ArmType(
        robot=first.name,
        arms=tuple(fit.dataset.name for fit in fits),
        prior=TypePrior(
            *(dict(zip(scales, (of * list(scales.values())).tolist(), strict=True)) for of in (means, sigmas))
        ),
        members=tuple(dict.fromkeys(member for fit in fits for member in fit.model.added_effects)),
    )


def _own_names(fit: Calibration) -> set[str]:
    """Parameters of an arm's tool and of its targets, which are no matter of the type."""
    shared = {name for name in fit.dataset.robot.parameter_names if not name.endswith("TCP")}
    return set(fit.model.geometry_names) - shared


def _told(fit: Calibration, scales: Mapping[str, float]) -> _Told:
    """What a fit's points tell of parameters with given scales, with its tool and targets unknown within theirs."""
    linear = _Linear.of(fit)
    noise2 = linear.noise**2 * misfit_inflation(fit)
    information = linear.jacobian.T @ linear.jacobian / noise2
    along = information @ linear.z - linear.jacobian.T @ linear.residual / noise2
    names = [p.name for p in fit.fit.parameters]
    own = np.array([name not in scales for name in names])
    across = information[np.ix_(~own, own)] @ np.linalg.inv(information[np.ix_(own, own)] + np.eye(int(own.sum())))
    units = np.array([scales.get(name, 1.0) for name in names]) / fit.model.scales
    place = (np.array(list(scales))[:, None] == names) * units
    place = place[:, ~own]
    of_shared = information[np.ix_(~own, ~own)] - across @ information[np.ix_(own, ~own)]
    return place @ of_shared @ place.T, place @ (along[~own] - across @ along[own])


@dataclass(frozen=True)
class _Linear:
    """A fit's residual (R,) and Jacobian (R, P) by parameters in units of their prior sigma."""

    residual: Array
    jacobian: Array
    z: Array  # (P,) fitted
    mean: Array  # (P,) of the prior
    noise: float  # over the declared one
    rows: int  # equations less eliminated unknowns

    @classmethod
    def of(cls, fit: Calibration) -> _Linear:
        model = fit.model
        observed = with_nominal_scanner_frames(Observations.of(fit.fitted_dataset), model.placed_robot)
        residuals = make_residuals(fit.options.residual, model, observed)
        at = residuals.linearise(fit.fit.x)
        noise = max(fit.fit.reduced_chi, residuals.noise_floor)
        return cls(
            at.residual, at.jacobian * model.scales, fit.fit.x / model.scales, model.means / model.scales,
            noise if np.isfinite(noise) else 1.0, len(at.residual) - residuals.degrees_spent,
        )  # fmt: skip


def _log_evidence(fit: Calibration) -> float:
    """Log evidence of a fit's prior, up to a constant of the data, at the noise at which it is largest."""
    linear = _Linear.of(fit)
    off = linear.z - linear.mean
    s2 = np.linalg.svd(linear.jacobian, compute_uv=False) ** 2
    noise2 = (linear.noise * _NOISES) ** 2
    square = float(linear.residual @ linear.residual) / noise2 + float(off @ off)
    volume = np.log1p(s2 / noise2[:, None]).sum(axis=1)
    return float(np.max(-0.5 * (linear.rows * np.log(noise2) + square + volume)))


def _pooled(told: Sequence[_Told]) -> tuple[Array, Array]:
    """Mean (P,) of the arms' parameters, and the sigma (P,) of another arm's about it, in usual tolerances."""
    p, arms = len(told[0][1]), len(told)
    mean, scatter2 = np.zeros(p), np.ones(p)
    for _ in range(_ROUNDS):
        before = scatter2
        root = np.sqrt(scatter2)
        values, variances = [], []
        for information, along in told:
            inner = np.linalg.inv(np.eye(p) + root[:, None] * information * root)
            covariance = root[:, None] * inner * root
            values.append(mean + covariance @ (along - information @ mean))
            variances.append(np.diag(covariance))
        mean = np.sum(values, axis=0) / (arms + scatter2)  # the mean itself is normal about zero, as tolerances say
        spread = np.sum((np.array(values) - mean) ** 2 + np.array(variances), axis=0)
        scatter2 = np.maximum((spread + _USUAL) / (arms + _USUAL), _LEAST**2)
        if np.max(np.abs(np.log(scatter2 / before))) < _SETTLED:
            break
    of_mean2 = 1.0 / (1.0 + arms / (scatter2 + np.mean(variances, axis=0)))
    return mean, np.sqrt(scatter2 + of_mean2)


# ---- another arm ----------------------------------------------------------------------------------------------------


def fit_from_type(dataset: Dataset, arm_type: ArmType, options: FitOptions = FitOptions()) -> PooledFit:
    """Fit of an arm that begins from its type, where its points speak for that, else of the arm alone.

    Raises FitError as `calibrate`, and CalibError for an arm of another kind.
    """
    unknown = {name for name in arm_type.prior.means if "." not in name}.difference(dataset.robot.parameter_names)
    if unknown:
        raise CalibError(
            f"{dataset.name}: its arm has no {min(unknown)}, which arms of the type {arm_type.robot} have; it is none"
        )
    plain = replace(options, type_prior=None)
    alone = [fit_measured(dataset, plain)]
    if arm_type.members:
        with suppress(FitError):  # of too few poses for the effects without the type
            alone.append(fit_measured(dataset, plain, effects=arm_type.members))
    best_alone = max(alone, key=_log_evidence)
    of_type = replace(options, type_prior=arm_type.prior)
    pooled = fit_measured(dataset, of_type, effects=arm_type.members, start=alone[0])
    lead = _log_evidence(pooled) - _log_evidence(best_alone)
    return PooledFit(pooled if lead >= MIN_LEAD else best_alone, best_alone, lead)


def type_report(
    datasets: Sequence[Dataset],
    options: FitOptions = FitOptions(),
    *,
    effects: Sequence[EffectChoice] = (),
    poses: int = NEW_ARM_POSES,
    seed: int = 0,
) -> TypeReport:
    """Type of several arms, and how well each of them would begin from the others.

    Args:
        datasets: one an arm, or a recording.
        options: of all fits.
        effects: that the arms have, by name.
        poses: training poses of an arm that is left out.
        seed: of the choice of these poses.
    """
    fits = [fit_measured(dataset, options, effects=effects_named(dataset, effects)) for dataset in datasets]
    rng = np.random.default_rng(seed)
    left_out = []
    if len(fits) > FEWEST_ARMS:
        for k, dataset in enumerate(datasets):
            arm_type = learn_type([fit for other, fit in enumerate(fits) if other != k])
            few = with_few_poses(dataset, poses, rng)
            found = fit_from_type(few, arm_type, options)
            errors = [fit.after.test for fit in (found.alone, found.calibration)]
            if errors[0] is None or errors[1] is None:
                continue
            count = int(np.count_nonzero(~few.poses.is_test))
            left_out.append(
                LeftOutArm(
                    dataset.name, count, errors[0].rmse_mm, errors[1].rmse_mm, found.is_of_type, found.log_bayes_factor
                )
            )
    return TypeReport(learn_type(fits), tuple(left_out))


def with_few_poses(dataset: Dataset, count: int, rng: np.random.Generator) -> Dataset:
    """Dataset of which some training poses are fitted, drawn at random one setup after the other; all others are tests.

    A setup with no fitted pose has the frame of its own test poses.
    """
    poses = dataset.poses
    assert dataset.points is not None
    measured = rng.permutation(np.intersect1d(np.flatnonzero(~poses.is_test), dataset.points.pose))
    setups = poses.setup[measured].tolist()
    kept = measured[np.argsort([setups.index(setup) for setup in setups], kind="stable")][:count]
    role = np.full(len(poses), "test", dtype="<U9")
    role[kept] = "train"
    role[kept[0]] = "reference"
    return replace(dataset, poses=replace(poses, role=role))
