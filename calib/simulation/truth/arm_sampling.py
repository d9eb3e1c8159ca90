"""Draw the arm that a simulation measures: link errors, and effects whose magnitudes are realistic on that arm.

What the drawn arm does is worked out in `calib.simulation.truth.equilibrium`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.errors import CalibError
from calib.kinematics.robot import Robot
from calib.simulation.truth.effect import TrueEffect
from calib.simulation.truth.effect_sampling import CATALOGUE, OUTSIDE
from calib.simulation.truth.equilibrium import Truth
from calib.simulation.truth.mechanism import STANDARD, Conditions
from calib.simulation.truth.visibility import SimulatedCell

SIMULATED_EFFECTS = tuple(CATALOGUE)
OUTSIDE_EFFECTS = tuple(OUTSIDE)
NEED_CONDITIONS = frozenset({"backlash", "thermal_growth", "scanner_drift", "warm_up"})
NEED_FACING = frozenset({"incidence_bias"})  # the incidence of a jig that faces away is undefined

Wanted = str | tuple[str, float] | TrueEffect
"""An effect to simulate: by name, by name with its visible size in noise sigmas, or with all its parameters."""


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations from which link errors are drawn, every parameter of every row by itself."""

    length_mm: float = 0.3
    angle_deg: float = 0.1


TYPICAL = Tolerances()


def draw_truth(
    robot: Robot,
    base_T_scanner: ArrayLike | Mapping[str, Array],
    q: Array,
    *,
    rng: np.random.Generator,
    effects: Sequence[Wanted] = (),
    tolerances: Tolerances = TYPICAL,
    conditions: Conditions = STANDARD,
    noise_mm: float | None = None,
    visible_sigmas: float | None = None,
    base_T_jig: Array | None = None,
) -> Truth:
    """Draw an arm: link errors from the tolerances, and effects whose magnitudes are realistic at the poses q (N, n).

    Each effect gets the magnitude asked for: a visible part (`calib.simulation.truth.visibility`) of so many `noise_mm`
    a coordinate. Without a request it moves the measured point by 0.2 to 0.5 mm rms. `base_T_jig` (4, 4) is where the
    jig stands for an arm that carries the scanner; `base_T_scanner` is then its place on the flange.

    Raises:
        CalibError: an unknown effect, one that is visible at no magnitude, or a robot that lacks what the effect needs.
    """
    check_effects(effects)
    angle_rad = np.radians(tolerances.angle_deg)
    sigma = np.array([tolerances.length_mm, angle_rad, tolerances.length_mm, angle_rad, angle_rad])
    table = robot.table + sigma * rng.standard_normal(robot.table.shape)
    scanners = base_T_scanner if isinstance(base_T_scanner, Mapping) else {"": np.asarray(base_T_scanner, float)}
    truth = Truth(robot.with_table(table), scanners, base_T_jig=base_T_jig)
    cell = SimulatedCell(robot, truth, q, conditions)
    drawn = []
    for wanted in effects:
        if isinstance(wanted, TrueEffect):
            drawn.append(wanted)
            continue
        name, sigmas = (wanted, visible_sigmas) if isinstance(wanted, str) else wanted
        effect = (CATALOGUE | OUTSIDE)[name](cell, rng)
        if sigmas is None:
            drawn.append(cell.scaled_to_moved(effect, rng.uniform(0.2, 0.5)))
        elif not noise_mm or noise_mm < 0:
            raise CalibError("a visible size is counted in noise sigmas; give noise_mm above 0")
        else:
            drawn.append(cell.scaled_to_visible(effect, sigmas * noise_mm))
    return truth.with_effects(*drawn)


def effect_name(wanted: Wanted) -> str:
    """What an effect is called, however it is asked for."""
    return wanted if isinstance(wanted, str) else wanted.name if isinstance(wanted, TrueEffect) else wanted[0]


def check_effects(effects: Sequence[Wanted]) -> None:
    """Raise CalibError at the first effect that cannot be simulated, or that is asked for twice."""
    names = [effect_name(wanted) for wanted in effects]
    for i, name in enumerate(names):
        if name not in CATALOGUE and name not in OUTSIDE:
            raise CalibError(
                f"cannot simulate the effect {name!r}; there are {', '.join(CATALOGUE)}, and outside the catalogue "
                f"{', '.join(OUTSIDE)}"
            )
        if name in names[:i]:
            raise CalibError(f"the effect {name} is asked for twice; once is enough")
