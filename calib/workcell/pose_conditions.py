"""Conditions of poses, besides the joints, under which effects show: side of approach, payload, temperature.

An effect names the conditions that it needs, and those that help it, on its class (`needed_conditions`,
`helpful_conditions`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calib.array_types import Array, BoolArray
from calib.dataset.dataset import PoseCondition

PAYLOAD_KG = 1.0  # unless the user has another
COLD_C, WARM_C = 20.0, 30.0  # written down before, and replaced by what is measured
_COME_FROM_RAD, _COME_FROM_MM = np.radians(3.0), 10.0


@dataclass(frozen=True)
class WantedConditions:
    """Conditions under which the poses should be measured; `helpful` names columns that are useful but not needed."""

    both_sides: bool = False
    payloads_kg: tuple[float, ...] = ()
    temperatures_c: tuple[float, ...] = ()
    helpful: tuple[PoseCondition, ...] = ()


class AsksForConditions(Protocol):
    """Protocol of an effect that names the conditions of poses under which it shows."""

    @property
    def needed_conditions(self) -> tuple[PoseCondition, ...]:
        """Conditions that must vary over the poses for the effect to show."""

    @property
    def helpful_conditions(self) -> tuple[PoseCondition, ...]:
        """Conditions that make the effect show better where they vary."""


def conditions_for(effects: Iterable[AsksForConditions], *, payload_kg: float = PAYLOAD_KG) -> WantedConditions:
    """Conditions of poses under which effects show.

    Args:
        effects: descriptions (`calib.effects.effect.describe`).
        payload_kg: payload in part of the poses; the others have none.
    """
    described = list(effects)
    needed = {condition for one in described for condition in one.needed_conditions}
    helpful = {condition for one in described for condition in one.helpful_conditions} - needed
    wanted = needed | helpful
    return WantedConditions(
        both_sides="approach" in wanted,
        payloads_kg=(0.0, payload_kg) if "payload_kg" in wanted else (),
        temperatures_c=(COLD_C, WARM_C) if "temperature_c" in wanted else (),
        helpful=tuple(sorted(helpful)),
    )


def come_from(
    q: Array, approach: Array, is_revolute: BoolArray, low: Array, high: Array, *, share: float = 1.0
) -> Array:
    """Joint vectors (M, n) just before q (M, n), from which each joint arrives from a given side.

    They are 3 deg or 10 mm away, times `share`; joints that would leave their range (n,) go as far as it allows.
    """
    step = share * np.where(is_revolute, _COME_FROM_RAD, _COME_FROM_MM)
    return np.clip(q - approach * step, np.minimum(low, q), np.maximum(high, q))
