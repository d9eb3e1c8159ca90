"""Evidence with one place left out: whether an explanation hangs on a single pose, or on a place with its repeats."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array, IndexArray

_ALONE = 1e-9  # of 1, below which rows are all that determines a fitted direction


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
