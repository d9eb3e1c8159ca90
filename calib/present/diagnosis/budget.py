"""Shares of the causes: the error budget as a bar and as a sentence, and the probability of each set of causes."""

from __future__ import annotations

from typing import Any

from calib.diagnosis import probabilities
from calib.diagnosis.budget import CURVES, LINKS, NOISE, TOGETHER, UNKNOWN, ErrorBudget
from calib.diagnosis.probabilities import CauseProbabilities, CauseSet
from calib.present.effects import title
from calib.rendering import colours, numbers
from calib.rendering.blocks import Part, Shares, Words, effect, joined, listed, spans

UNEXPLAINED = "unexplained"
_TOLD = 0.01  # probability from which a set of causes is told
_MOST = 5  # sets that are told
NOTHING = "nothing is missing"
OUTSIDE = "something outside the catalogue"


def budget_blocks(budget: ErrorBudget | None) -> list[Shares]:
    """Block with the bar of an error budget; [] where there is none."""
    if budget is None:
        return []
    is_scatter = budget.reached_noise and any(one.cause == UNKNOWN for one in budget.shares)
    scatter = "What is unexplained is no more than the scatter that so few poses leave." if is_scatter else ""
    note = " ".join(filter(None, (_of_measuring(budget), _rises(budget), scatter)))
    return [Shares(budget_sentence(budget), _heading(budget), budget_parts(budget), note)]


def budget_sentence(budget: ErrorBudget) -> str:
    """Sentence with the share of each cause: "Of the squared error as delivered: links 96 %, noise 1 %."."""
    of = "" if budget.of_test_poses else " (at the poses that were fitted: there are no test poses)"
    shares = ", ".join(f"{part.name} {part.words}" for part in budget_parts(budget))
    told = f"Of the squared error as delivered{of}: {shares}."
    return " ".join(filter(None, (told, _of_measuring(budget), _rises(budget))))


def _of_measuring(budget: ErrorBudget) -> str:
    """Sentence on the causes that are of the instrument or the target, and so no errors of the arm."""
    found = [one for one in budget.shares if one.of in ("instrument", "target")]
    if not found:
        return ""
    causes = numbers.listing([_name(one.cause, budget) for one in found])
    where = numbers.listing(list(dict.fromkeys(f"the {one.of}" for one in found)))
    return f"{numbers.capitalised(causes)} {'is' if len(found) == 1 else 'are'} of {where}, not of the arm."


def budget_parts(budget: ErrorBudget) -> list[Part]:
    """Parts of the bar of an error budget, each with its name, share and colour; learned curves as one part."""
    curves = [one for one in budget.shares if one.cause.startswith(CURVES)]
    joints = [one.cause.removeprefix(CURVES) for one in curves]
    effect_colours = iter((*colours.EFFECTS, *[colours.EFFECTS[-1]] * len(budget.shares)))
    fixed = {LINKS: colours.LINKS, NOISE: colours.NOISE, UNKNOWN: colours.UNEXPLAINED}
    parts = []
    for one in budget.shares:
        if one in curves[1:]:
            continue
        if one in curves:
            share, mm = sum(part.share for part in curves), sum(part.mm**2 for part in curves) ** 0.5
            name = f"learned curves (joint{'s' if len(joints) > 1 else ''} {numbers.listing(joints)})"
            colour = colours.CURVES
        else:
            share, mm, name = one.share, one.mm, _name(one.cause, budget)
            colour = fixed.get(one.cause.partition(TOGETHER)[0]) or next(effect_colours)
        parts.append(Part(name, numbers.bounded_share(share), share, colour, numbers.length(mm)))
    return parts


def _name(cause: str, budget: ErrorBudget) -> str:
    if cause == UNKNOWN:
        return UNEXPLAINED if budget.noise_is_known else f"{UNEXPLAINED} or noise"
    return numbers.listing(["links" if one == LINKS else title(one) for one in cause.split(TOGETHER)])


def _heading(budget: ErrorBudget) -> str:
    at = "test poses" if budget.of_test_poses else "the poses that were fitted; there are no test poses"
    return f"What made the error as delivered, {numbers.length(budget.delivered_mm)}: shares of its square, at {at}"


def _rises(budget: ErrorBudget) -> str:
    if not budget.raised:
        return ""
    rose = numbers.listing([_name(cause, budget) for cause in budget.raised])
    return f"The error rose with {rose}, which is taken off what was gained before."


def budget_document(budget: ErrorBudget | None) -> dict[str, Any]:
    """JSON keys on an error budget: the share of each cause, and the poses whose errors were divided."""
    if budget is None:
        return {"budget": [], "budget_of": None}
    return {"budget": budget.shares, "budget_of": "test" if budget.of_test_poses else "train"}


# ---- how likely each set of causes is -------------------------------------------------------------------------------


def probability_sentence(found: CauseProbabilities) -> Words:
    """Sentence with the sets of causes that remain, the likeliest first: "How likely: backlash 94 %, ... 4 %."."""
    told = [one for one in found.sets if one.p >= _TOLD][:_MOST]
    rest = 1.0 - sum(one.p for one in told)
    parts: list[Words] = [spans(_causes(one), f" {numbers.bounded_share(one.p)}") for one in told]
    if rest >= _TOLD:
        parts.append(f"other sets {numbers.bounded_share(rest)}")
    return spans("How likely each set of causes is: ", joined(parts), ".")


def _causes(one: CauseSet) -> Words:
    if not one.causes:
        return NOTHING
    return listed([OUTSIDE if cause == probabilities.UNKNOWN else effect(cause) for cause in one.causes])


def probability_document(found: CauseProbabilities | None) -> dict[str, Any]:
    """JSON keys: sets of causes with probabilities, which sum to 1; an empty set means that nothing is missing.

    None where the data are wrong, of which no cause is told.
    """
    sets = () if found is None else found.sets
    return {"probabilities": [{"causes": list(one.causes), "p": one.p} for one in sets]}
