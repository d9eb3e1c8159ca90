"""Evidence with one place left out: whether an explanation hangs on a single pose, or on a place with its repeats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.array_types import Array, IndexArray
from calib.dataset.repeats import groups_by_condition
from calib.effects.effect import full_name
from calib.screening.candidates import Candidate
from calib.screening.member_columns import visible_columns
from calib.screening.projected_residual import ProjectedResidual
from calib.statistics import group_numbers

_ALONE = 1e-9  # of 1, below which rows are all that determines a fitted direction


def pose_that_carries(candidate: Candidate, rivals: Sequence[Candidate], projected: ProjectedResidual) -> str | None:
    """Pose (id), with its repeats, without which a candidate has no evidence, or none over a rival that it leads.

    None where it keeps both whichever is left out.
    """
    poses, row = projected.residuals.observed.used_poses
    of_point = group_numbers(groups_by_condition(poses)[row])
    group = np.repeat(of_point, projected.coordinates)
    own = candidate.log_evidence + _changes(candidate, projected, group)
    over = [own - rival.log_evidence - _changes(rival, projected, group) for rival in rivals]
    least = np.min([own, *over], axis=0)
    worst = int(np.argmin(least))
    return poses.ids[row[np.flatnonzero(of_point == worst)[0]]] if least[worst] < 0.0 else None


def _changes(candidate: Candidate, projected: ProjectedResidual, group: IndexArray) -> Array:
    """Change of a candidate's log evidence with each group of rows left out."""
    columns = visible_columns(projected, replace(candidate.family, members=candidate.members, sparse=False)).groups
    sizes = [candidate.prior_sigmas[full_name(m, p)] / p.scale for m in candidate.members for p in m.parameters]
    shaped, residual = np.concatenate(columns, axis=1) * sizes, projected.residual
    uncertain = np.zeros((len(residual), 0))
    if projected.nuisance is not None:  # back to where each row is of one pose, with the nuisance as further columns
        uncertain = projected.nuisance.directions * projected.nuisance.sizes
        shaped, residual = projected.nuisance.coloured(shaped), projected.nuisance.coloured(residual)
    both = np.concatenate([shaped, uncertain], axis=1)
    changes = [changes_without_each(residual, one, projected.basis, group, projected.dof) for one in (both, uncertain)]
    return changes[0] - changes[1]


def changes_without_each(residual: Array, shaped: Array, basis: Array, group: IndexArray, dof: int) -> Array:
    """Change (P,) of the log evidence of an explanation where the rows of each of P groups are left out.

    To leave rows out is to project them out, too, so that nothing is fitted again: exact for prior sigmas that stay.

    Args:
        residual: (R,) projected.
        shaped: (R, K) projected columns times the prior sigmas of their coefficients.
        basis: (R, B) orthonormal, of the directions that were projected out.
        group: (R,) number of each row's group.
        dof: degrees of freedom of the residual.
    """
    both = np.column_stack([shaped, residual])
    square = both.T @ both
    whole = _log_evidence(square, dof)
    out = []
    for number in range(int(group.max(initial=-1)) + 1):
        rows = np.flatnonzero(group == number)
        free, turn = np.linalg.eigh(np.eye(len(rows)) - basis[rows] @ basis[rows].T)
        kept = free > _ALONE
        gone = (turn[:, kept] / np.sqrt(free[kept])).T @ both[rows]
        out.append(_log_evidence(square - gone.T @ gone, dof - int(kept.sum())) - whole)
    return np.array(out)


def _log_evidence(square: Array, dof: int) -> float:
    """Log evidence over noise alone, from the products (K + 1, K + 1) of shaped columns and residual, which is last."""
    inner, along, total = np.eye(len(square) - 1) + square[:-1, :-1], square[:-1, -1], float(square[-1, -1])
    left = total - float(along @ np.linalg.solve(inner, along))
    share = max(left, 1e-14 * total) / max(total, 1e-300)
    return -0.5 * float(np.linalg.slogdet(inner)[1]) - 0.5 * max(dof, 0) * float(np.log(max(share, 1e-300)))
