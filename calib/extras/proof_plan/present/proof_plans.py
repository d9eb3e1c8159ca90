"""What is told of planned proofs: the change of a condition to make, and what pairs of poses then achieve."""

from __future__ import annotations

from typing import Any

from calib.extras.proof_plan.proof_plan import NextChange, PairReason
from calib.extras.proof_plan.simulated_pairs import ConditionChange
from calib.intervention.pairs import APPROACH, PAYLOAD
from calib.present.plans.plans import SURELY, ReasonTold, Told, reason_told, told
from calib.present.results import document, keys_of, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Presentation, Verdict, Words, effect, listed, spans
from calib.rendering.colours import GOOD


@told.register
def _of_proof(found: NextChange) -> Told:
    return Told(
        f"to prove which is true of {numbers.listing(found.hypotheses)}",
        sentences=_proven(found),
        document=keys_of(found, "change", "hypotheses", "pairs"),
    )


@reason_told.register
def _by_pair(reason: PairReason) -> ReasonTold:
    level = "from the other side" if reason.level is None else f"{reason.condition} {reason.level:.4g}"
    phrase = level if reason.again is None else f"{reason.again} again, {level}"
    return ReasonTold(phrase, {"again": reason.again})


def _proven(found: NextChange) -> list[str]:
    what = condition_change(found.change)
    if found.again:
        lines = [f"{what}, leave all else as it is, and measure {numbers.listing(found.again)} again, joints as then"]
    else:
        lines = [f"measure {found.pairs} poses, {what}, leave all else as it is, and measure the same poses again"]
    if found.assumed:
        level = f"{found.change.condition} {found.change.before:.4g}"
        lines.append(f"no column has the condition of the poses measured so far: write {level} for them in poses.csv")
    lines.append(
        "where instrument or tool were moved since, that does no harm; the instrument then has a setup of its own"
    )
    lines += [f"{numbers.share(power)} instead, if you {condition_change(change)}" for change, power in found.others]
    if found.probability < SURELY:
        heavier = " or a heavier payload (--payload-kg)" if found.change.condition == PAYLOAD else ""
        lines.append(f"the others stay open: more pairs (--add){heavier} tell more")
    return lines


# ---- a change to make -----------------------------------------------------------------------------------------------


@presentation.register
def _next_change(found: NextChange) -> Presentation:
    return Presentation("The change that proves it", [Verdict(change_sentence(found), GOOD)])


@document.register
def _change_document(found: NextChange) -> dict[str, Any]:
    settled = {"settles": found.probability, "between": found.hypotheses}
    return {**document(found.change), **keys_of(found, "pairs", "again"), **settled}


def condition_change(change: ConditionChange) -> str:
    """Instruction to change one condition: "hang 2 kg on the flange"."""
    condition, before, after = change.condition, change.before, change.after
    if condition == APPROACH:
        return "come with every joint from the other side"
    assert before is not None
    assert after is not None
    if condition == PAYLOAD:
        return f"hang {after:.4g} kg on the flange" if not before else f"exchange {before:.4g} kg for {after:.4g} kg"
    return f"wait until the arm is at {after:.0f} °C instead of {before:.0f} °C"


def change_sentence(found: NextChange) -> Words:
    """Sentence on the change of one condition that is likely to prove which of several effects is true."""
    what = numbers.capitalised(condition_change(found.change))
    measured = (
        f" and measure {numbers.count(found.pairs, 'pose')} again" if found.again else
        f" between two measurements of {numbers.count(found.pairs, 'pose')}"
    )  # fmt: skip
    return spans(
        f"{what}{measured}: with a probability of {numbers.share(found.probability)} their differences prove which of ",
        listed([effect(name) for name in found.hypotheses], "or"),
        " it is (inspector plan --for prove has the poses).",
    )
