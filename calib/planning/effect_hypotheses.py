"""Hypotheses on the effect that is missing from a fit, and their predictions at poses that were not measured.

Each hypothesis is a linear model about the fit: link errors with their tolerances, the scanner's frames, and the
effect's own coefficients with the prior sigmas that the evidence gave them,

    residual = J g + F f + A a + noise.

The measured poses give the joint posterior of all coefficients, and so a mean and a covariance for new poses, including
what a refit could absorb (Box and Hill 1967, doi 10.1080/00401706.1967.10490441).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray
from calib.calibration.result import Calibration
from calib.dataset.dataset import Poses
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.verdict import ConfoundedSet
from calib.effects.effect import Effect, family_name, full_name
from calib.effects.state import Seen
from calib.fitting.model import effect_columns, point_by_state
from calib.fitting.observations import linearise_points
from calib.frames import frames_by_name
from calib.screening.candidates import Candidate, Screening
from calib.screening.member_columns import member_columns
from calib.screening.projected_residual import ProjectedResidual, project_residual
from calib.statistics import axis_variances

_FINEST = 1e-5  # least noise over the declared one: with that of exact data the prior would be lost in rounding
_FRAME = np.array([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])  # mm, rad: prior sigmas of a scanner's frame, as good as unknown

# Weight of the tolerances. A screening leaves a direction free where the data know it a tenth as well as these.
_PRIOR_WEIGHT = 0.1
_NO_PRIOR = 1e-3  # weight of the tolerances where a fit was asked to do without them


@dataclass(frozen=True)
class EffectHypothesis:
    """Hypothesis that one effect causes a residual: its members, their prior sigmas, and its evidence."""

    name: str
    members: tuple[Effect, ...]
    prior_sigmas: Mapping[str, float]  # by full parameter name
    log_evidence: float
    explained_share: float  # of the residual's sum of squares

    @classmethod
    def of(cls, candidate: Candidate) -> EffectHypothesis:
        """Hypothesis that a candidate of a screening is the cause."""
        return cls(
            candidate.name, candidate.members, candidate.prior_sigmas, candidate.log_evidence, candidate.explained_share
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Full names of the effect's parameters."""
        return tuple(full_name(member, p) for member in self.members for p in member.parameters)

    @property
    def sigmas(self) -> Array:
        """Prior sigmas (K,) of the effect's parameters."""
        return np.array([self.prior_sigmas[name] for name in self.names])


@dataclass(frozen=True)
class HypothesisSet:
    """Hypotheses on the cause of a residual, one of which is true."""

    calibration: Calibration  # fit; an effect of the set in its model stands for the whole set
    hypotheses: tuple[EffectHypothesis, ...]
    untested: tuple[str, ...] = ()  # effects that the data lack the means to test
    would_help: str = ""  # what to record or measure so that `untested` can be tested

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all effects of the set, the untestable ones last."""
        return (*(hypothesis.name for hypothesis in self.hypotheses), *self.untested)


def hypothesis_sets(diagnosis: Diagnosis) -> tuple[HypothesisSet, ...]:
    """Sets of effects left confounded by a diagnosis, the set of which none leads the others first.

    Last come those that paired poses prove together, as they cannot tell them apart.
    """
    ordered = sorted(diagnosis.confounded_sets, key=lambda one: not one.is_undecided)
    alike = [members for one in diagnosis.interventions for members in one.proven_members if len(members) > 1]
    proven = {value.full_name: abs(value.value) for proof in diagnosis.proven for value in proof.alike}
    sets = [_confounded(diagnosis, confounded) for confounded in ordered]
    return (*sets, *(_proven_together(diagnosis, members, proven) for members in alike))


def _proven_together(diagnosis: Diagnosis, members: tuple[Effect, ...], values: Mapping[str, float]) -> HypothesisSet:
    """Set of hypotheses that each effect of some members that pairs cannot tell apart is the cause."""
    names = dict.fromkeys(map(family_name, members))
    by_name = {name: tuple(m for m in members if family_name(m) == name) for name in names}
    return HypothesisSet(
        diagnosis.calibration,
        tuple(EffectHypothesis(name, own, dict(values), 0.0, 0.0) for name, own in by_name.items()),
    )


def _confounded(diagnosis: Diagnosis, confounded: ConfoundedSet) -> HypothesisSet:
    """Set of hypotheses for an effect in the model and its equivalents, with the evidence before it was added."""
    steps = diagnosis.steps
    before = next((a for a, b in pairwise(steps) if b.effect == confounded.effect), steps[0])
    inside = next(effect for effect in steps[-1].selected if effect.name == confounded.effect)
    hypotheses = []
    for candidate in _candidates(before.screening, (confounded.effect, *confounded.equivalent)):
        if candidate.name == confounded.effect:
            evidence = candidate.log_evidence, candidate.explained_share
            hypotheses.append(EffectHypothesis(candidate.name, inside.members, inside.prior_sigmas, *evidence))
        else:
            hypotheses.append(EffectHypothesis.of(candidate))
    return HypothesisSet(diagnosis.calibration, tuple(hypotheses), confounded.untested, confounded.would_help)


def _candidates(screening: Screening | None, names: tuple[str, ...]) -> list[Candidate]:
    """Candidate effects with given names, in the order of the ranking."""
    ranked = () if screening is None else screening.candidates
    return [candidate for candidate in ranked if candidate.name in names]


# ---- predictions ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class HypothesisPrediction:
    """Predictive distribution of the points at C poses under one hypothesis, in sigmas per coordinate.

    There are W rows for each pose. The covariance between poses a and b is spread[a] spread[b]^T, and that plus a unit
    matrix for a = b.
    """

    name: str
    log_evidence: float
    mean: Array  # (C, W)
    spread: Array  # (C, W, P)


@dataclass(frozen=True)
class HypothesisPredictions:
    """Predictive distributions of the points at the same poses under each hypothesis."""

    hypotheses: tuple[HypothesisPrediction, ...]
    sigma_mm: float  # noise per coordinate of a measured point
    dof: int  # degrees of freedom of the noise


def predict(calibration: Calibration, hypotheses: Sequence[EffectHypothesis], poses: Poses) -> HypothesisPredictions:
    """Predictive distributions of the points, under each hypothesis, at poses not yet measured.

    Args:
        calibration: a fit; effects of the hypotheses that are in its model are removed from it.
        hypotheses: hypotheses of which one is true.
        poses: poses with their conditions, at stations that the fit knows.

    Raises FitError where no degree of freedom is left.
    """
    fits = _fits(calibration, hypotheses)
    new = _NewRows.of(fits.projected, poses, fits.centre)
    predictions = []
    for hypothesis, (root, mean) in zip(hypotheses, fits.posteriors, strict=True):
        rows = np.concatenate([new.common(fits.common) / fits.noise, new.of_effect(hypothesis)], axis=2)
        flat = rows.reshape(-1, rows.shape[2])
        spread = np.linalg.solve(root.T, flat.T).T.reshape(rows.shape)
        # The fit's own prediction is the zero of all hypotheses; their geometry counts from there.
        at_poses = (flat @ mean).reshape(rows.shape[:2])
        predictions.append(HypothesisPrediction(hypothesis.name, hypothesis.log_evidence, at_poses, spread))
    return HypothesisPredictions(tuple(predictions), fits.noise * new.sigma_mm, fits.projected.dof)


@dataclass(frozen=True)
class CoefficientPosteriors:
    """Posterior of the coefficients of each hypothesis' effect by the measured poses, and the noise that they leave."""

    means: tuple[Array, ...]  # (K,) each, in the parameters' units
    roots: tuple[Array, ...]  # (K, K) each, of the covariance
    sigma_mm: float  # noise per coordinate of a measured point

    def draw(self, number: int, rng: np.random.Generator) -> Array:
        """Coefficients (K,) of one hypothesis, drawn from their posterior."""
        root = self.roots[number]
        return self.means[number] + root @ rng.standard_normal(len(root))


def coefficient_posteriors(calibration: Calibration, hypotheses: Sequence[EffectHypothesis]) -> CoefficientPosteriors:
    """Posterior of the coefficients of hypotheses' effects, whatever the link errors are.

    Raises FitError where no degree of freedom is left.
    """
    fits = _fits(calibration, hypotheses)
    means, roots = [], []
    for hypothesis, (root, mean) in zip(hypotheses, fits.posteriors, strict=True):
        sigmas = hypothesis.sigmas * fits.noise  # columns are per prior sigma, the residual in units of its noise
        width = len(sigmas)
        means.append(mean[-width:] * sigmas)
        roots.append(sigmas[:, None] * np.linalg.inv(root[-width:, -width:]))
    sigma2 = axis_variances(fits.projected.residuals.observed.covariance_mm2)
    return CoefficientPosteriors(tuple(means), tuple(roots), fits.noise * float(np.sqrt(np.median(sigma2))))


@dataclass(frozen=True)
class _Fits:
    """Linear models of the hypotheses, fitted to the measured poses."""

    projected: ProjectedResidual
    common: BoolArray  # parameters of the fit that all hypotheses share
    noise: float  # over the declared one
    centre: dict[str, Array]  # by station, of the measured points
    posteriors: tuple[tuple[Array, Array], ...]  # `_posterior` of each hypothesis


def _fits(calibration: Calibration, hypotheses: Sequence[EffectHypothesis]) -> _Fits:
    projected = project_residual(calibration)
    of_effects = {name for hypothesis in hypotheses for name in hypothesis.names}
    common = np.array([p.name not in of_effects for p in projected.residuals.model.parameters], dtype=bool)
    square = float(projected.residual @ projected.residual)
    if common.all():  # else the model has one of them, and the residual is noise
        square *= min(1.0 - hypothesis.explained_share for hypothesis in hypotheses)
    noise = max(float(np.sqrt(square / projected.dof)), _FINEST)
    measured, residual, centre = _measured_rows(projected, common)
    model = projected.residuals.model
    nominal = np.concatenate([((model.means - projected.x) / model.scales)[common], np.zeros(6 * len(centre))])
    posteriors = []
    for hypothesis in hypotheses:
        effect = [member_columns(projected, member) for member in hypothesis.members]
        scaled = _whitened(projected, np.concatenate(effect, axis=1)) * hypothesis.sigmas
        columns = np.concatenate([measured / noise, scaled], axis=1)
        prior = np.concatenate([nominal, np.zeros(scaled.shape[1])])
        weight = np.ones(len(prior))
        weight[: np.sum(common)] = _PRIOR_WEIGHT if calibration.options.prior else _NO_PRIOR
        posteriors.append(_posterior(columns, residual / noise, prior, weight))
    return _Fits(projected, common, noise, centre, tuple(posteriors))


def _posterior(columns: Array, residual: Array, prior: Array, weight: Array) -> tuple[Array, Array]:
    """Root R (P, P) of the posterior precision R^T R of a linear model's parameters, and their mean (P,).

    The noise is of unit size; the prior has mean `prior` (P,) and sigmas 1 / weight (P,).
    """
    q, root = np.linalg.qr(np.concatenate([columns, np.diag(weight)]))
    return root, np.linalg.solve(root, q.T @ np.concatenate([residual, weight * prior]))


def _whitened(projected: ProjectedResidual, columns: Array) -> Array:
    """Columns (R, P) multiplied by the residual's whitening, if it has one beyond the points' covariances."""
    return columns if projected.whitening is None else projected.whitening.apply(columns)


def _measured_rows(projected: ProjectedResidual, common: BoolArray) -> tuple[Array, Array, dict[str, Array]]:
    """Derivatives (R, P) at measured poses by link errors and frames, residual (R,), and centre of each station.

    Units are the prior's sigmas. Parameters that are not `common` to all hypotheses are removed: the residual is that
    without them.
    """
    residuals, x = projected.residuals, projected.x
    observed = residuals.observed
    to_residual = projected.base_to_residual
    at_mm, by_x = linearise_points(residuals.model, x, observed)
    columns = (to_residual @ by_x).reshape(-1, len(x))
    residual = columns[:, ~common] @ x[~common] - residuals.residual(x)
    placed = observed.scanner_T_base
    assert placed is not None
    blocks, centre = [], {}
    whiten = to_residual @ np.stack([placed[str(name)][:3, :3].T for name in observed.setup])
    for name in map(str, np.unique(observed.setup)):
        rows = observed.setup == name
        scanner_mm = frames.apply(placed[name], at_mm[rows])
        centre[name] = scanner_mm.mean(axis=0)
        block = np.zeros((len(at_mm), 3, 6))
        block[rows] = whiten[rows] @ frames.frame_motion(scanner_mm, centre[name]) * _FRAME
        blocks.append(block.reshape(-1, 6))
    all_columns = np.concatenate([columns[:, common] * residuals.model.scales[common], *blocks], axis=1)
    residual = _whitened(projected, residual[:, None])[:, 0]
    return _whitened(projected, all_columns), residual, centre


@dataclass(frozen=True)
class _NewRows:
    """Derivatives of the points at C poses not yet measured, W = 3 rows per target, over the declared sigma."""

    by_x: Array  # (C, W, P) by link errors in the prior's sigmas
    by_frame: Array  # (C, W, 6 S) by the frames of S stations
    by_state: Mapping[str, Array]  # by target, (C, 3, S) by the state, scanner frame
    projected: ProjectedResidual
    poses: Poses
    seen: Mapping[str, Seen]
    sigma_mm: float

    @classmethod
    def of(cls, projected: ProjectedResidual, poses: Poses, centre: Mapping[str, Array]) -> _NewRows:
        """Derivatives at poses not yet measured, frames turning about the centre of each station's measured points.

        centre: by station, of its measured points, mm.
        """
        residuals, x = projected.residuals, projected.x
        model, observed = residuals.model, residuals.observed
        sigma2 = axis_variances(observed.covariance_mm2)
        sigma_mm = float(np.sqrt(np.median(sigma2)))
        placed = observed.scanner_T_base
        assert placed is not None
        scanner_T_base = frames_by_name(placed, poses.setup)
        turn = scanner_T_base[:, :3, :3] / sigma_mm
        by_x, by_frame, by_state, seen = [], [], {}, {}
        for target in observed.targets:
            points_mm = model.predict(x, poses, target)
            at_mm = np.einsum("cij,cj->ci", scanner_T_base[:, :3, :3], points_mm) + scanner_T_base[:, :3, 3]
            seen[target] = Seen(at_mm, observed.scanner_T_base_at(poses))
            by_x.append(turn @ model.linearise(x, poses, target, seen[target])[1] * model.scales)
            by_state[target] = turn @ point_by_state(model.state(x, poses, seen[target]), target)[1]
            block = np.zeros((len(poses), 3, 6 * len(centre)))
            for k, (name, middle_mm) in enumerate(centre.items()):
                rows = poses.setup == name
                block[rows, :, 6 * k : 6 * k + 6] = frames.frame_motion(at_mm[rows], middle_mm) / sigma_mm * _FRAME
            by_frame.append(block)
        return cls(
            np.concatenate(by_x, axis=1), np.concatenate(by_frame, axis=1), by_state, projected, poses, seen, sigma_mm
        )

    def common(self, common: BoolArray) -> Array:
        """Derivatives (C, W, P) by the unknowns that all hypotheses share: link errors and scanner frames."""
        return np.concatenate([self.by_x[..., common], self.by_frame], axis=2)

    def of_effect(self, hypothesis: EffectHypothesis) -> Array:
        """Derivatives (C, W, K) by the coefficients of a hypothesis' effect, in units of their prior sigmas."""
        model, x = self.projected.residuals.model, self.projected.x
        blocks = []
        for target, by_state in self.by_state.items():
            state = model.state(x, self.poses, self.seen[target])
            columns = [
                effect_columns(by_state, member, state, np.zeros(len(member.parameters)))
                for member in hypothesis.members
            ]
            blocks.append(np.concatenate(columns, axis=2) * hypothesis.sigmas)
        return np.concatenate(blocks, axis=1)
