"""Fit of single poses and differences of paired poses together, with one set of parameters.

What links, tool and instrument cannot explain is alike at the poses of one place. It cancels in their differences and
stays in everything else, so a fit that weighs all points alike lets it pull at the values of the proven causes. Here
the poses of a place are split into their mean and their differences. Differences have the noise of the points. Means
and single poses have, besides it, a misfit of variance tau^2 in units of that noise, estimated from what both leave.
No point counts twice: of L poses at a place the mean has the variance 1 / L + tau^2, the L - 1 differences keep theirs.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.array_types import Array, BoolArray, IndexArray
from calib.blas_threads import one_blas_thread
from calib.brief import Brief
from calib.calibration.evaluation import evaluate_all
from calib.calibration.result import Calibration
from calib.effects.catalogue import effects_for
from calib.effects.effect import Effect, Parameter, family_name
from calib.errors import FitError
from calib.fitting.observations import Observations, with_nominal_scanner_frames
from calib.fitting.position_residuals import PositionResiduals
from calib.fitting.residual import Linearisation
from calib.fitting.residual_kinds import make_residuals
from calib.fitting.trust_region import solve
from calib.intervention.differences import differences_of, without_mean
from calib.intervention.pairs import PairedPoses, find_pairs
from calib.intervention.proof import Intervention
from calib.statistics import group_numbers

_WEIGHINGS = 3  # of single poses against differences
_RANK = 1e-9  # share of the largest singular value of the nuisance


@dataclass(frozen=True)
class JointFit(Brief):
    """A fit of single poses and differences together, whose model holds every proven cause."""

    calibration: Calibration
    added: tuple[str, ...]  # proven effects that the fit of all poses did not have
    dropped: tuple[str, ...]  # effects that it named in place of proven ones
    misfit: float  # tau: what the model misses at single poses, over the noise of the differences

    @property
    def weight_of_single(self) -> float:
        """Weight of a single pose beside that of a difference."""
        return float(1.0 / (1.0 + self.misfit**2))

    def _brief(self) -> str:
        return f"{self.calibration!r}, a single pose weighs {self.weight_of_single:.2g}"


@one_blas_thread()
def joint_fit(
    calibration: Calibration, interventions: Sequence[Intervention], instead: Collection[str] = ()
) -> JointFit | None:
    """Fit of all poses and differences together; None without a proof, or where the model cannot hold what is proven.

    Args:
        calibration: the fit of all poses.
        interventions: what its paired poses prove.
        instead: effects of its model that the pairs refute.
    """
    proven = [alike for one in interventions for alike in one.proven_members]
    if not proven or calibration.options.residual not in ("position", "pairs"):
        return None
    before = calibration.model
    kept = [effect for effect in before.effects if family_name(effect) not in instead]
    # Differences need no masses; for single poses an effect has members that allow for unknown ones.
    known = [member for family in effects_for(calibration.dataset) for member in family.members]
    own = {_carrier(member): member for member in known}
    needed = [[m if m in known else own.get(_carrier(m), m) for m in alike] for alike in proven]
    added = list(dict.fromkeys(alike[0] for alike in needed if not any(member in kept for member in alike)))
    model = replace(before, effects=(*kept, *added))
    values = dict(zip((p.name for p in before.parameters), calibration.fit.x.tolist(), strict=True))
    x = np.array([values.get(p.name, 0.0) for p in model.parameters])
    dataset = calibration.fitted_dataset
    observed = with_nominal_scanner_frames(Observations.of(dataset), model.placed_robot)
    residuals = make_residuals(calibration.options.residual, model, observed)
    assert isinstance(residuals, PositionResiduals)
    acting = [one for one in find_pairs(dataset) if any(set(one.conditions) <= {*i.conditions} for i in interventions)]
    split = _PlaceSplit.of(residuals, x, calibration, acting)
    if split is None:
        return None
    tau2 = split.misfit2(residuals.residual(x), calibration.fit.degrees_of_freedom)
    for _ in range(_WEIGHINGS):
        fit = solve(_JointResiduals(residuals, split, tau2), start=x, prior=calibration.options.prior)
        x = fit.x
        tau2 = split.misfit2(residuals.residual(x), fit.degrees_of_freedom)
    at_start, at_fit = evaluate_all(model, [model.delivered(x), x], calibration.dataset, calibration.outliers)
    return JointFit(
        calibration=replace(calibration, model=model, fit=fit, before=at_start, after=at_fit),
        added=tuple(dict.fromkeys(map(family_name, added))),
        dropped=tuple(dict.fromkeys(family_name(effect) for effect in before.effects if effect not in kept)),
        misfit=float(np.sqrt(tau2)),
    )


def _carrier(member: Effect) -> tuple[str, str, int | None]:
    """Effect, its first value and the joint: the same for members of known and of unknown masses."""
    return family_name(member), member.parameters[-1].name, getattr(member, "joint", None)


@dataclass(frozen=True)
class _PlaceSplit:
    """Split of M points into differences at common places, and means and single points."""

    paired: BoolArray  # (M,) points with a partner
    cell: IndexArray  # (K,) number of the place and target of each paired point
    whiten: Array  # (K, 3, 3) from the base frame to sigmas
    basis: Array  # (3 K, rank) orthonormal: motions of the instrument and shifts of the tool between the conditions
    poses: Array  # (M,) number of poses whose mean a point is part of: 1 for single points

    @classmethod
    def of(
        cls, residuals: PositionResiduals, x: Array, calibration: Calibration, acting: Sequence[PairedPoses]
    ) -> _PlaceSplit | None:
        """Split at the poses of some conditions; None where no two points have a place in common."""
        points, dataset = residuals.observed.points, calibration.fitted_dataset
        place = np.full(len(dataset.poses), -1)
        for one in acting:  # a place has one number, even where several conditions were changed there
            for number in range(int(one.place.max()) + 1):
                rows = one.poses[one.place == number]
                known = place[rows].max()
                place[rows] = known if known >= 0 else place.max() + 1
        target = group_numbers(points.target)
        key = group_numbers(np.column_stack([place[points.pose], target]))
        count = np.bincount(key)[key]
        paired = (place[points.pose] >= 0) & (count > 1)
        if not paired.any():
            return None
        cell = group_numbers(key[paired])
        whiten = residuals.base_to_residual(x)[paired]
        columns = _nuisance(calibration, acting, points.pose[paired], points.target[paired])
        moved = without_mean(columns, whiten, cell).reshape(3 * len(cell), -1)
        u, s, _ = np.linalg.svd(moved, full_matrices=False)
        basis = u[:, s > _RANK * max(float(s.max(initial=0.0)), 1e-300)]
        return cls(paired, cell, whiten, basis, np.where(paired, count, 1))

    @property
    def dof(self) -> int:
        """Degrees of freedom of the differences."""
        return 3 * (len(self.cell) - int(self.cell.max()) - 1) - self.basis.shape[1]

    def parts(self, values: Array) -> tuple[Array, Array]:
        """Differences (K, 3, C) and means of the paired rows of whitened values (M, 3, C)."""
        own = values[self.paired]
        apart = without_mean(own, self.whiten, self.cell)
        mean = own - apart
        flat = apart.reshape(3 * len(own), -1)
        return (flat - self.basis @ (self.basis.T @ flat)).reshape(apart.shape), mean

    def weighed(self, values: Array, misfit2: float) -> Array:
        """Whitened values (M, 3, C) with means and single points scaled down by the misfit."""
        weight = 1.0 / np.sqrt(1.0 + self.poses * misfit2)
        out = weight[:, None, None] * values
        apart, mean = self.parts(values)
        out[self.paired] = apart + weight[self.paired, None, None] * mean
        return out

    def misfit2(self, residual: Array, degrees_of_freedom: float) -> float:
        """Variance of the misfit in units of the noise, from residuals (3 M,) and the degrees of freedom of a fit."""
        values = residual.reshape(-1, 3, 1)
        apart, mean = self.parts(values)
        noise2 = float(np.sum(apart**2)) / max(self.dof, 1)
        rest = float(np.sum(mean**2) + np.sum(values[~self.paired] ** 2)) / max(degrees_of_freedom - self.dof, 1.0)
        rows = np.concatenate([self.poses[~self.paired], np.bincount(self.cell)])  # a row of a mean or a single point
        return max(rest / max(noise2, 1e-300) - 1.0, 0.0) / float(np.mean(rows))


def _nuisance(
    calibration: Calibration, acting: Sequence[PairedPoses], pose: IndexArray, target: NDArray[np.str_]
) -> Array:
    """Whitened columns (K, 3, C) at points by motions of the instrument and shifts of the tool under each condition."""
    row = {key: k for k, key in enumerate(zip(pose.tolist(), target.tolist(), strict=True))}
    robot = calibration.model.calibrated_robot(calibration.fit.x)
    blocks = [np.zeros((len(pose), 3, 0))]
    for paired in acting:
        try:
            differences = differences_of(calibration.fitted_dataset, paired, robot)
        except FitError:
            continue
        if differences is None:
            continue
        block = np.zeros((len(pose), 3, differences.nuisance.shape[1]))
        own = differences.nuisance.reshape(len(differences.pose), 3, -1)
        for name, of_target in differences.target.items():
            for k in np.flatnonzero(of_target).tolist():
                at = row.get((int(differences.pose[k]), name))
                if at is not None:
                    block[at] = own[k]
        blocks.append(block)
    return np.concatenate(blocks, axis=2)


@dataclass(frozen=True)
class _JointResiduals:
    """Residuals of differences, and of means and single points with the misfit in their variance."""

    points: PositionResiduals
    split: _PlaceSplit
    misfit2: float

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self.points.parameters

    @property
    def noise_floor(self) -> float:
        return self.points.noise_floor

    @cached_property
    def degrees_spent(self) -> int:
        return self.points.degrees_spent + self.split.basis.shape[1]

    def residual(self, x: Array) -> Array:
        return self._weighed(self.points.residual(x)[:, None])[:, 0]

    def linearise(self, x: Array) -> Linearisation:
        at = self.points.linearise(x)
        return Linearisation(self._weighed(at.residual[:, None])[:, 0], self._weighed(at.jacobian))

    def _weighed(self, rows: Array) -> Array:
        """Residual or Jacobian rows (3 M, C), weighed as means and differences of each place."""
        return self.split.weighed(rows.reshape(-1, 3, rows.shape[1]), self.misfit2).reshape(len(rows), -1)
