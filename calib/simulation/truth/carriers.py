"""Which joints of a simulated arm carry an effect, and in which proportion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.simulation.truth.effect import TrueEffect
from calib.simulation.truth.visibility import SimulatedCell

Rng = np.random.Generator
PerJoint = Callable[[Array], TrueEffect]


def magnitudes(cell: SimulatedCell, rng: Rng, *, signed: bool = False) -> Array:
    """(n,) 0.5 to 1.5 each for joints that turn, 0 for others."""
    n = cell.nominal.n_joints
    sign = rng.choice([-1.0, 1.0], n) if signed else 1.0
    return rng.uniform(0.5, 1.5, n) * sign * cell.nominal.is_revolute


def carriers(cell: SimulatedCell, rng: Rng, make: PerJoint, size: Array) -> Array:
    """(n,) `size` kept for the joints that carry the effect: all, or 1 to 3; never only joints that show nothing.

    A joint shows something when a geometric fit leaves 5 % or more of what it leaves of the most visible joint.
    """
    seen_mm = np.array(
        [
            cell.visible_rms_mm(make(size * row)) if value else 0.0
            for row, value in zip(np.eye(len(size)), size, strict=True)
        ]
    )
    if not seen_mm.max() > 0:
        raise CalibError(f"{make(size).name} does nothing to robot {cell.nominal.name} at these poses")
    showing = np.flatnonzero(seen_mm > 0.05 * seen_mm.max())
    if rng.random() < 0.5:
        return size
    kept = rng.choice(showing, min(int(rng.integers(1, 4)), len(showing)), replace=False)
    return np.where(np.isin(np.arange(len(size)), kept), size, 0.0)


def one_joint(cell: SimulatedCell, rng: Rng, make: PerJoint) -> Array:
    """(n,) 1e-4 for one joint that shows the effect, either sign."""
    size = 1e-4 * cell.nominal.is_revolute
    seen_mm = np.array([cell.visible_rms_mm(make(size * row)) for row in np.eye(len(size))])
    joint = rng.choice(np.flatnonzero(seen_mm > 0.2 * seen_mm.max()))
    return np.eye(len(size))[joint] * 1e-4 * rng.choice([-1.0, 1.0])
