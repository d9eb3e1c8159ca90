"""Jacobian columns of effects not yet in a model: the residual's change by each parameter, and its visible part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, IndexArray
from calib.effects.effect import Effect, Family, Parameter
from calib.effects.shaped import Displacement, ShapedEffect
from calib.effects.state import RobotState
from calib.fitting.model import effect_columns
from calib.screening.evidence import Evidence, FamilyColumns, evaluate_family
from calib.screening.projected_residual import ProjectedResidual
from calib.screening.sparse_evidence import SparseColumns, evaluate_sparse

_HIDDEN = 0.02  # share of a column that projection has to leave: below it, fitted parameters do the same


@dataclass(frozen=True)
class VisibleColumns:
    """Jacobian columns (R, K) of each member of an effect, per usual size, with the fitted directions projected out."""

    family: Family
    groups: tuple[Array, ...]
    stacked: Array | None = None  # (R, G, K) columns of a sparse family, of which the groups are parts
    shapes: Array | None = None  # (G, N) shapes of its members, where they are `ShapedEffect`s
    of_same: IndexArray | None = None  # (G,) members with the same number are shapes of the same displacement

    @property
    def narrowest(self) -> int:
        """Least number of visible columns among the effect's members that have any; 0 where none has."""
        if self.stacked is not None:
            counts = np.count_nonzero(self.stacked.any(axis=0), axis=1)
        else:
            counts = np.array([np.count_nonzero(group.any(axis=0)) for group in self.groups])
        return int(min(counts[counts > 0], default=0))

    def evaluate(self, residual: Array, dof: int) -> Evidence:
        """Evidence for the effect in a residual (R,), measured minus predicted."""
        if self.stacked is not None:
            one_sided = all(p.positive for p in self.family.members[0].parameters)
            most, superposed = self.family.most_members, self.family.superposed
            columns = SparseColumns(
                residual, self.stacked, dof, one_sided, most, self.shapes, self.of_same, superposed=superposed
            )
            return evaluate_sparse(columns)
        positive = tuple(all(p.positive for p in member.parameters) for member in self.family.members)
        return evaluate_family(FamilyColumns(residual, self.groups, dof, positive))

    def shares(self, signals: Array) -> Array:
        """Share (F,) of each signal (R, F) that the effect could explain (by one member if the family is sparse)."""
        if self.stacked is not None:
            return SparseColumns(np.zeros(len(signals)), self.stacked, 0).shares(signals)
        u, s, _ = np.linalg.svd(np.concatenate(self.groups, axis=1), full_matrices=False)
        span = u[:, s > 1e-6 * s[0]]
        return np.sum((span.T @ signals) ** 2, axis=0) / np.maximum(np.sum(signals**2, axis=0), 1e-300)


def visible_columns(projected: ProjectedResidual, family: Family) -> VisibleColumns:
    """Jacobian columns of an effect's members after projecting out the fitted parameters."""
    members = family.members
    if not family.sparse:
        return VisibleColumns(family, tuple(_visible(projected, member) for member in members))
    shapes, of_same = None, None
    shaped = [member for member in members if isinstance(member, ShapedEffect)]
    if len(shaped) == len(members):
        raw, shapes, of_same = _of_shapes(projected, shaped)
    else:
        raw = np.stack([member_columns(projected, member) for member in members], axis=1)
    scales = np.array([[p.scale for p in member.parameters] for member in members])
    raw = raw.reshape(len(raw), -1) * scales.ravel()
    stacked = _without_hidden(raw, projected.visible(raw)).reshape(len(raw), len(members), -1)
    return VisibleColumns(family, tuple(np.moveaxis(stacked, 1, 0)), stacked, shapes, of_same)


def member_columns(projected: ProjectedResidual, member: Effect) -> Array:
    """Derivative (R, K) of the whitened residual by an effect's parameters at zero, before projection."""
    observed = projected.residuals.observed
    _, row = observed.used_poses
    columns = np.empty((len(observed.points), 3, len(member.parameters)))
    for target, state in projected.states.items():
        by_value = effect_columns(projected.by_state[target], member, state, np.zeros(columns.shape[-1]))
        of_target = observed.points.target == target
        columns[of_target] = by_value[row[of_target]]
    return (projected.base_to_residual @ columns).reshape(-1, columns.shape[-1])


def displacement_columns(projected: ProjectedResidual, members: Sequence[ShapedEffect]) -> Array:
    """Derivative (M, 3, W) of the whitened residual by the displacements that some step or dent effects scale.

    Each displacement is taken once, however many members share it; before projection.
    """
    sizes: dict[Displacement, Array] = {}
    for member in members:
        width = member.displacement.width
        sizes[member.displacement] = np.array([p.scale for p in member.parameters[:width]])
    columns = [member_columns(projected, _Unit(one)) * size for one, size in sizes.items()]
    together = np.concatenate(columns, axis=1)
    return together.reshape(-1, projected.coordinates, together.shape[1])


def _visible(projected: ProjectedResidual, member: Effect) -> Array:
    """Jacobian columns (R, K) of an effect, per usual size, projected; zero where fitted parameters act alike."""
    raw = member_columns(projected, member) * np.array([p.scale for p in member.parameters])
    return _without_hidden(raw, projected.visible(raw))


def _without_hidden(raw: Array, visible: Array) -> Array:
    """Projected Jacobian columns, set to zero where projection left almost nothing of the raw columns."""
    size = np.linalg.norm(raw, axis=0)
    hidden = np.linalg.norm(visible, axis=0) <= np.maximum(_HIDDEN * size, 1e-9)
    visible[:, hidden] = 0.0
    return visible


@dataclass(frozen=True)
class _Unit:
    """Effect that displaces the arm by one constant unit at all poses."""

    displacement: Displacement
    name = "unit"
    linear = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"amount{k}", "1", 1e-3) for k in range(self.displacement.width))

    def apply(self, state: RobotState, **values: float) -> RobotState:
        amounts = np.broadcast_to(np.array(list(values.values())), (len(state.poses), len(values)))
        return self.displacement.act(state, amounts)


def _of_shapes(projected: ProjectedResidual, members: Sequence[ShapedEffect]) -> tuple[Array, Array, IndexArray]:
    """Jacobian columns (R, G, K) of G effects that scale the same few displacements by different shapes.

    With the shapes (G, N), those of one member in a row, and the number of each one's displacement (G,).
    """
    row = projected.residuals.observed.used_poses[1]
    shapes = np.stack([member.shapes(projected.state) for member in members])  # (G, N, L)
    displacements = [member.displacement for member in members]
    number = {displacement: k for k, displacement in enumerate(dict.fromkeys(displacements))}
    of_same = np.array([number[displacement] for displacement in displacements])
    count, width = len(members), shapes.shape[2] * displacements[0].width
    rows = projected.coordinates * len(row)
    raw = np.empty((rows, count, width))
    for displacement, k in number.items():
        unit = member_columns(projected, _Unit(displacement)).reshape(len(row), projected.coordinates, -1)  # (M, C, W)
        at = np.flatnonzero(of_same == k)
        columns = np.einsum("mcw,gml->mcglw", unit, shapes[at][:, row])
        raw[:, at] = columns.reshape(rows, len(at), width)
    return raw, shapes.reshape(count, -1), of_same
