"""Conditions of poses other than the joints that effects need: side of approach, payload, temperature.

An effect says what a dataset must hold for it (`needs`), by the names of the columns of poses.csv.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray

APPROACH, PAYLOAD, TEMPERATURE = "approach", "payload_kg", "temperature_c"
PAYLOAD_KG = 1.0  # unless the user has another
COLD_C, WARM_C = 20.0, 30.0  # written down before, and replaced by what is measured
_WHERE_IT_VARIES, _WITHOUT_IT = "payload_kg where it varies", "no temperature_c"
_COME_FROM_RAD, _COME_FROM_MM = np.radians(3.0), 10.0


@dataclass(frozen=True)
class WantedConditions:
    """Conditions under which the poses should be measured; `helpful` names columns that are useful but not needed."""

    both_sides: bool = False
    payloads_kg: tuple[float, ...] = ()
    temperatures_c: tuple[float, ...] = ()
    helpful: tuple[str, ...] = ()


def conditions_for(needs: Iterable[str], *, payload_kg: float = PAYLOAD_KG) -> WantedConditions:
    """Conditions that effects need, from their `needs`: texts that name columns of poses.csv.

    Args:
        payload_kg: payload in part of the poses; the others have none.
    """
    texts = list(needs)
    payload = any(PAYLOAD in text for text in texts)
    must = any(PAYLOAD in text.replace(_WHERE_IT_VARIES, "") for text in texts)
    return WantedConditions(
        both_sides=any(APPROACH in text for text in texts),
        payloads_kg=(0.0, payload_kg) if payload else (),
        temperatures_c=(COLD_C, WARM_C) if any(TEMPERATURE in text.replace(_WITHOUT_IT, "") for text in texts) else (),
        helpful=(PAYLOAD,) if payload and not must else (),
    )


def come_from(q: Array, approach: Array, is_revolute: BoolArray, low: Array, high: Array) -> Array:
    """(M, n) joint vectors to visit before q (M, n), 3 deg or 10 mm away, so that each joint arrives from one side.

    Joints that would leave their range (n,) go as far as it allows.
    """
    step = np.where(is_revolute, _COME_FROM_RAD, _COME_FROM_MM)
    return np.clip(q - approach * step, np.minimum(low, q), np.maximum(high, q))
