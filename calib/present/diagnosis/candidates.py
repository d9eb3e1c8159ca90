"""Candidate effects: their ranking, and the facts and values of one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType

from calib.calibration.result import Calibration
from calib.diagnosis.decision_rules import MAX_P_VALUE, MIN_LOG_EVIDENCE, is_convincing
from calib.diagnosis.probabilities import CauseProbabilities
from calib.effects.effect import Description, Effect, describe, family_name, full_name, has_meaning, parameters_by_name
from calib.present.effects import meaning, not_testable, title
from calib.present.names import joints_by_parameter
from calib.rendering import numbers
from calib.rendering.blocks import (
    Bar,
    Block,
    Bullets,
    Facts,
    Folded,
    Paragraph,
    Small,
    Span,
    Table,
    Words,
    effect,
    joined,
    joint,
    spans,
)
from calib.screening.candidates import Candidate, Screening, Untestable, explained_shares_at

EXPLAINED_AT_POSES = 5  # effects at most that are named for some poses
FOLDED_BELOW = 1.0  # log evidence: less counts for nothing
_NONE_RANKED = "No effect can be ranked: none is testable with these data."
CANNOT_BE_TESTED = "Cannot be tested with these data"
_NO_BREAK = "\N{NO-BREAK SPACE}"
_MOST_ALIKE = 3  # effects that could make the same, named in a cell or a fact


# ---- the ranking ----------------------------------------------------------------------------------------------------


_ALIKE = "could also be made by"
_COLUMNS: Mapping[str, Callable[[Candidate, Screening], Words]] = MappingProxyType(
    {
        "evidence": lambda c, s: _evidence_bar(c, s),
        "p (Holm)": lambda c, _: numbers.probability(c.p_holm),
        "explains, %": lambda c, _: f"{100 * c.explained_share:.0f}",
        "held-out error": lambda c, s: numbers.relative_change(s.cv_rmse_mm, c.cv_rmse_mm),
        "held-out error, mm": lambda c, _: numbers.column_mm(c.cv_rmse_mm),
        _ALIKE: lambda c, _: alike(c) or numbers.MISSING,
    }
)
PROBABILITY = "likely"
BRIEF_RANKING = ("evidence", "p (Holm)", "explains, %")
FULL_RANKING = (*BRIEF_RANKING, "held-out error, mm", _ALIKE)
PANEL_RANKING = ("evidence", "held-out error")  # as narrow as a panel


def ranking(
    screening: Screening,
    columns: Sequence[str] = BRIEF_RANKING,
    *,
    most: int | None = None,
    mark: Collection[str] = (),
    likely: CauseProbabilities | None = None,
) -> Table | Paragraph:
    """Table of the evidence of each candidate effect, the best first; a sentence where there are no candidates.

    Args:
        columns: beside the effect's name, of `_COLUMNS`.
        most: candidates at most; None: all of them.
        mark: names of effects of which the first row is emphasised.
        likely: probabilities of the causes by a diagnosis, for a column of their own.
    """
    candidates = screening.candidates[:most]
    names = {c.name: c.name for c in candidates}
    return _ranking(screening, candidates, names, columns, mark, likely) if candidates else Paragraph(_NONE_RANKED)


def ranking_to_choose_from(
    screening: Screening,
    *,
    passed_over: Collection[str] = (),
    chosen: Collection[str] = (),
    own: Collection[str] = (),
    likely: CauseProbabilities | None = None,
) -> list[Block]:
    """Ranking whose rows choose an effect: names with their keys, evidence in words and as bars.

    Candidates with a log evidence below FOLDED_BELOW are folded, and so are those that the search passes over.

    Args:
        passed_over: names of effects of single places for which learned curves have clearly more evidence.
        chosen: names of effects of which the first row is emphasised.
        own: names of effects from the user's file, marked as such.
        likely: probabilities of the causes by a diagnosis, for a column of their own.
    """
    candidates = [c for c in screening.candidates if c.members]
    if not candidates:
        return [Paragraph(_NONE_RANKED)]
    over = [c for c in candidates if c.name in passed_over]
    first = [c for c in candidates if c not in over and (c.log_evidence >= FOLDED_BELOW or c.name in chosen)]
    rest = [c for c in candidates if c not in over and c not in first]
    names = {c.name: _named(c, own) for c in candidates}

    def tables(of: Sequence[Candidate]) -> list[Block]:
        return [_ranking(screening, of, names, PANEL_RANKING, chosen, likely)] if of else []

    many, few = numbers.count(len(over), "effect"), numbers.count(len(rest), "further effect")
    return [
        *(tables(first) or [Paragraph("No effect has evidence that counts.")]),
        Folded(f"{many} of single places: learned curves explain clearly more", tables(over)),
        Folded(f"{few} without evidence", tables(rest)),
    ]


def _ranking(
    screening: Screening,
    candidates: Sequence[Candidate],
    names: Mapping[str, Words],
    columns: Sequence[str],
    mark: Collection[str],
    likely: CauseProbabilities | None,
) -> Table:
    def row(candidate: Candidate) -> tuple[Words, ...]:
        share = () if likely is None else (numbers.bounded_share(likely.of(candidate.name)),)
        return (names[candidate.name], *share, *(_COLUMNS[name](candidate, screening) for name in columns))

    more = () if likely is None else (PROBABILITY,)
    return Table(
        ("effect", *more, *columns),
        [row(candidate) for candidate in candidates],
        left=(0, *(k for k, name in enumerate(columns, 1 + len(more)) if name == _ALIKE)),
        mark=next((k for k, c in enumerate(candidates) if c.name in mark), None),
        rows_select=[effect(c.name) for c in candidates],
    )


def _named(candidate: Candidate, own: Collection[str]) -> Words:
    """Name cell of a candidate effect: the name in words, and the key."""
    named = title(candidate.name)
    mine = " (own)" if candidate.name in own else ""
    return joined([f"{named}{mine}", *([] if named == candidate.name else [Small(candidate.name)])], " ")


def _evidence_bar(candidate: Candidate, screening: Screening) -> Words:
    largest = max(3.0 * FOLDED_BELOW, *(c.log_evidence for c in screening.candidates))
    words = f"{_strength(candidate)} {numbers.signed(candidate.log_evidence, '.1f')}"
    return Bar(words, min(max(candidate.log_evidence / largest, 0.0), 1.0))


def _strength(candidate: Candidate) -> str:
    """The evidence of a candidate effect in a word."""
    if is_convincing(candidate):
        return "strong"
    return "weak" if candidate.log_evidence >= FOLDED_BELOW else "none"


def explained_at(screening: Screening, poses: Collection[str]) -> list[Block]:
    """Table of the effects that explain most of the residual at some poses; [] where none of them was fitted."""
    shares = explained_shares_at(screening, poses)
    best = sorted((name for name, share in shares.items() if share > 0.0), key=lambda name: -shares[name])
    if not best:
        return [Paragraph("No effect explains these poses; test poses are not fitted.", soft=True)]
    best = best[:EXPLAINED_AT_POSES]
    rows = [(title(name), Bar(numbers.share(shares[name]), min(shares[name], 1.0))) for name in best]
    headers = ("would explain", "of these poses' squared residual")
    return [Table(headers, rows, rows_select=list(map(effect, best)))]


def held_out_sentence(screening: Screening) -> str:
    """Sentence on the meaning of the ranking's held-out error, and on its size without any candidate effect."""
    without = f"{numbers.column_mm(screening.cv_rmse_mm)} mm without any of them"
    return f"Held-out error: per coordinate, when each pose is predicted from the others; it is {without}."


def evidence_sentence() -> str:
    """Sentence on the words for evidence in a ranking."""
    return (
        f"Evidence is strong where the log evidence, the number beside it, is above {MIN_LOG_EVIDENCE:g} and p below "
        f"{MAX_P_VALUE:g} (Holm-corrected for the number of effects), none below {FOLDED_BELOW:g}, weak between. "
        "Effects that could make the same all have it; their log Bayes factor decides between them."
    )


def nothing_shows(screening: Screening) -> str:
    """Sentence that lists the candidate effects without a detectable member; "" where there are none."""
    silent = [c.name for c in screening.candidates if not c.members]
    return f"Nothing shows of {numbers.listing(silent)}." if silent else ""


def untestable_blocks(untestable: Sequence[Untestable]) -> list[Block]:
    """Blocks on effects that these data cannot test, with reasons and remedies; [] where all can be tested."""
    return [Paragraph(f"{CANNOT_BE_TESTED}:"), Bullets(not_testable(untestable))] if untestable else []


def alike(candidate: Candidate) -> tuple[Span, ...]:
    """Effects that could explain most of what a candidate explains, with the shares; () where there are none."""
    most = sorted(candidate.overlaps.items(), key=lambda item: -item[1])[:_MOST_ALIKE]
    named = [spans(effect(name), f" {numbers.share(share)}".replace(" %", f"{_NO_BREAK}%")) for name, share in most]
    return joined(named, ", ")


# ---- one effect -----------------------------------------------------------------------------------------------------


def candidate_blocks(
    name: str, candidate: Candidate | None, calibration: Calibration, held_out_mm: float, *, own: bool = False
) -> list[Block]:
    """Blocks on an effect: description, estimated values, confounded effects, confirming experiment.

    Args:
        candidate: None for an effect that is no candidate, such as one in the model.
        held_out_mm: held-out error without the effect.
        own: whether it is from the user's file.
    """
    described = _description(name, candidate, calibration)
    facts: list[tuple[str, object]] = [
        ("equation", described.equation),
        ("needs", described.needs),
        ("from", "your effects file" if own else ""),
    ]
    if candidate is not None:
        facts.append(("explains, of the residual", numbers.share(candidate.explained_share)))
        if candidate.members:
            now, then = numbers.column_mm(held_out_mm), numbers.column_mm(candidate.cv_rmse_mm)
            by = numbers.relative_change(held_out_mm, candidate.cv_rmse_mm)
            facts.append(("held-out error", f"{now} → {then} mm per coordinate ({by})"))
        facts += [(_ALIKE, alike(candidate) or "nothing else here")]
        facts += [("assumed", candidate.family.note)]
    facts.append(("to be sure, measure", described.confirm))
    head: list[Block] = [Paragraph(f"Effect {name}", heading=True), Facts([fact for fact in facts if fact[1]])]
    if candidate is None:
        return head
    if not candidate.values:
        return [*head, Paragraph("Nothing of it shows in the residual.", soft=True)]
    linear = "Linear estimates from the residual; a fit with the effect in the model settles them."
    return [*head, estimated_values(candidate, calibration, height="260px"), Paragraph(linear, soft=True)]


def estimated_values(candidate: Candidate, calibration: Calibration, *, height: str = "") -> Table:
    """Table of a candidate's coefficients as the ranking estimates them, with their meaning on the arm."""
    values = [(value.name, value.value, value.sigma) for value in candidate.values]
    return _values("estimated", candidate.members, values, calibration, height)


def fitted_effect(name: str, calibration: Calibration) -> list[Block]:
    """Blocks with the fitted parameters of an effect in the model."""
    members = [e for e in calibration.model.effects if family_name(e) == name]
    mine = {full_name(member, parameter) for member in members for parameter in member.parameters}
    values = [(row["name"], row["value"], row["sigma"]) for row in calibration.parameter_rows() if row["name"] in mine]
    return [
        Paragraph("It is in the model. Fitted together with everything else:", soft=True),
        _values("fitted", members, values, calibration, "260px"),
    ]


def _values(
    heading: str,
    members: Sequence[Effect],
    values: Sequence[tuple[str, float, float]],
    calibration: Calibration,
    height: str,
) -> Table:
    """Table of parameters (full name, value, sigma) with description and meaning on the arm."""
    known, joints = parameters_by_name(members), joints_by_parameter(calibration.model.robot, members)
    rows: list[tuple[str, str, str]] = []
    for name, value, sigma in values:
        owner, parameter = known[name]
        is_read_already = parameter.unit == "rad" and not has_meaning(owner)  # in degrees
        is_zero = abs(value) < sigma  # nothing that could have a meaning on the arm
        on_arm = "" if is_read_already or is_zero else meaning(owner, parameter, value, calibration)
        means = ": ".join(filter(None, (parameter.doc, on_arm)))
        size = numbers.with_sigma(value, sigma, parameter.unit)
        rows.append((name.partition(".")[2] or name, size, means or numbers.MISSING))
    selects = [joint(joints[name]) if name in joints else None for name, *_ in values]
    headers = (heading, "value ± sigma", "that is")
    return Table(headers, rows, left=(0, 2), rows_select=selects, height=height)


def _description(name: str, candidate: Candidate | None, calibration: Calibration) -> Description:
    """Description of a candidate effect, or of an effect in the model."""
    if candidate is not None:
        return candidate.family.description
    inside = next((effect for effect in calibration.model.effects if family_name(effect) == name), None)
    return describe(inside) if inside is not None else Description(name)
