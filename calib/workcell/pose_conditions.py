"""What has to differ between poses beside the joints: the side they are reached from, the payload, the temperature.

An effect says what a dataset must hold for it (`needs`), by the names of the columns of poses.csv.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import hadamard

from calib.array_types import Array, BoolArray, IndexArray

APPROACH, PAYLOAD, TEMPERATURE = "approach", "payload_kg", "temperature_c"
PAYLOAD_KG = 1.0  # unless the user has another
COLD_C, WARM_C = 20.0, 30.0  # written down before, and replaced by what is measured
_WHERE_IT_VARIES, _WITHOUT_IT = "payload_kg where it varies", "no temperature_c"
_COME_FROM_RAD, _COME_FROM_MM = np.radians(3.0), 10.0


@dataclass(frozen=True)
class WantedConditions:
    """Which conditions the poses should have. `helpful` names columns that serve, and without which it goes too."""

    both_sides: bool = False
    payloads_kg: tuple[float, ...] = ()
    temperatures_c: tuple[float, ...] = ()
    helpful: tuple[str, ...] = ()

    @property
    def sentences(self) -> tuple[str, ...]:
        """What to do, for the one who measures."""
        said = []
        if self.both_sides:
            said.append("reach each pose twice, every joint from one side and then from the other")
        if self.payloads_kg:
            weights = " and ".join(f"{kg:g} kg" for kg in self.payloads_kg)
            said.append(f"measure each pose with {weights}: all poses with one, then all with the other")
        if self.temperatures_c:
            said.append("measure half of the poses cold and half warm, and write down the temperature")
        return tuple(said)


def conditions_for(needs: Iterable[str], *, payload_kg: float = PAYLOAD_KG) -> WantedConditions:
    """What effects need, of their `needs`: columns of poses.csv that they name.

    Args:
        payload_kg: what the arm can carry for it, beside nothing.
    """
    said = list(needs)
    payload = any(PAYLOAD in text for text in said)
    must = any(PAYLOAD in text.replace(_WHERE_IT_VARIES, "") for text in said)
    return WantedConditions(
        both_sides=any(APPROACH in text for text in said),
        payloads_kg=(0.0, payload_kg) if payload else (),
        temperatures_c=(COLD_C, WARM_C)
        if any(TEMPERATURE in text.replace(_WITHOUT_IT, "") for text in said)
        else (),
        helpful=(PAYLOAD,) if payload and not must else (),
    )


@dataclass(frozen=True)
class PlannedRows:
    """M rows of poses.csv, each one of N poses under its conditions; None: a column that is not asked."""

    pose: IndexArray  # (M,) of the N poses
    payload_kg: Array | None = None  # (M,)
    approach: Array | None = None  # (M, n) of -1, 1
    temperature_c: Array | None = None  # (M,)


def with_conditions(
    wanted: WantedConditions, count: int, joints: int, *, rng: np.random.Generator
) -> PlannedRows:
    """The rows for `count` poses in their order, of an arm with so many joints.

    A pose that is reached from both sides is two rows, one after the other, with signs that differ from joint to
    joint, so that joints can be told apart. Payloads and temperatures change as seldom as possible: all poses with
    one payload, then all with the next, backwards, as the arm stands at the last pose; the first half of each cold.
    """
    pose = np.arange(count)
    temperature = None
    if wanted.temperatures_c:
        temperature = np.array(wanted.temperatures_c)[pose * len(wanted.temperatures_c) // max(count, 1)]
    approach = None
    if wanted.both_sides:
        sign = _signs(count, joints, rng)
        approach = np.stack([sign, -sign], axis=1).reshape(-1, joints)
        pose = np.repeat(pose, 2)
        temperature = None if temperature is None else np.repeat(temperature, 2)
    if not wanted.payloads_kg:
        return PlannedRows(pose, None, approach, temperature)
    there = np.arange(len(pose))
    rows = np.concatenate([there if k % 2 == 0 else there[::-1] for k in range(len(wanted.payloads_kg))])
    return PlannedRows(
        pose[rows],
        np.repeat(np.array(wanted.payloads_kg), len(pose)),
        None if approach is None else approach[rows],
        None if temperature is None else temperature[rows],
    )


def _signs(count: int, joints: int, rng: np.random.Generator) -> Array:
    """(count, joints) of -1 and 1, no two columns alike or opposite: rows of a Hadamard matrix, in a drawn order."""
    size = 1 << max(joints, 1).bit_length()
    patterns = hadamard(size)[:, 1 : joints + 1].astype(float)
    rounds = [rng.permutation(size) for _ in range(-(-count // size))]
    return patterns[np.concatenate([*rounds, np.zeros(0, dtype=np.intp)])[:count]]


def come_from(q: Array, approach: Array, is_revolute: BoolArray, low: Array, high: Array) -> Array:
    """(M, n) joints to go to before q (M, n), so that each joint then arrives from its side: 3 deg or 10 mm before it.

    Joints that would leave their range (n,) go as far as it allows.
    """
    step = np.where(is_revolute, _COME_FROM_RAD, _COME_FROM_MM)
    return np.clip(q - approach * step, np.minimum(low, q), np.maximum(high, q))
