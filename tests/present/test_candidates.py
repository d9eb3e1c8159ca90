"""Candidates of effects: one ranking for terminal, page and report, and what is told of a single one."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import calib
from calib.calibration.calibrate import calibrate
from calib.calibration.result import Calibration
from calib.present import numbers
from calib.present.blocks import Facts, Table, plain
from calib.present.candidates import (
    BRIEF_RANKING,
    FULL_RANKING,
    PANEL_RANKING,
    alike,
    candidate_blocks,
    estimated_values,
    ranking,
    untestable_blocks,
)
from calib.screening.candidates import Screening, screen

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
    table = table_of(screening, PANEL_RANKING, mark=(best,), own=(best,), ticked=True)
    assert table.rows[0][0] == f"✓ {best} (own)"
    assert table.mark == 0
    assert len(table.rows) == sum(bool(c.members) for c in screening.candidates)
    assert len(table_of(screening, BRIEF_RANKING, most=3).rows) == 3


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
