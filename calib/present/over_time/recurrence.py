"""Presentation of what comes back in several recordings of one arm."""

from __future__ import annotations

from typing import Any

from calib.present.over_time.comparison import camera_sentence
from calib.present.results import document, own_fields, presentation
from calib.rendering import numbers
from calib.rendering.blocks import (
    Block,
    Bullets,
    Presentation,
    Section,
    Table,
    Verdict,
    Words,
    effect,
    joint,
    listed,
    spans,
)
from calib.rendering.colours import DOUBT, GOOD
from calib.validation.repeat import Recurrence, RepeatedCause


@presentation.register
def _recurrence(found: Recurrence) -> Presentation:
    colour = GOOD if found.verdict == "repeats" else DOUBT
    head: list[Block] = [Verdict(_verdict(found), colour)]
    places = [f"{name} beside {found.names[0]}: {camera_sentence(shift)}" for name, shift in found.cameras]
    told: list[Words] = [*map(_comes_back, _back(found)), *_against(found), *places]
    if told:
        head.append(Bullets(told))
    return Presentation(
        f"What comes back in {numbers.listing(found.names)}",
        head,
        [
            *([Section("Each cause, by each recording alone", [_table(found)], brief=True)] if found.causes else []),
            Section("What each recording's own diagnosis names", [Bullets(_alone(found))], brief=True),
        ],
    )


def _back(found: Recurrence) -> list[RepeatedCause]:
    return [cause for cause in found.causes if cause.comes_back]


def _verdict(found: Recurrence) -> Words:
    count, back = len(found.names), [cause for cause in _back(found) if cause.is_of_arm]
    if found.verdict == "repeats":
        fewest = min(max(len(cause.found_in), len(cause.named_alone)) for cause in back)
        causes = listed([effect(name) for name in dict.fromkeys(cause.cause for cause in back)])
        return spans("Comes back", f" in {fewest} of {count} recordings: ", causes, ".")
    if found.verdict == "differs":
        causes = listed(
            [effect(n) for n in dict.fromkeys(c.cause for c in found.causes if c.called_for and not c.agree)]
        )
        return spans("The recordings contradict each other on ", causes, ": the arm changed, or the cause is another.")
    return f"Too little data: no cause is confirmed by one of the {count} recordings given the others."


def _comes_back(cause: RepeatedCause) -> Words:
    alike = spans("; ", listed([effect(n) for n in cause.alike], "or"), " would explain as much") if cause.alike else ()
    found = f"found in {numbers.listing(cause.found_in)}, which agree"
    if len(cause.found_in) < 2:
        found = "left open by each recording, and the same in all"
    return spans(effect(cause.cause), _of_joint(cause), f", {cause.parameter}: {_sizes(cause)}, {found}", alike)


def _sizes(cause: RepeatedCause) -> str:
    return numbers.listing(
        [
            numbers.with_sigma(value, sigma, cause.unit)
            for value, sigma in zip(cause.values, cause.sigmas, strict=True)
            if value is not None and sigma is not None
        ]
    )


def _against(found: Recurrence) -> list[Words]:
    """Sentences on the effects that a recording's own diagnosis names, and that do not come back with their class."""
    back = {name for cause in _back(found) for name in (cause.cause, *cause.alike)}
    named = dict.fromkeys(name for own in found.alone for name in own if name not in back)
    out: list[Words] = []
    for name in named:
        where = [recording for recording, own in zip(found.names, found.alone, strict=True) if name in own]
        told = [cause for cause in found.causes if cause.cause == name]
        against = next((cause for cause in told if not cause.agree), None)
        if against is not None:
            why = f"is contradicted: {against.parameter} is {_sizes(against)}, which differ beyond their sigmas"
        else:
            sizes = f": {told[0].parameter} is {_sizes(told[0])}" if told else ""
            why = f"is not confirmed and not contradicted, as the others merely say less{sizes}"
        out.append(spans(effect(name), f", which {numbers.listing(where)} by itself names, {why}"))
    return out


def _of_joint(cause: RepeatedCause) -> Words:
    return () if cause.joint is None else spans(" of ", joint(cause.joint, f"joint {cause.joint}"))


def _table(found: Recurrence) -> Table:
    rows = [
        (
            cause.cause,
            "" if cause.joint is None else str(cause.joint),
            cause.parameter,
            *(
                "" if value is None or sigma is None else numbers.with_sigma(value, sigma, cause.unit)
                for value, sigma in zip(cause.values, cause.sigmas, strict=True)
            ),
            f"{len(cause.found_in)} of {len(found.names)}",
            "yes" if cause.agree else "no",
        )
        for cause in found.causes
    ]
    return Table(("cause", "joint", "parameter", *found.names, "confirmed in", "agree"), rows, left=(0, 2))


def _alone(found: Recurrence) -> list[Words]:
    return [
        spans(f"{name}: ", listed([effect(one) for one in own]) if own else "nothing")
        for name, own in zip(found.names, found.alone, strict=True)
    ]


@document.register
def _recurrence_document(found: Recurrence) -> dict[str, Any]:
    return {"verdict": found.verdict, **own_fields(found)}


@document.register
def _cause_document(cause: RepeatedCause) -> dict[str, Any]:
    return {**own_fields(cause), "comes_back": cause.comes_back}
