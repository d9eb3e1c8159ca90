"""Why a pose is in a plan: parameters that are known better by it, and a joint far from all measured poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.array_types import Array, IndexArray
from calib.planning.outcome import ParameterReason
from calib.planning.purpose import Situation
from calib.planning.question import inverse

_NAMED = 3  # parameters
_TELLS = 0.01  # share by which a pose lowers a parameter's sigma, below which it is not worth telling
_FAR_RAD, _FAR_MM = np.radians(25.0), 100.0  # from every measured pose, in one joint


def parameter_reasons(situation: Situation, chosen: IndexArray) -> tuple[ParameterReason, ...]:
    """The parameters whose sigma each chosen candidate lowers most, and a joint far from all measured poses."""
    whole = situation.information(chosen)
    p = len(situation.unknowns.scales)
    with_all = np.diag(inverse(whole))[:p]
    names = [name.rpartition(".")[0] or name for name in situation.unknowns.parameter_names]  # without the symbol
    out = []
    for candidate in chosen:
        rows = situation.rows[candidate]
        without = np.diag(inverse(whole - rows.T @ rows))[:p]
        gains = 1.0 - np.sqrt(with_all / without)
        best = [k for k in np.argsort(-gains)[:_NAMED] if gains[k] > _TELLS]
        known_better = tuple(dict.fromkeys(names[k] for k in best))
        out.append(ParameterReason(known_better, _far_joint(situation, situation.candidates.q[candidate])))
    return tuple(out)


def _far_joint(situation: Situation, q: Array) -> int | None:
    """Number from 1 of the joint that is farthest from all measured poses, where that is far; else None."""
    measured = situation.start.measured
    if measured is None:
        return None
    trained = measured.q[~measured.is_test]
    revolute = situation.start.dataset.robot.is_revolute
    apart = np.abs(trained - q)
    apart = np.where(revolute, np.minimum(apart % (2 * np.pi), -apart % (2 * np.pi)), apart)
    far = apart.min(axis=0) / np.where(revolute, _FAR_RAD, _FAR_MM)
    joint = int(np.argmax(far))
    return joint + 1 if far[joint] > 1.0 else None


def new_ids(count: int, taken: Sequence[str]) -> tuple[str, ...]:
    """p and a number, as many digits as the others have, after the highest that is taken."""
    numbers = [name[1:] for name in taken if name[:1] == "p" and name[1:].isdecimal()]
    first = max((int(number) for number in numbers), default=0) + 1
    width = max((len(number) for number in numbers), default=len(str(count)))
    return tuple(f"p{number:0{width}d}" for number in range(first, first + count))
