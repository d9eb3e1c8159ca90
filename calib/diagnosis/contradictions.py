"""Disagreement between what differences of paired poses prove and what the fit of all poses found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.calibration.result import Calibration
from calib.intervention.proof import Proof

MAX_SIGMAS = 3.0  # between both values, above which they disagree


@dataclass(frozen=True)
class Contradiction:
    """A proven value, with the value that the fit of all poses has for it, or the effects that it names instead."""

    proof: Proof
    fitted: tuple[float, float] | None  # value and sigma
    instead: tuple[str, ...] = ()  # effects


def contradictions(
    proofs: Sequence[Proof], last: Calibration, claimed: Sequence[str], rivals: Sequence[str]
) -> tuple[Contradiction, ...]:
    """Proofs that the fit of all poses contradicts: another value, or a rival named in place of the proven effect.

    Args:
        proofs: what the pairs prove.
        last: the last fit of all poses.
        claimed: effects that the diagnosis claims.
        rivals: effects that could explain what the pairs show, which these refute where they do not prove them.
    """
    fitted = last.fit.by_name
    proven = {proof.effect for proof in proofs}
    instead = tuple(name for name in claimed if name in rivals and name not in proven)
    out = []
    for proof in proofs:
        found = fitted.get(proof.full_name)
        if found is not None:
            if abs(found[0] - proof.value) > MAX_SIGMAS * float(np.hypot(found[1], proof.sigma)):
                out.append(Contradiction(proof, found))
        elif instead and proof.effect not in claimed:
            out.append(Contradiction(proof, None, instead))
    return tuple(out)
