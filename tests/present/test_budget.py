"""The error budget as a sentence, a bar and JSON keys."""

from __future__ import annotations

from calib.diagnosis.budget import LINKS, NOISE, UNKNOWN, BudgetShare, ErrorBudget
from calib.present.diagnosis.budget import budget_blocks, budget_document, budget_parts, budget_sentence
from calib.present.results import to_dict
from calib.rendering.blocks import Presentation
from calib.rendering.colours import NEUTRAL, UNEXPLAINED
from calib.rendering.html import view
from tests.support.tiny_dataset import HOSTILE

BUDGET = ErrorBudget(
    (
        BudgetShare(LINKS, 0.90, 0.949),
        BudgetShare("joint_compliance", 0.03, 0.173),
        BudgetShare("curves_joint_1", 0.03, 0.173),
        BudgetShare("curves_joint_3", 0.01, 0.1),
        BudgetShare(NOISE, 0.027, 0.164),
        BudgetShare(UNKNOWN, 0.003, 0.055),
    ),
    1.0,
    of_test_poses=True,
    noise_is_known=True,
)


def test_the_sentence_has_every_share() -> None:
    assert budget_sentence(BUDGET) == (
        "Of the squared error as delivered: links 90 %, joint compliance 3 %, learned curves (joints 1 and 3) 4 %, "
        "noise 3 %, unexplained <1 %."
    )


def test_it_says_what_the_shares_rest_on() -> None:
    fitted = ErrorBudget((BudgetShare(LINKS, 0.9, 0.9), BudgetShare(UNKNOWN, 0.1, 0.3)), 1.0, False, False)
    assert "no test poses" in budget_sentence(fitted)
    assert "unexplained or noise 10 %" in budget_sentence(fitted)
    assert budget_document(fitted)["budget_of"] == "train"
    rose = ErrorBudget((BudgetShare(UNKNOWN, 1.0, 1.0),), 1.0, True, True, raised=("backlash",))
    assert "rose with backlash" in budget_sentence(rose)
    assert ">99 %" in budget_sentence(
        ErrorBudget((BudgetShare(LINKS, 0.999, 1.0), BudgetShare(NOISE, 0.001, 0.03)), 1.0, True, True)
    )


def test_the_bar_has_a_colour_for_each_cause() -> None:
    parts = budget_parts(BUDGET)
    assert len({part.colour for part in parts}) == len(parts) == 5
    assert [part.colour for part in parts[-2:]] == [NEUTRAL, UNEXPLAINED]
    html = view(Presentation("title", budget_blocks(BUDGET)))
    assert html.count("flex-grow:") == 5
    hostile = ErrorBudget((BudgetShare(HOSTILE, 1.0, 1.0),), 1.0, True, True)
    assert HOSTILE not in view(Presentation("title", budget_blocks(hostile)))


def test_the_keys_are_those_of_the_contract() -> None:
    found = to_dict(budget_document(BUDGET))
    assert found["budget_of"] == "test"
    assert found["budget"][0] == {"cause": "geometry", "share": 0.9, "mm": 0.949, "sigma_mm": None, "of": "arm"}
    assert budget_document(None) == {"budget": [], "budget_of": None}
