"""Candidates of effects: one ranking for terminal, page and report, and what is told of a single one."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import calib
from calib import calibrate, screen
from calib.calibration.result import Calibration
from calib.present.diagnosis.candidates import (
    BRIEF_RANKING,
    FOLDED_BELOW,
    FULL_RANKING,
    PANEL_RANKING,
    alike,
    candidate_blocks,
    estimated_values,
    ranking,
    ranking_to_choose_from,
    untestable_blocks,
)
from calib.present.effects import title
from calib.rendering import numbers
from calib.rendering.blocks import Bar, Facts, Folded, Table, effect, plain
from calib.screening.candidates import Screening

SAMPLE = Path(__file__).parents[2] / "sample_data" / "hidden_effect_a"


@pytest.fixture(scope="module")
def fitted() -> Calibration:
    return calibrate(calib.load_dataset(SAMPLE))


@pytest.fixture(scope="module")
def screening(fitted: Calibration) -> Screening:
    return screen(fitted)


def table_of(screening: Screening, columns: tuple[str, ...], **keywords: object) -> Table:
    table = ranking(screening, columns, **keywords)  # type: ignore[arg-type]
    assert isinstance(table, Table)
    return table


def test_a_column_says_the_same_wherever_the_ranking_stands(screening: Screening) -> None:
    tables = [table_of(screening, columns) for columns in (BRIEF_RANKING, FULL_RANKING, PANEL_RANKING)]
    cells = [{(row[0], name): row[k] for row in t.rows for k, name in enumerate(t.headers)} for t in tables]
    for one in cells:
        for other in cells:
            assert all(other[key] == value for key, value in one.items() if key in other)
    assert [row[0] for row in tables[0].rows] == [c.name for c in screening.candidates]


def test_the_page_ticks_what_convinces_and_leaves_out_what_does_not_show(screening: Screening) -> None:
    best = screening.candidates[0].name
    first, *folded = ranking_to_choose_from(screening, chosen=(best,), own=(best,))
    assert isinstance(first, Table)
    name, bar = first.rows[0][:2]
    assert plain(name) == f"{title(best)} (own) {best}"  # type: ignore[arg-type]
    assert isinstance(bar, Bar)
    assert bar.share == 1.0
    assert bar.words.startswith("strong ")
    assert first.mark == 0
    assert {row.value for row in first.rows_select if row} == {
        c.name for c in screening.candidates if c.members and c.log_evidence >= FOLDED_BELOW
    }
    tables = [block for fold in folded if isinstance(fold, Folded) for block in fold.blocks]
    rows = sum(len(table.rows) for table in [first, *tables] if isinstance(table, Table))
    assert rows == sum(bool(c.members) for c in screening.candidates)
    assert len(table_of(screening, BRIEF_RANKING, most=3).rows) == 3


def test_effects_of_single_places_stand_behind_curves_that_explain_more(screening: Screening) -> None:
    best = screening.candidates[0]
    first, passed_over, *_ = ranking_to_choose_from(screening, passed_over=(best.name,), chosen=(best.name,))
    assert isinstance(first, Table)
    assert best.name not in {row.value for row in first.rows_select if row}
    assert isinstance(passed_over, Folded)
    (table,) = passed_over.blocks
    assert isinstance(table, Table)
    assert table.rows_select[0] == effect(best.name)


def test_what_is_told_of_a_candidate_is_what_was_found(fitted: Calibration, screening: Screening) -> None:
    best = screening.candidates[0]
    facts = next(b for b in candidate_blocks(best.name, best, fitted, screening.cv_rmse_mm) if isinstance(b, Facts))
    told = dict(facts.pairs)
    assert told["equation"] == best.family.description.equation
    assert told["explains, of the residual"] == numbers.share(best.explained_share)
    assert [name for name in best.overlaps if name in plain(alike(best))]
    rows = estimated_values(best, fitted).rows
    for row, value in zip(rows, best.values, strict=True):
        assert row[1] == numbers.with_sigma(value.value, value.sigma, value.unit)
    assert math.isfinite(best.values[0].sigma)


def test_nothing_untestable_makes_no_block(screening: Screening) -> None:
    assert untestable_blocks(()) == []
    assert len(untestable_blocks(screening.untestable)) == 2
