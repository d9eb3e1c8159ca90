"""Effects that a simulation draws by their names, and the choice of joints that carry one.

A fault is seldom spread evenly: about half of the time one to three joints carry all of it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.simulation.truth.effect import TrueEffect
from calib.simulation.truth.visibility import SimulatedCell

Rng = np.random.Generator
PerJoint = Callable[[Array], TrueEffect]


class SampledEffect(TrueEffect):
    """An effect that can be simulated by its name: `draw` chooses the joints that carry it, and in which proportion.

    A subclass with a `name` in a module of `calib.simulation.truth` is registered when it is defined. The name is that
    of the catalogue's class (`calib.effects.catalogue`); the code is independent of it, and no law is linearised.
    """

    in_catalogue: ClassVar[bool] = True  # False: a cause that a diagnosis cannot name and has to leave unexplained
    needs_conditions: ClassVar[bool] = False  # payload, temperature, time and approach at every pose
    needs_facing_jig: ClassVar[bool] = False  # the jig turned at a scanner that does not move with the arm
    unrecorded: ClassVar[tuple[str, ...]] = ()  # conditions that its dataset does not have, so that it shows

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if cls.__module__.startswith(_TRUTH) and "name" in vars(cls):
            if cls.name in _REGISTERED:
                raise TypeError(f"effect {cls.__qualname__} has the name {cls.name!r} of another")
            _REGISTERED[cls.name] = cls

    @classmethod
    @abstractmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """The effect in random proportions on a cell's arm; its magnitude is set afterwards.

        Raises CalibError where the arm lacks what the effect needs.
        """


_TRUTH = "calib.simulation.truth."
_REGISTERED: dict[str, type[SampledEffect]] = {}  # by name; filled as the modules of the truth are imported


def registered_effects() -> dict[str, type[SampledEffect]]:
    """Classes of the effects that are defined so far, by name, in alphabetical order.

    `calib.simulation.truth.arm_sampling.SIMULATED` is all of them.
    """
    return dict(sorted(_REGISTERED.items()))


def magnitudes(cell: SimulatedCell, rng: Rng, *, signed: bool = False) -> Array:
    """Random relative magnitudes (n,): 0.5 to 1.5 for each revolute joint, 0 for others."""
    n = cell.nominal.n_joints
    sign = rng.choice([-1.0, 1.0], n) if signed else 1.0
    return rng.uniform(0.5, 1.5, n) * sign * cell.nominal.is_revolute


def carriers(cell: SimulatedCell, rng: Rng, make: PerJoint, size: Array) -> Array:
    """Magnitudes (n,): `size` for the joints with the effect, which are all or 1 to 3 visible ones; 0 for the others.

    A joint is visible when a geometric fit leaves 5 % or more of what it leaves of the most visible joint.
    """
    visible_mm = np.array(
        [
            cell.visible_rms_mm(make(size * row)) if value else 0.0
            for row, value in zip(np.eye(len(size)), size, strict=True)
        ]
    )
    if not visible_mm.max() > 0:
        raise CalibError(f"{make(size).name} does nothing to robot {cell.nominal.name} at these poses")
    visible = np.flatnonzero(visible_mm > 0.05 * visible_mm.max())
    if rng.random() < 0.5:
        return size
    kept = rng.choice(visible, min(int(rng.integers(1, 4)), len(visible)), replace=False)
    return np.where(np.isin(np.arange(len(size)), kept), size, 0.0)


def one_joint(cell: SimulatedCell, rng: Rng, make: Callable[[Array], SampledEffect]) -> SampledEffect:
    """Effect that `make` makes of magnitudes (n,): 1e-4 of either sign for one visible joint, 0 for others."""
    size = 1e-4 * cell.nominal.is_revolute
    visible_mm = np.array([cell.visible_rms_mm(make(size * row)) for row in np.eye(len(size))])
    joint = rng.choice(np.flatnonzero(visible_mm > 0.2 * visible_mm.max()))
    return make(np.eye(len(size))[joint] * 1e-4 * rng.choice([-1.0, 1.0]))
