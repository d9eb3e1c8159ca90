"""Redundant parameters: the Pearson redundancy matrix (Park 2022, section 3), and the rank of the Jacobian.

Columns of the Jacobian that are proportional to each other can only be identified as one sum. Pearson's r between all
pairs finds them, |r| = 1; columns of zeros (r undefined, NaN) have no influence. One parameter of each group is kept.
Park treats lengths (a, d) and angles (alpha, theta, beta) apart.

Pairs are not enough: a length can be proportional to an angle, and three or more columns can be linearly dependent
although no two are proportional. The rank counts the parameters that can be identified; `combinations` lists the
further dependencies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array, BoolArray
from calib.errors import FitError
from calib.lazy_modules import pd
from calib.presented import Presented

_SAME = 1e-8  # |r| this close to 1 is redundant
_ZERO = 1e-9  # norm of a column, as a share of the largest of its unit, below which it has no influence
_DEPENDENT = 1e-8  # norm of a unit column after projection, below which it depends on the others


@dataclass(frozen=True)
class Redundancy(Presented):
    """Linear dependencies between the columns of a Jacobian (R, P)."""

    parameters: tuple[str, ...]  # (P,)
    units: tuple[str, ...]  # (P,) "mm" or "rad", ...
    pearson: Array  # (P, P), NaN in rows and columns without influence
    no_influence: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]  # Park's: |r| = 1 among parameters of one unit
    kept: tuple[str, ...]  # Park's: all but the later members of each group
    mixed_groups: tuple[tuple[str, ...], ...]  # |r| = 1 among all parameters, where units differ
    rank: int  # of the Jacobian: how many parameters can be identified
    independent: tuple[str, ...]  # the first `rank` parameters with independent columns
    combinations: tuple[dict[str, float], ...]  # coefficients of corrections that cancel: three or more parameters
    measured_by: str = ""  # the measurements, as text
    observed: str = "the measured point"  # what parameters without influence leave unchanged

    @property
    def dropped(self) -> dict[str, str]:
        """Reason, by parameter name, why a parameter is not among the independent ones."""
        why = dict.fromkeys(self.no_influence, "no influence on what is measured")
        for group in (*self.groups, *self.mixed_groups):
            why |= {name: f"acts like {group[0]}" for name in group[1:] if name not in why}
        for relation in self.combinations:
            *others, last = relation
            why.setdefault(last, f"acts like {', '.join(others)} together")
        for name in self.parameters:
            if name not in self.independent:
                why.setdefault(name, "a combination of parameters before it")
        return {name: reason for name, reason in why.items() if name not in self.independent}

    def to_frame(self) -> pd.DataFrame:
        """Pearson matrix as a table labelled with the parameters' names."""
        return pd.DataFrame(self.pearson, index=self.parameters, columns=self.parameters)

    def _brief(self) -> str:
        return f"{len(self.parameters)} parameters, rank {self.rank}, {len(self.dropped)} dropped"


def pearson_matrix(jacobian: ArrayLike, is_zero: ArrayLike | None = None) -> Array:
    """Pearson's r (P, P) between all columns of a Jacobian (R, P), NaN where a column is zero (Park 2022)."""
    columns = np.asarray(jacobian, dtype=float)
    centred = columns - columns.mean(axis=0)
    norm = np.linalg.norm(centred, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = centred / norm
    unit[:, norm <= 0.0] = np.nan
    if is_zero is not None:
        unit[:, np.asarray(is_zero, dtype=bool)] = np.nan
    r = unit.T @ unit
    np.fill_diagonal(r, np.where(np.isnan(np.diag(r)), np.nan, 1.0))
    return np.clip(r, -1.0, 1.0)


def analyse(
    jacobian: ArrayLike,
    parameters: tuple[str, ...],
    units: tuple[str, ...],
    *,
    unprojected_norms: ArrayLike | None = None,
    measured_by: str = "",
    observed: str = "the measured point",
) -> Redundancy:
    """Redundancy of parameters by the columns of a Jacobian (R, P), in the parameters' own units.

    Args:
        unprojected_norms: (P,) norms of the columns before other unknowns were projected out of them; a column counts
            as zero in comparison with these. Their own norms where None.
        measured_by, observed: texts, see `Redundancy`.

    Raises FitError where the Jacobian has fewer than two rows or is not finite.
    """
    columns = np.asarray(jacobian, dtype=float)
    if columns.ndim != 2 or columns.shape[0] < 2 or columns.shape[1] != len(parameters):
        raise FitError(f"redundancy needs two rows or more and a column a parameter, got {columns.shape}")
    if not np.all(np.isfinite(columns)):
        raise FitError("the Jacobian is not finite; check the robot's table and the joint angles")
    norm = np.linalg.norm(columns, axis=0)
    whole = norm if unprojected_norms is None else np.asarray(unprojected_norms, dtype=float)
    largest = np.array([max((n for n, v in zip(whole, units, strict=True) if v == u), default=0.0) for u in units])
    is_zero = norm <= _ZERO * np.maximum(largest, 1e-300)
    pearson = pearson_matrix(columns, is_zero)
    same_unit = np.array([[a == b for b in units] for a in units])
    groups = _groups(pearson, same_unit, parameters)
    every_group = _groups(pearson, np.ones_like(same_unit), parameters)
    dropped = {name for group in groups for name in group[1:]}
    independent, relations = _dependencies(columns, is_zero, parameters)
    paired = {name for group in every_group for name in group[1:]}
    return Redundancy(
        parameters=parameters,
        units=units,
        pearson=pearson,
        no_influence=tuple(p for p, zero in zip(parameters, is_zero, strict=True) if zero),
        groups=groups,
        kept=tuple(p for p in parameters if p not in dropped),
        mixed_groups=tuple(group for group in every_group if group not in groups),
        rank=len(independent),
        independent=independent,
        combinations=tuple(r for name, r in relations.items() if name not in paired),
        measured_by=measured_by,
        observed=observed,
    )


def _groups(pearson: Array, allowed: BoolArray, names: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """Groups of redundant parameters: those whose |r| with the group's first parameter is 1."""
    alike = (np.abs(np.nan_to_num(pearson)) >= 1.0 - _SAME) & allowed
    grouped: set[int] = set()
    groups = []
    for i in range(len(names)):
        members = [j for j in np.flatnonzero(alike[i]) if j >= i and j not in grouped]
        if i not in grouped and len(members) > 1:
            groups.append(tuple(names[j] for j in members))
            grouped.update(int(j) for j in members)
    return tuple(groups)


def _dependencies(
    columns: Array, is_zero: BoolArray, names: tuple[str, ...]
) -> tuple[tuple[str, ...], dict[str, dict[str, float]]]:
    """Names of the independent parameters (first columns that span all others), and relations for the others."""
    norm = np.where(is_zero, 1.0, np.linalg.norm(columns, axis=0))
    unit = columns / norm
    chosen: list[int] = []
    basis = np.empty((len(columns), 0))
    relations: dict[str, dict[str, float]] = {}
    for j in np.flatnonzero(~is_zero):
        rest = unit[:, j] - basis @ (basis.T @ unit[:, j])
        rest -= basis @ (basis.T @ rest)  # once more: rounding of the first pass
        size = float(np.linalg.norm(rest))
        if size > _DEPENDENT:
            chosen.append(int(j))
            basis = np.column_stack([basis, rest / size])
            continue
        weights, *_ = np.linalg.lstsq(unit[:, chosen], unit[:, j], rcond=None)
        used = [(k, w) for k, w in zip(chosen, weights, strict=True) if abs(w) > 1e-6]
        if len(used) >= 2:
            # Corrections x with J x = 0, in lowest form: the smallest coefficient is 1, the first is positive.
            relation = {names[k]: -float(w * norm[j] / norm[k]) for k, w in used} | {names[j]: 1.0}
            unit_size = min(map(abs, relation.values())) * np.sign(next(iter(relation.values())))
            relations[names[j]] = {name: float(f"{value / unit_size:.9g}") for name, value in relation.items()}
    return tuple(names[k] for k in chosen), relations
