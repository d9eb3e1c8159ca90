"""The papers' iteration as printed, for comparison by `solver.py`; not a script.

Jang 2025 eq (16): x <- x - J^+ r, again and again; millimetres and radians as they are, no damping, no prior.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.calibration.evaluation import evaluate
from calib.dataset.dataset import Dataset
from calib.fitting.model import Model
from calib.fitting.observations import Observations
from calib.fitting.position_residuals import PositionResiduals

Linearise = Callable[[Array], tuple[Array, Array]]
Cost = Callable[[Array], float]

EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Outcome:
    """How a fit, or the plain iteration, ended; cost and held-out RMSE over those of the nominal arm."""

    cost: float
    held_out: float
    largest: float  # the largest cost on the way
    steps: int
    converged: bool = False


def held_out_mm(model: Model, x: Array, dataset: Dataset) -> float:
    """3D RMSE of the test poses; inf where the model is not finite any more."""
    with np.errstate(all="ignore"):
        try:
            figures = evaluate(model, x, dataset).test
        except (np.linalg.LinAlgError, ValueError):
            return np.inf
    assert figures is not None
    return figures.rmse_mm if np.isfinite(figures.rmse_mm) else np.inf


def plain(linearise: Linearise, cost: Cost, model: Model, dataset: Dataset, nominal_mm: float) -> Outcome:
    """Jang eq (16): the pseudo-inverse step again and again."""
    x = np.zeros(len(model.parameters))
    start, largest, share = cost(x), 1.0, 1.0
    with np.errstate(all="ignore"):
        for step in range(20):
            residual, jacobian = linearise(x)
            try:
                x = x - np.linalg.pinv(jacobian, rcond=max(jacobian.shape) * EPS) @ residual
                share = cost(x) / start
            except np.linalg.LinAlgError:
                return Outcome(np.inf, np.inf, np.inf, step)
            largest = max(largest, share) if np.isfinite(share) else np.inf
    return Outcome(share, held_out_mm(model, x, dataset) / nominal_mm, largest, 20)


def plain_positions(model: Model, observed: Observations) -> tuple[Linearise, Cost]:
    """Residual and Jacobian of the points with the frame projected out, in mm."""
    residuals = PositionResiduals(model, observed)

    def linearise(x: Array) -> tuple[Array, Array]:
        at = residuals.linearise(x)
        return at.residual, at.jacobian

    return linearise, lambda x: float(np.sum(residuals.residual(x) ** 2))


def plain_distances(model: Model, observed: Observations) -> tuple[Linearise, Cost]:
    """Jang eq (14): rows L_N^2 - L_M^2 and 2 (P_k - P_1)^T (J_k - J_1)."""
    poses, _ = observed.used_poses
    seen_mm = observed.points.xyz_mm
    square = np.sum((seen_mm[1:] - seen_mm[0]) ** 2, axis=1)

    def linearise(x: Array) -> tuple[Array, Array]:
        base_mm, by_x = model.linearise(x, poses)
        along = base_mm[1:] - base_mm[0]
        return np.sum(along**2, axis=1) - square, 2.0 * np.einsum("ki,kip->kp", along, by_x[1:] - by_x[0])

    def cost(x: Array) -> float:
        base_mm = model.predict(x, poses)
        length = np.linalg.norm(base_mm[1:] - base_mm[0], axis=1)
        return float(np.sum((length - np.sqrt(square)) ** 2))

    return linearise, cost
