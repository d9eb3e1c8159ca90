"""Probabilities of causes: sets that sum to 1, weights that decide, and what is told of them."""

from __future__ import annotations

import math

import pytest

from calib.diagnosis.probabilities import (
    UNKNOWN,
    CauseOption,
    CauseProbabilities,
    CauseSet,
    answer_probabilities,
    cause_probabilities,
    questions,
)
from calib.diagnosis.result import Diagnosis
from calib.present.diagnosis.budget import probability_sentence
from calib.rendering.blocks import plain


@pytest.mark.thorough
def test_the_sets_sum_to_one_and_hold_the_unknown(found: Diagnosis) -> None:
    sets = found.probabilities.sets
    assert sum(one.p for one in sets) == pytest.approx(1.0)
    assert any(one.causes == (UNKNOWN,) for one in sets)
    assert len({frozenset(one.causes) for one in sets}) == len(sets)
    assert list(sets) == sorted(sets, key=lambda one: -one.p)


def test_what_is_hidden_is_likely_and_each_effect_has_the_sum_of_its_sets(found: Diagnosis) -> None:
    likely = found.probabilities
    assert set(likely.sets[0].causes) == {"joint_compliance", "backlash"} == set(found.missing)
    assert likely.sets[0].p > 0.8
    for cause, p in likely.causes.items():
        assert p == pytest.approx(sum(one.p for one in likely.sets if cause in one.causes))
    document = found.to_dict()
    assert {frozenset(one["causes"]): one["p"] for one in document["probabilities"]} == {
        frozenset(one.causes): one.p for one in likely.sets
    }
    assert next(c for c in document["candidates"] if c["effect"] == "backlash")["probability"] > 0.8


def test_there_is_a_question_for_each_effect_and_one_for_the_rest(found: Diagnosis) -> None:
    asked = questions(found)
    assert len(asked) == 1 + len(found.named)
    for name, answers in zip(found.named, asked, strict=False):
        causes = [answer.cause for answer in answers]
        assert causes[0] == name
        assert {"", UNKNOWN} < set(causes)


def test_the_weights_decide(found: Diagnosis) -> None:
    sure_of_nothing = cause_probabilities(found, {"other ": 50.0, "outside ": 50.0})
    assert sure_of_nothing.of(UNKNOWN) == pytest.approx(1.0)
    causes, p = answer_probabilities([CauseOption("a", {"x": 1.0}), CauseOption("b", {"x": 3.0})], {"x": math.log(2.0)})
    assert causes == ("a", "b")
    assert p == pytest.approx((0.2, 0.8))


def test_the_sentence_names_the_likeliest_sets() -> None:
    told = CauseProbabilities(
        (
            CauseSet(("backlash",), 0.9),
            CauseSet(("backlash", UNKNOWN), 0.06),
            CauseSet((), 0.035),
            CauseSet((UNKNOWN,), 0.005),
        )
    )
    assert plain(probability_sentence(told)) == (
        "How likely each set of causes is: backlash 90 %; backlash and something outside the catalogue 6 %; nothing is "
        "missing 4 %."
    )
