"""Test every candidate effect against the residual of a fit.

The fitted directions (parameters that the data determine, and the scanner's frames) are projected out of the residual
and of each candidate's columns. A candidate whose columns vanish then is untestable with these poses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from calib.array_types import Array
from calib.blas_threads import one_blas_thread
from calib.calibration.result import Calibration
from calib.effects.effect import Effect, Family, full_name
from calib.fitting.model import effect_columns
from calib.screening.evidence import Evidence, FamilyColumns, evaluate_family, holm, most_columns
from calib.screening.projected_residual import ProjectedResidual, project_residual

MIN_RIVAL_OVERLAP = 0.5  # share of what one effect explains that its rival could explain too
_HIDDEN = 0.02  # share of a column that projection has to leave: below it, fitted parameters do the same


@dataclass(frozen=True)
class Value:
    """A coefficient as the linear screening estimates it."""

    name: str
    value: float
    sigma: float
    unit: str


@dataclass(frozen=True)
class Candidate:
    """A family with the evidence for it."""

    family: Family
    p_value: float
    p_holm: float
    log_evidence: float
    explained_share: float  # of the residual's sum of squares
    cv_rmse_mm: float  # error a coordinate of each pose predicted from the others, linearised
    members: tuple[Effect, ...]  # those that carry it
    values: tuple[Value, ...]
    prior_sigmas: dict[str, float]  # of those members' parameters, by full name: of highest evidence
    explained: Array  # (R,) its part of the residual, whitened
    overlaps: dict[str, float]  # by family: share of `explained` that lies in the span of its columns

    @property
    def name(self) -> str:
        return self.family.name


@dataclass(frozen=True)
class Untestable:
    """A family that these data cannot test."""

    name: str
    why: str
    would_help: str
    never: bool = False  # whether no dataset can test it


@dataclass(frozen=True)
class Screening:
    """All families tested against one fit, the highest log evidence first."""

    projected: ProjectedResidual
    candidates: tuple[Candidate, ...]
    untestable: tuple[Untestable, ...]
    cv_rmse_mm: float  # of the fit without any candidate

    def to_frame(self) -> pd.DataFrame:
        """One row a candidate."""
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


def member_columns(projected: ProjectedResidual, member: Effect) -> Array:
    """(R, K) derivative of the whitened residual by a member's parameters at zero, before projection."""
    observed = projected.residuals.observed
    _, row = observed.used_poses
    columns = np.empty((len(observed.points), 3, len(member.parameters)))
    for target, state in projected.states.items():
        by_value = effect_columns(projected.by_state[target], member, state, np.zeros(columns.shape[-1]))
        of_target = observed.points.target == target
        columns[of_target] = by_value[row[of_target]]
    return (projected.base_to_residual @ columns).reshape(-1, columns.shape[-1])


@one_blas_thread()
def screen(calibration: Calibration, families: Sequence[Family]) -> Screening:
    """Test every family that is not yet in the model; see `Candidate`."""
    projected = project_residual(calibration)
    present = set(calibration.model.family_names)
    untestable, tested, columns, evidence = [], [], [], []
    for family in families:
        if family.name in present:
            continue
        if family.why_not or not family.members:
            untestable.append(
                Untestable(family.name, family.why_not, family.would_help, family.never_testable)
            )
            continue
        groups = tuple(_visible(projected, member) for member in family.members)
        if not any(np.any(group) for group in groups):
            untestable.append(
                Untestable(
                    family.name,
                    "at these poses everything it does looks like a fitted link error or a motion of the scanner",
                    "poses that differ more: other configurations, wider joint ranges, varied load",
                )
            )
            continue
        narrowest = min(int(np.count_nonzero(group.any(axis=0))) for group in groups if np.any(group))
        if narrowest > most_columns(projected.freedom):
            untestable.append(_too_wide(projected, family, narrowest))
            continue
        tested.append(family)
        columns.append(groups)
        positive = tuple(all(p.positive for p in member.parameters) for member in family.members)
        evidence.append(
            evaluate_family(FamilyColumns(-projected.residual, groups, projected.freedom, positive))
        )
    corrected = holm([e.p_value for e in evidence])
    spans = {family.name: _span(groups) for family, groups in zip(tested, columns, strict=True)}
    candidates = [
        _candidate(projected, family, groups, e, p, spans)
        for family, groups, e, p in zip(tested, columns, evidence, corrected, strict=True)
    ]
    candidates.sort(key=lambda c: (-c.log_evidence, c.p_value))
    plain = cross_validated_rmse_mm(projected, np.zeros((len(projected.residual), 0)), np.zeros(0))
    return Screening(projected, tuple(candidates), tuple(untestable), plain)


def _too_wide(projected: ProjectedResidual, family: Family, columns: int) -> Untestable:
    """A family of which one member alone has more parameters than the equations bear."""
    poses = len(projected.residuals.observed.used_poses[0])
    more = int(np.ceil((2 * columns - projected.freedom) / 3))
    return Untestable(
        family.name,
        f"it has {columns} parameters at least, and the fit leaves {projected.freedom} equations to judge them by",
        f"{poses + more} training poses or more",
    )


def _visible(projected: ProjectedResidual, member: Effect) -> Array:
    """(R, K) a member's visible columns, for coefficients of usual size; zero where fitted parameters do the same."""
    scales = np.array([p.scale for p in member.parameters])
    raw = member_columns(projected, member) * scales
    visible = projected.visible(raw)
    size = np.linalg.norm(raw, axis=0)
    hidden = np.linalg.norm(visible, axis=0) <= np.maximum(_HIDDEN * size, 1e-9)
    visible[:, hidden] = 0.0
    return visible


def _candidate(
    projected: ProjectedResidual,
    family: Family,
    groups: tuple[Array, ...],
    evidence: Evidence,
    p_holm: float,
    spans: Mapping[str, Array],
) -> Candidate:
    active = [i for i, size in enumerate(evidence.scales) if size > 0.0 and np.any(groups[i])]
    columns = (
        np.concatenate([groups[i] for i in active], axis=1)
        if active
        else np.zeros((len(projected.residual), 0))
    )
    spread = (
        np.concatenate([np.full(groups[i].shape[1], evidence.scales[i]) for i in active])
        if active
        else np.zeros(0)
    )
    information = columns.T @ columns / projected.sigma**2 + np.diag(1.0 / np.maximum(spread, 1e-9) ** 2)
    sigma = np.sqrt(np.maximum(np.diag(np.linalg.inv(information)), 0.0)) if active else np.zeros(0)
    values: list[Value] = []
    prior_sigmas: dict[str, float] = {}
    for i in active:
        for parameter, coefficient in zip(
            family.members[i].parameters, evidence.coefficients[i], strict=True
        ):
            name = full_name(family.members[i], parameter)
            scale = parameter.scale
            values.append(
                Value(
                    name, float(coefficient) * scale, float(sigma[len(prior_sigmas)]) * scale, parameter.unit
                )
            )
            prior_sigmas[name] = float(evidence.scales[i]) * scale
    total = float(projected.residual @ projected.residual)
    left = projected.residual + evidence.explained  # the residual is predicted minus measured
    return Candidate(
        family=family,
        p_value=evidence.p_value,
        p_holm=p_holm,
        log_evidence=evidence.log_evidence,
        explained_share=1.0 - float(left @ left) / total if total > 0.0 else 0.0,
        cv_rmse_mm=cross_validated_rmse_mm(projected, columns, spread),
        members=tuple(family.members[i] for i in active),
        values=tuple(values),
        prior_sigmas=prior_sigmas,
        explained=-evidence.explained,
        overlaps={
            name: share
            for name, span in spans.items()
            if name != family.name and (share := _overlap(evidence.explained, span)) > 0.2
        },
    )


def _span(groups: tuple[Array, ...]) -> Array:
    """(R, rank) orthonormal directions that a family's columns make."""
    u, s, _ = np.linalg.svd(np.concatenate(groups, axis=1), full_matrices=False)
    return np.asarray(u[:, s > 1e-6 * s[0]])


def _overlap(explained: Array, span: Array) -> float:
    """Share of a signal (R,) that another family could make, by its `_span`."""
    size = float(explained @ explained)
    return float(np.sum((span.T @ explained) ** 2)) / size if size > 0.0 else 0.0


def cross_validated_rmse_mm(projected: ProjectedResidual, columns: Array, spread: Array) -> float:
    """RMS of a coordinate, mm, when each pose is predicted from all others (leave one pose out, linearised).

    e_i = (1 - H_ii)^-1 r_i for each pose's block of the hat matrix H of fitted directions and candidate; exact for a
    linear model with fixed sizes of the candidate's coefficients.
    """
    residual, shrunk = projected.residual, columns * spread
    nuisance = projected.nuisance
    if nuisance is not None:  # back to where each row is of one pose, with the nuisance as further columns
        uncertain = nuisance.directions * nuisance.sizes
        residual = nuisance.coloured(residual)
        shrunk = np.concatenate([uncertain, nuisance.coloured(shrunk)], axis=1)
    inner = np.linalg.inv(np.eye(shrunk.shape[1]) + shrunk.T @ shrunk)
    left = residual - shrunk @ (inner @ (shrunk.T @ residual))
    observed = projected.residuals.observed
    sigma_mm = np.sqrt(np.trace(observed.covariance_mm2, axis1=1, axis2=2) / 3.0)
    order = np.argsort(observed.points.pose, kind="stable")
    counts = np.unique(observed.points.pose, return_counts=True)[1]
    starts = np.cumsum(counts) - counts
    total = 0.0
    for count in np.unique(counts):  # all poses with this many points at once
        points = order[starts[counts == count][:, None] + np.arange(count)]  # (poses, count)
        rows = (3 * points[:, :, None] + np.arange(3)).reshape(len(points), -1)
        fitted, extra = projected.basis[rows], shrunk[rows]
        hat = fitted @ np.swapaxes(fitted, 1, 2) + extra @ inner @ np.swapaxes(extra, 1, 2)
        # Without a pose that alone determines a direction, I - H is singular; the floor keeps its error finite.
        error = np.linalg.solve((1.0 + 1e-9) * np.eye(rows.shape[1]) - hat, left[rows][..., None])[..., 0]
        total += float(np.sum((error * np.repeat(sigma_mm[points], 3, axis=1)) ** 2))
    return float(np.sqrt(total / len(residual)))
