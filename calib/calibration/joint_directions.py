"""How each joint's own motion would show at the measured points."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.fitting.model import Model
from calib.fitting.observations import Observations, linearise_points


def directions_at(model: Model, x: Array, observed: Observations, base_to_residual: Array) -> list[Array]:
    """For each joint (M, 3): how its motion moves the measured points, whitened, mm (or mm/rad) over sigma.

    A joint is moved as its theta (d where it is prismatic) is; one whose parameter is held gets zeros.

    Args:
        model, x: the fitted model, x (P,).
        observed: M points whose scanner is placed.
        base_to_residual: (M, 3, 3) from a motion in the base frame, mm, to the residual's whitened rows.
    """
    by_x = linearise_points(model, x, observed)[1]
    names = [p.name for p in model.parameters]
    out = []
    for j, joint in enumerate(model.robot.joints):
        kind = "theta" if joint.is_revolute else "d"
        name = f"{kind}{j + 1}"
        if name in names:
            column = by_x[:, :, [names.index(name)]]
            out.append((base_to_residual @ column)[..., 0])
        else:
            out.append(np.zeros((len(by_x), 3)))
    return out
