"""Tests of every candidate effect against the residual of a fit.

The fitted directions (parameters that the data determine, and the scanner's frames) are projected out of the residual
and of each candidate's columns. A candidate whose columns vanish then is untestable with these poses.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.blas_threads import one_blas_thread
from calib.brief import Brief
from calib.calibration.result import Calibration
from calib.effects.catalogue import effects_for
from calib.effects.effect import Effect, Family, exceeded_bound, full_name
from calib.lazy_modules import pd
from calib.screening.evidence import Evidence, holm, most_columns
from calib.screening.left_out import cross_validated_rmse_mm
from calib.screening.member_columns import VisibleColumns, visible_columns
from calib.screening.projected_residual import ProjectedResidual, project_residual

MIN_LOG_BAYES_FACTOR = 3.0  # of one effect over another that could explain the same, from which it leads
DECADES_BEYOND = 0.3  # standard deviation of a size beyond nature's bound: twice as large as known ones
MIN_CONFOUNDED_OVERLAP = 0.5  # share of what one effect explains that another could explain, from which it counts


@dataclass(frozen=True)
class Value:
    """Estimate of one coefficient of an effect by the linear screening."""

    name: str
    value: float
    sigma: float
    unit: str


@dataclass(frozen=True)
class Candidate(Brief):
    """Candidate effect: a family of effects with the evidence for it in the residual of a fit."""

    family: Family
    p_value: float
    p_holm: float
    log_evidence: float  # less what sizes beyond nature cost
    explained_share: float  # of the residual's sum of squares
    cv_rmse_mm: float  # RMS per coordinate when each pose is predicted from the others, linearised
    members: tuple[Effect, ...]  # that carry it
    values: tuple[Value, ...]
    prior_sigmas: dict[str, float]  # of highest evidence, by full name of those members' parameters
    determined: float  # number of its members' parameters that the data determine, and not the prior
    explained: Array  # (R,) the part of the residual that it explains, whitened
    overlaps: dict[str, float]  # by family: share of `explained` that lies in the span of its columns

    @property
    def name(self) -> str:
        return self.family.name

    def _brief(self) -> str:
        return f"{self.name}: log evidence {self.log_evidence:.3g}, p {self.p_value:.2g}"


@dataclass(frozen=True)
class Untestable:
    """Effect (a whole family) that these data cannot test, with the reason."""

    name: str
    why: str
    would_help: str
    never: bool = False  # whether no dataset can test it


@dataclass(frozen=True)
class Screening(Brief):
    """Tests of all effects of the catalogue against the residual of one fit, the highest log evidence first."""

    projected: ProjectedResidual
    candidates: tuple[Candidate, ...]
    untestable: tuple[Untestable, ...]
    cv_rmse_mm: float  # of the fit without any candidate

    def to_frame(self) -> pd.DataFrame:
        """Table of the candidates, one row each."""
        return pd.DataFrame(
            {
                "effect": [c.name for c in self.candidates],
                "log_evidence": [c.log_evidence for c in self.candidates],
                "p_value": [c.p_value for c in self.candidates],
                "p_holm": [c.p_holm for c in self.candidates],
                "explained_share": [c.explained_share for c in self.candidates],
                "cv_rmse_mm": [c.cv_rmse_mm for c in self.candidates],
            }
        )

    def _brief(self) -> str:
        best = ", ".join(f"{one.name} {one.log_evidence:.3g}" for one in self.candidates[:3]) or "none"
        return f"{len(self.candidates)} candidates, best by log evidence: {best}; {len(self.untestable)} untestable"


@one_blas_thread()
def screening_of(calibration: Calibration, families: Sequence[Family] | None = None) -> Screening:
    """Evidence of every effect that is not yet in a calibration's model, from the residual of its fit.

    `families`: candidates; those of the catalogue where None.
    """
    families = effects_for(calibration.dataset) if families is None else families
    projected = project_residual(calibration)
    present = set(calibration.model.family_names)
    untestable: list[Untestable] = []
    tested: list[VisibleColumns] = []
    for family in families:
        if family.name in present:
            continue
        if family.why_not or not family.members:
            untestable.append(Untestable(family.name, family.why_not, family.would_help, family.never_testable))
            continue
        columns = visible_columns(projected, family)
        if columns.narrowest == 0:
            untestable.append(
                Untestable(
                    family.name,
                    "at these poses everything it does looks like a fitted link error or a motion of the scanner",
                    "poses that differ more: other configurations, wider joint ranges, varied load",
                )
            )
        elif columns.narrowest > most_columns(projected.dof):
            untestable.append(_too_wide(projected, family, columns.narrowest))
        else:
            tested.append(_refined(projected, columns))
    evidence = [columns.evaluate(-projected.residual, projected.dof) for columns in tested]
    corrected = holm([e.p_value for e in evidence])
    overlaps = _overlaps(tested, evidence)
    plain = cross_validated_rmse_mm(projected)
    candidates = [
        _not_of_single_poses(_candidate(projected, columns, e, p, of_family), plain)
        for columns, e, p, of_family in zip(tested, evidence, corrected, overlaps, strict=True)
    ]
    candidates.sort(key=lambda c: (-c.log_evidence, c.p_value))
    return Screening(projected, tuple(candidates), tuple(untestable), plain)


def _refined(projected: ProjectedResidual, columns: VisibleColumns) -> VisibleColumns:
    """Columns of an effect of one law with a grid of constants, with a finer grid around its best member."""
    family = columns.family
    if family.finer is None:
        return columns
    coarse = columns.evaluate(-projected.residual, projected.dof)
    if coarse.log_evidence <= 0.0:
        return columns
    best = family.members[int(np.argmax(coarse.scales))]
    return visible_columns(projected, replace(family, members=(*family.members, *family.finer(best))))


def _too_wide(projected: ProjectedResidual, family: Family, columns: int) -> Untestable:
    """`Untestable` for an effect that has too many parameters for the number of equations, with the poses needed."""
    poses = len(projected.residuals.observed.used_poses[0])
    more = int(np.ceil((2 * columns - projected.dof) / 3))
    return Untestable(
        family.name,
        f"it has {columns} parameters at least, and the fit leaves {projected.dof} equations to judge them by",
        f"{poses + more} training poses or more",
    )


def _not_of_single_poses(candidate: Candidate, plain_rmse_mm: float) -> Candidate:
    """A candidate, its evidence set to zero if it acts at single poses and predicts left-out poses no better.

    Single poses that are wrong have their places and times too, and no effect makes them.
    """
    if not candidate.family.sparse or candidate.cv_rmse_mm < plain_rmse_mm:
        return candidate
    return replace(candidate, log_evidence=0.0)


def _overlaps(tested: Sequence[VisibleColumns], evidence: Sequence[Evidence]) -> list[dict[str, float]]:
    """For each effect: other effects that could explain over 20 % of the part it explains, with these shares."""
    if not tested:
        return []
    explained = np.column_stack([e.explained for e in evidence])
    shares = [columns.shares(explained) for columns in tested]
    return [
        {
            other.family.name: float(share[k])
            for other, share in zip(tested, shares, strict=True)
            if other is not columns and share[k] > 0.2
        }
        for k, columns in enumerate(tested)
    ]


def _candidate(
    projected: ProjectedResidual, visible: VisibleColumns, evidence: Evidence, p_holm: float, overlaps: dict[str, float]
) -> Candidate:
    family, groups = visible.family, visible.groups
    active = [i for i in np.flatnonzero(evidence.scales).tolist() if np.any(groups[i])]
    columns = np.concatenate([groups[i] for i in active], axis=1) if active else np.zeros((len(projected.residual), 0))
    spread = (
        np.concatenate([np.full(groups[i].shape[1], evidence.scales[i]) for i in active]) if active else np.zeros(0)
    )
    # (C^T C / sigma^2 + S^-2)^-1, by eigenvalues over S, which never is singular: exact data leave a sigma of rounding.
    shaped = columns * np.maximum(spread, 1e-9) / projected.sigma
    square, turn = np.linalg.eigh(shaped.T @ shaped)
    sigma = np.maximum(spread, 1e-9) * np.sqrt(turn**2 @ (1.0 / (1.0 + np.maximum(square, 0.0))))
    values: list[Value] = []
    prior_sigmas: dict[str, float] = {}
    decades = 0.0  # beyond nature's bound, where an effect has one
    for i in active:
        member = family.members[i]
        for parameter, coefficient in zip(member.parameters, evidence.coefficients[i], strict=True):
            name, scale = full_name(member, parameter), parameter.scale
            one = Value(name, float(coefficient) * scale, float(sigma[len(prior_sigmas)]) * scale, parameter.unit)
            values.append(one)
            prior_sigmas[name] = float(evidence.scales[i]) * scale
            if (bound := exceeded_bound(member, parameter, one.value, one.sigma)) is not None:
                decades = max(decades, float(np.log10((abs(one.value) - 2.0 * one.sigma) / bound.size)))
    total = float(projected.residual @ projected.residual)
    rest = projected.residual + evidence.explained  # the residual is predicted minus measured
    return Candidate(
        family=family,
        p_value=evidence.p_value,
        p_holm=p_holm,
        log_evidence=max(evidence.log_evidence - 0.5 * (decades / DECADES_BEYOND) ** 2, 0.0),
        explained_share=1.0 - float(rest @ rest) / total if total > 0.0 else 0.0,
        cv_rmse_mm=cross_validated_rmse_mm(projected, columns, spread),
        members=tuple(family.members[i] for i in active),
        values=tuple(values),
        prior_sigmas=prior_sigmas,
        determined=float(np.sum(np.maximum(square, 0.0) / (1.0 + np.maximum(square, 0.0)))),
        explained=-evidence.explained,
        overlaps=overlaps,
    )


def explained_shares_at(screening: Screening, poses: Collection[str]) -> dict[str, float]:
    """Share of the squared residual at some training poses that each candidate explains, by the candidate's name.

    The candidate is fitted to all training poses: below zero it makes these poses worse. Empty where no point of
    these poses was fitted.
    """
    rows = np.isin(np.array(screening.projected.row_poses), list(poses))
    residual = screening.projected.residual[rows]
    total = float(residual @ residual)
    if total <= 0.0:
        return {}
    left = {c.name: residual - c.explained[rows] for c in screening.candidates if c.members}
    return {name: 1.0 - float(rest @ rest) / total for name, rest in left.items()}
