"""Why a pose is in a plan: what it tells more of than the others, and what is unusual about where the arm stands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.array_types import Array, IndexArray
from calib.planning.purpose import Situation
from calib.planning.question import inverse

_NAMED = 3  # parameters
_TELLS = 0.01  # share by which a pose lowers a parameter's sigma, below which it is not worth telling
_FAR_RAD, _FAR_MM = np.radians(25.0), 100.0  # from every measured pose, in one joint


def reasons(situation: Situation, chosen: IndexArray) -> tuple[str, ...]:
    """A few words on each chosen candidate."""
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
        told = ", ".join(dict.fromkeys(names[k] for k in best)) or "a little of everything"
        where = _unusual(situation, situation.candidates.q[candidate])
        out.append(f"{where}: {told}" if where else told)
    return tuple(out)


def _unusual(situation: Situation, q: Array) -> str:
    """The joint that stands farthest from all measured poses, where that is far; "" else."""
    measured = situation.start.measured
    if measured is None:
        return ""
    trained = measured.q[~measured.is_test]
    revolute = situation.start.dataset.robot.is_revolute
    apart = np.abs(trained - q)
    apart = np.where(revolute, np.minimum(apart % (2 * np.pi), -apart % (2 * np.pi)), apart)
    far = apart.min(axis=0) / np.where(revolute, _FAR_RAD, _FAR_MM)
    joint = int(np.argmax(far))
    return f"joint {joint + 1} far from what was measured" if far[joint] > 1.0 else ""


def new_ids(count: int, taken: Sequence[str]) -> tuple[str, ...]:
    """p and a number, as many digits as the others have, after the highest that is taken."""
    numbers = [name[1:] for name in taken if name[:1] == "p" and name[1:].isdecimal()]
    first = max((int(number) for number in numbers), default=0) + 1
    width = max((len(number) for number in numbers), default=len(str(count)))
    return tuple(f"p{number:0{width}d}" for number in range(first, first + count))
