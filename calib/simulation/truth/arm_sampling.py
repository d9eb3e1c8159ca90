"""Random arms to measure in a simulation: link errors, and effects with magnitudes that are realistic on that arm."""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.errors import CalibError
from calib.kinematics.robot import Robot
from calib.simulation import truth as laws
from calib.simulation.truth.equilibrium import Truth
from calib.simulation.truth.mechanism import STANDARD, Conditions, TrueEffect
from calib.simulation.truth.sampling import SimulatedCell, registered_effects

for _module in pkgutil.iter_modules(laws.__path__):  # every module of the truth, so that its effects are registered
    import_module(f"{laws.__name__}.{_module.name}")

SIMULATED = registered_effects()
"""Classes of all effects that can be simulated by name."""
SIMULATED_EFFECTS = tuple(name for name, kind in SIMULATED.items() if kind.in_catalogue)
"""Names of the catalogue's effects that can be simulated, in alphabetical order."""
OUTSIDE_EFFECTS = tuple(name for name, kind in SIMULATED.items() if not kind.in_catalogue)
"""Names of simulated causes outside the catalogue, which a diagnosis has to leave unexplained."""

EffectRequest = str | tuple[str, float] | TrueEffect
"""An effect to simulate: by name, by name with its visible size in noise sigmas, or with all its parameters."""


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations of random link errors, which are independent for each parameter of every row."""

    length_mm: float = 0.3
    angle_deg: float = 0.1


TYPICAL = Tolerances()


def draw_truth(
    robot: Robot,
    base_T_scanner: ArrayLike | Mapping[str, Array],
    q: Array,
    *,
    rng: np.random.Generator,
    effects: Sequence[EffectRequest] = (),
    tolerances: Tolerances = TYPICAL,
    conditions: Conditions = STANDARD,
    noise_mm: float | None = None,
    visible_sigmas: float | None = None,
    base_T_jig: Array | None = None,
) -> Truth:
    """Random arm: link errors from the tolerances, and effects whose magnitudes are realistic at the poses q (N, n).

    Each effect gets the magnitude asked for: a visible part (`calib.simulation.truth.sampling`) in multiples of
    `noise_mm` per coordinate. Without a request it moves the measured point by 0.2 to 0.5 mm rms. `base_T_jig` (4, 4)
    is the frame of the jig for an arm that carries the scanner; `base_T_scanner` is then flange_T_scanner.

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
    for request in effects:
        if isinstance(request, TrueEffect):
            drawn.append(request)
            continue
        name, sigmas = (request, visible_sigmas) if isinstance(request, str) else request
        effect = SIMULATED[name].draw(cell, rng)
        if sigmas is None:
            drawn.append(cell.scaled_to_moved(effect, rng.uniform(0.2, 0.5)))
        elif not noise_mm or noise_mm < 0:
            raise CalibError("a visible size is counted in noise sigmas; give noise_mm above 0")
        else:
            drawn.append(cell.scaled_to_visible(effect, sigmas * noise_mm))
    return truth.with_effects(*drawn)


def effect_name(request: EffectRequest) -> str:
    """Name of a requested effect."""
    return request if isinstance(request, str) else request.name if isinstance(request, TrueEffect) else request[0]


def check_effects(effects: Sequence[EffectRequest]) -> None:
    """Raise CalibError at the first effect that cannot be simulated, or that is requested twice."""
    names = [effect_name(request) for request in effects]
    for i, name in enumerate(names):
        if name not in SIMULATED:
            raise CalibError(
                f"cannot simulate the effect {name!r}; there are {', '.join(SIMULATED_EFFECTS)}, and outside the "
                f"catalogue {', '.join(OUTSIDE_EFFECTS)}"
            )
        if name in names[:i]:
            raise CalibError(f"the effect {name} is asked for twice; once is enough")
