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
    proven = {one.effect for proof in proofs for one in (proof, *proof.alike)}
    instead = tuple(name for name in claimed if name in rivals and name not in proven)
    out = []
    for proof in proofs:
        alike = proof.alike or (proof,)
        found = [(fitted[one.full_name], one) for one in alike if one.full_name in fitted]
        if found:
            (value, sigma), one = found[0]
            if len(found) == 1 and abs(value - one.value) > MAX_SIGMAS * float(np.hypot(sigma, one.sigma)):
                out.append(Contradiction(proof, found[0][0]))
        elif instead and not {one.effect for one in alike} & set(claimed):
            out.append(Contradiction(proof, None, instead))
    return tuple(out)
