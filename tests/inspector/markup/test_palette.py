"""Colours that are drawn together can be told apart by all eyes, and seen on a light and on a dark page."""

from __future__ import annotations

from itertools import combinations, product

import pytest

from calib.rendering.colours import CURVES, EFFECTS, LINKS, NOISE, UNEXPLAINED
from inspector.markup.parts.palette import (
    BESIDE_COLOURS,
    HIGHLIGHT,
    MEASURE,
    MODEL_COLOURS,
    PROPOSAL,
    ROLE_COLOURS,
    SCAN,
)
from tests.support.colour_vision import DARK, DARK_PANEL, EYES, LIGHT, contrast, difference

DRAWN = {
    **ROLE_COLOURS, **MODEL_COLOURS, "selected": HIGHLIGHT, "grid and scale": MEASURE, "scan": SCAN,
}  # fmt: skip
PLOTTED = (*ROLE_COLOURS.values(), *BESIDE_COLOURS, HIGHLIGHT, MEASURE, PROPOSAL)


@pytest.mark.parametrize("name", DRAWN)
@pytest.mark.parametrize("background", [LIGHT, DARK])
def test_points_arrows_and_lines_stand_out_from_the_page(name: str, background: str) -> None:
    assert contrast(DRAWN[name], background) >= 3.0  # WCAG 2.1, 1.4.11


@pytest.mark.parametrize("colour", PLOTTED)
@pytest.mark.parametrize("background", [LIGHT, DARK_PANEL])
def test_marks_in_figures_stand_out_from_the_panel(colour: str, background: str) -> None:
    assert contrast(colour, background) >= 3.0


@pytest.mark.parametrize("eyes", EYES)
@pytest.mark.parametrize("colours", [ROLE_COLOURS, MODEL_COLOURS])
def test_colours_of_one_kind_are_told_apart_at_a_glance(colours: dict[str, str], eyes: str) -> None:
    for one, other in combinations(colours.values(), 2):
        assert difference(one, other, eyes) >= 35.0, (one, other)


@pytest.mark.parametrize("eyes", EYES)
def test_points_are_told_from_arrows(eyes: str) -> None:
    for one, other in product(ROLE_COLOURS.values(), MODEL_COLOURS.values()):
        assert difference(one, other, eyes) >= 20.0, (one, other)


@pytest.mark.parametrize("eyes", EYES)
def test_learned_curves_are_told_from_their_neighbours_and_from_the_roles_of_poses(eyes: str) -> None:
    for other in (LINKS, *EFFECTS[:2], NOISE, UNEXPLAINED, *ROLE_COLOURS.values()):
        assert difference(CURVES, other, eyes) >= 20.0, other
    assert contrast(CURVES, LIGHT) >= 3.0
    assert contrast(CURVES, DARK_PANEL) >= 3.0
