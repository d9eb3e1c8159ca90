"""Floors of the comparison: the arm as delivered, a plain fit of Denavit-Hartenberg rows, and one with waves of the
joints.

"nominal": the table as it is.
"dh": all rows by scipy's least squares, each setup placed by its best motion; no prior, no choice of parameters.
"waves": then the waves n = 1 ... 45 of every joint's angle, together by a ridge whose size five-fold cross-validation
over the
training poses chooses. No single cause is told, and no table comes out that a controller takes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy
from problem import Answer, Array, Problem, onto
from scipy.optimize import least_squares

from tools.dh import points_of

WAVES = 45
RIDGES = np.geomspace(1e-2, 1e12, 43)
STEP = 1e-6


def calibrate(problem: Problem, folder: Path, variant: str) -> Answer:
    """The variant's answer."""
    del folder
    version = f"scipy {scipy.__version__}"
    if variant == "nominal":
        return Answer(points_of(problem.table, problem.q), 0, version=version)
    q, points, setup = problem.training
    scale = np.where(np.arange(problem.table.size) % 2, 1e-2, 1.0)  # alpha and theta stand second and fourth

    def table_of(x: Array) -> Array:
        return problem.table + (x * scale).reshape(problem.table.shape)

    def errors(x: Array) -> Array:
        predicted = points_of(table_of(x), q)
        return (in_base(points, predicted, setup) - predicted).ravel()

    found = least_squares(errors, np.zeros(problem.table.size), method="trf")
    table = table_of(found.x)
    predicted = points_of(table, problem.q)
    if variant == "dh":
        return Answer(predicted, found.x.size, found.message, version=version)
    columns = wave_columns(table, problem.q)
    train = ~problem.is_test
    by_table = table_columns(table, problem.q)
    freely = [by_table[train].reshape(-1, table.size), frame_columns(predicted[train], setup)]
    left = in_base(points, predicted[train], setup) - predicted[train]
    sizes, beside, ridge = ridge_fit(
        columns[train].reshape(-1, columns.shape[2]), np.concatenate(freely, axis=1), left.ravel()
    )
    moved = predicted + columns @ sizes + by_table @ beside[: table.size]
    return Answer(moved, found.x.size + sizes.size, f"ridge {ridge:.3g} by cross-validation", version=version)


def in_base(points: Array, predicted: Array, setup: Array) -> Array:
    """Measured points brought to the base frame, each setup by its best motion."""
    out = np.empty_like(points)
    for name in np.unique(setup):
        rows = setup == name
        turn, shift = onto(points[rows], predicted[rows])
        out[rows] = points[rows] @ turn.T + shift
    return out


def table_columns(table: Array, q: Array) -> Array:
    """Changes (N, 3, P) of the points by each of the table's entries."""
    at = points_of(table, q)
    out = []
    for k in range(table.size):
        moved = table.copy()
        moved.flat[k] += STEP
        out.append((points_of(moved, q) - at) / STEP)
    return np.stack(out, axis=2)


def frame_columns(at: Array, setup: Array) -> Array:
    """Changes (3 N, 6 S) of the points by small motions of each setup's frame."""
    out = []
    for name in np.unique(setup):
        rows = (setup == name)[:, None]
        for axis in np.eye(3):
            out += [(rows * axis).ravel(), (rows * np.cross(axis, at - at.mean(0))).ravel()]
    return np.stack(out, axis=1)


def wave_columns(table: Array, q: Array) -> Array:
    """Changes (N, 3, K) of the points by cosine and sine of 1 ... WAVES times each joint's angle, as an error of it."""
    at, out = points_of(table, q), []
    for k in range(q.shape[1]):
        moved = q.copy()
        moved[:, k] += STEP
        by_joint = (points_of(table, moved) - at) / STEP
        angles = q[:, k, None] * np.arange(1, WAVES + 1)
        shapes = np.concatenate([np.cos(angles), np.sin(angles)], axis=1)
        out.append(by_joint[:, :, None] * shapes[:, None])
    return np.concatenate(out, axis=2)


def ridge_fit(columns: Array, freely: Array, values: Array) -> tuple[Array, Array, float]:
    """Sizes of penalised columns and of free ones, and the penalty that five-fold cross-validation by poses chose."""
    fold = np.repeat(np.random.default_rng(0).permutation(len(values) // 3) % 5, 3)
    missed = np.zeros(len(RIDGES))
    for k in range(5):
        seen, unseen = fold != k, fold == k
        for i, (sizes, beside) in enumerate(_ridges(columns[seen], freely[seen], values[seen])):
            missed[i] += np.sum((values[unseen] - columns[unseen] @ sizes - freely[unseen] @ beside) ** 2)
    best = int(np.argmin(missed))
    return *_ridges(columns, freely, values)[best], float(RIDGES[best])


def _ridges(columns: Array, freely: Array, values: Array) -> list[tuple[Array, Array]]:
    """Sizes of penalised and of free columns for each of `RIDGES`."""
    inverse = np.linalg.pinv(freely, rcond=1e-7)
    shown, rest = columns - freely @ (inverse @ columns), values - freely @ (inverse @ values)
    u, s, vt = np.linalg.svd(shown, full_matrices=False)
    sizes = [vt.T @ (s * (u.T @ rest) / (s**2 + ridge)) for ridge in RIDGES]
    return [(one, inverse @ (values - columns @ one)) for one in sizes]
