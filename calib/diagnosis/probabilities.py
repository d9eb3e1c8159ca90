"""Probability of each set of causes that remains after a diagnosis, "something outside the catalogue" among them.

The end of a search leaves questions: for each effect in the model, what made the part of the residual that it
explains, and, once, what made the rest. The answers are causes, nothing, or something outside the catalogue, and each
is weighed by what the search computed anyway:

    p(answer) = exp(w . f(answer)) / sum over the question's answers,

f log evidences over the best answer, and facts on the verdict. Log evidences alone are too sure, since laws of real
causes differ from those of the catalogue; the weights w are those that make told probabilities come true on simulated
arms of known causes (`benchmarks/probabilities.py`). Answers to different questions count as independent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from calib.diagnosis.decision_rules import EQUIVALENT_LOG_BAYES_FACTOR
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.probability_weights import WEIGHTS
from calib.diagnosis.verdict import Findings, conclude
from calib.screening.candidates import MIN_CONFOUNDED_OVERLAP, Candidate

UNKNOWN = "unknown"  # a cause outside the catalogue, or one that these data do not bring up
_MOST_BEHIND = 12.0  # log evidence, behind the best, up to which an effect is an answer
_LEAST = 1e-4  # probability of a set that is kept
_MOST_ANSWERS = 12  # of a question


@dataclass(frozen=True)
class CauseOption:
    """Possible cause of a part of the residual, with the facts that are weighed for it."""

    cause: str  # an effect's name, UNKNOWN, or "" for nothing
    facts: Mapping[str, float]


@dataclass(frozen=True)
class CauseSet:
    """Set of causes that may be behind a dataset's errors, and its probability; without any: nothing is missing."""

    causes: tuple[str, ...]
    p: float


@dataclass(frozen=True)
class CauseProbabilities:
    """Probabilities of sets of causes, which sum to 1, the likeliest first."""

    sets: tuple[CauseSet, ...]

    def of(self, cause: str) -> float:
        """Probability of one cause, whatever else there is."""
        return sum(one.p for one in self.sets if cause in one.causes)

    @property
    def causes(self) -> dict[str, float]:
        """Probability of each cause, whatever else there is, the likeliest first."""
        names = dict.fromkeys(name for one in self.sets for name in one.causes)
        return dict(sorted(((name, self.of(name)) for name in names), key=lambda item: -item[1]))


def cause_probabilities(findings: Findings, weights: Mapping[str, float] | None = None) -> CauseProbabilities:
    """Probabilities of the sets of causes that remain after a search.

    Args:
        findings: of the search.
        weights: of the answers' facts; those learned on simulated arms where None.
    """
    if findings.data_problem is not None:  # a mistake in the data, which no effect of the catalogue is
        return CauseProbabilities((CauseSet((UNKNOWN,), 1.0),))
    answered = [answer_probabilities(answers, weights) for answers in questions(findings)]
    found: dict[tuple[str, ...], float] = {}
    for answers in product(*(zip(*one, strict=True) for one in answered)):
        p = float(np.prod([p for _, p in answers]))
        if p > _LEAST:
            causes = tuple(dict.fromkeys(cause for cause, _ in answers if cause))
            causes = (*(c for c in causes if c != UNKNOWN), *([UNKNOWN] if UNKNOWN in causes else []))
            key = next((known for known in found if set(known) == set(causes)), causes)
            found[key] = found.get(key, 0.0) + p
    found.setdefault((UNKNOWN,), 0.0)
    total = sum(found.values())
    ranked = sorted(found.items(), key=lambda item: -item[1])
    return CauseProbabilities(tuple(CauseSet(causes, p / total) for causes, p in ranked))


def answer_probabilities(
    answers: Sequence[CauseOption], weights: Mapping[str, float] | None = None
) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Causes of a question's answers, and the probability of each."""
    weights = WEIGHTS if weights is None else weights
    scores = np.array([sum(weights.get(k, 0.0) * value for k, value in one.facts.items()) for one in answers])
    p = np.exp(scores - scores.max())
    return tuple(one.cause for one in answers), tuple(map(float, p / p.sum()))


# ---- the questions --------------------------------------------------------------------------------------------------


def questions(findings: Findings) -> tuple[tuple[CauseOption, ...], ...]:
    """Answers to each question that a search leaves: one for each effect in the model, and one for the rest."""
    about = _state(findings)
    steps = findings.decided_steps
    told = [_of_effect(findings, steps, e.name, about) for e in steps[-1].selected]
    return (*told, _of_the_rest(findings, steps[-1], about))


def _state(findings: Findings) -> dict[str, float]:
    """Facts on the end of a search that bear on every question."""
    tests, reason = findings.residual_tests, conclude(findings).reason
    facts = {
        f"reason {reason}": float(bool(reason)),
        "excess": float(np.clip(np.log(tests.residual_mm / max(tests.noise_mm, 1e-9)), 0.0, 1.5)),
        "outliers": float(bool(tests.outlier_poses)),
        "shaped": float(findings.noise is not None),
        "broken": float(findings.promise_is_broken),
        "effects": float(len(findings.decided_steps[-1].selected)),
        "drift": float(bool(findings.unproven)),
    }
    return {name: value for name, value in facts.items() if value}


def _with_state(prefix: str, about: Mapping[str, float], more: Mapping[str, float]) -> dict[str, float]:
    return {f"{prefix} {name}": value for name, value in {"": 1.0, **about, **more}.items()}


def _of_effect(
    findings: Findings, steps: Sequence[FitStep], name: str, about: Mapping[str, float]
) -> tuple[CauseOption, ...]:
    """Answers to what made the part that an effect in the model explains: itself, others like it, chance, unknown."""
    k = next((k for k, step in enumerate(steps) if step.effect == name), None)
    before = steps[k - 1] if k else None
    own = None if k is None else steps[k].candidate
    ranked = () if before is None or before.screening is None else before.screening.candidates
    rivals = _rivals(own, [c for c in ranked if c.name not in findings.named])
    alike = next((one for one in findings.confounded_sets if one.effect == name), None)
    equivalent = () if alike is None else alike.equivalent
    untested = () if alike is None else alike.untested
    evidence = 10.0 if own is None else own.log_evidence
    sparse = float(own is not None and own.family.sparse)
    lead = min((behind for rival, behind in rivals), default=_MOST_BEHIND)
    size = {"evidence": float(np.log(max(evidence, 1.0))), "sparse": sparse, "lead": min(max(lead, 0.0), _MOST_BEHIND)}
    answers = {name: {"own": 1.0}}
    for rival, behind in rivals:
        answers[rival.name] = {"rival": 1.0, "rival behind": behind, "rival sparse": float(rival.family.sparse)}
    for kind, names in (("equivalent", equivalent), ("untested", untested)):
        for other in names:
            behind = answers.get(other, {}).get("rival behind", EQUIVALENT_LOG_BAYES_FACTOR)
            answers[other] = {kind: 1.0, **({f"{kind} behind": behind} if kind == "equivalent" else {})}
    answers[""] = _with_state("chance", {}, {"evidence": size["evidence"], "sparse": sparse})
    answers[UNKNOWN] = _with_state("other", about, size)
    return tuple(CauseOption(cause, facts) for cause, facts in answers.items())


def _of_the_rest(findings: Findings, last: FitStep, about: Mapping[str, float]) -> tuple[CauseOption, ...]:
    """Answers to what made the rest: nothing, an effect that was not added, unknown."""
    ranked = () if last.screening is None else last.screening.candidates
    known = {e.name for e in last.selected}
    known |= {n for one in findings.confounded_sets if one.effect in known for n in one.names}
    free = [c for c in ranked if c.name not in known]
    open_set = [c for c in free if findings.undecided is not None and c.name in findings.undecided.names]
    best = next(iter(open_set or free), None)
    refused = "" if findings.refused is None else findings.refused.effect
    answers = {"": dict[str, float]()}
    shown = [] if best is None or best.log_evidence <= 0.0 else [(best, 0.0), *_rivals(best, free)]
    for one, behind in shown:
        facts = {"size": float(np.log1p(shown[0][0].log_evidence)), "open": float(bool(open_set))}
        facts |= {"refused": float(one.name == refused), "effects": about.get("effects", 0.0)}
        facts |= {f"to {name}": value for name, value in about.items() if name.startswith("reason")}
        answers[one.name] = _with_state("rest", {}, facts | {"behind": behind, "sparse": float(one.family.sparse)})
    answers[UNKNOWN] = _with_state("outside", about, {"open": float(bool(open_set)), "refused": float(bool(refused))})
    return tuple(CauseOption(cause, facts) for cause, facts in answers.items())


def _rivals(best: Candidate | None, ranked: Sequence[Candidate]) -> list[tuple[Candidate, float]]:
    """Candidates that could explain what the best one explains, with the log evidence by which each is behind."""
    if best is None:
        return []
    rivals = [
        (c, best.log_evidence - c.log_evidence)
        for c in ranked
        if c.name != best.name and c.members and best.overlaps.get(c.name, 0.0) > MIN_CONFOUNDED_OVERLAP
    ]
    rivals = [(c, behind) for c, behind in rivals if behind < _MOST_BEHIND and c.log_evidence > 0.0]
    return sorted(rivals, key=lambda item: item[1])[: _MOST_ANSWERS - 3]
