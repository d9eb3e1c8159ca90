"""Presentation of the probabilities of causes: a sentence, and the keys of `diagnose --json`."""

from __future__ import annotations

from typing import Any

from calib.diagnosis.probabilities import UNKNOWN, CauseProbabilities, CauseSet
from calib.rendering import numbers
from calib.rendering.blocks import Words, effect, joined, listed, spans

_TOLD = 0.01  # probability from which a set of causes is told
_MOST = 5  # sets that are told
NOTHING = "nothing is missing"
OUTSIDE = "something outside the catalogue"


def probability_sentence(found: CauseProbabilities) -> Words:
    """Sentence with the sets of causes that remain, the likeliest first: "How likely: backlash 94 %, ... 4 %."."""
    told = [one for one in found.sets if one.p >= _TOLD][:_MOST]
    rest = 1.0 - sum(one.p for one in told)
    parts: list[Words] = [spans(_named(one), f" {numbers.bounded_share(one.p)}") for one in told]
    if rest >= _TOLD:
        parts.append(f"other sets {numbers.bounded_share(rest)}")
    return spans("How likely each set of causes is: ", joined(parts), ".")


def _named(one: CauseSet) -> Words:
    if not one.causes:
        return NOTHING
    return listed([OUTSIDE if cause == UNKNOWN else effect(cause) for cause in one.causes])


def probability_document(found: CauseProbabilities | None) -> dict[str, Any]:
    """JSON keys: sets of causes with probabilities, which sum to 1; an empty set means that nothing is missing.

    None where the data are wrong, of which no cause is told.
    """
    sets = () if found is None else found.sets
    return {"probabilities": [{"causes": list(one.causes), "p": one.p} for one in sets]}
