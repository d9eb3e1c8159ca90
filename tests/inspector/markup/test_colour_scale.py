"""Numbers as colours: even steps, ends that hold, and a scale that says what they mean."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from inspector.markup.parts.colour_scale import (
    ERROR,
    SIGNED,
    bar,
    coloured,
    round_limit,
)
from inspector.markup.parts.palette import UNKNOWN, rgb
from tests.support.colour_vision import DARK, DARK_PANEL, EYES, LIGHT, contrast, difference

ERRORS = ["#{:02X}{:02X}{:02X}".format(*colour) for colour in coloured(np.linspace(0, 2, 30), 0.0, 2.0, ERROR)]


@pytest.mark.parametrize("eyes", EYES)
def test_larger_errors_look_less_like_none_in_even_steps(eyes: str) -> None:
    steps = np.array([difference(one, other, eyes) for one, other in pairwise(ERRORS)])
    assert steps.max() < 3 * steps.mean()
    assert (np.diff([difference(ERRORS[0], colour, eyes) for colour in ERRORS]) > 0).all()
    assert difference(ERRORS[0], ERRORS[-1], eyes) > 100


@pytest.mark.parametrize("background", [LIGHT, DARK, DARK_PANEL])
def test_every_error_stands_out_from_a_light_and_a_dark_page(background: str) -> None:
    assert min(contrast(colour, background) for colour in ERRORS) >= 3.0


def test_signed_colours_are_grey_at_zero_and_apart_in_blue_and_red_beside_it() -> None:
    below, zero, above = coloured([-1.0, 0.0, 1.0], -1.0, 1.0, SIGNED).astype(int)
    assert np.ptp(zero) < 15
    assert below[2] - below[0] > 100
    assert above[0] - above[2] > 100


def test_what_lies_outside_has_the_ends_colour_and_what_is_unknown_its_own() -> None:
    got = coloured([-5.0, 0.0, 9.0, 1.0, np.nan], 0.0, 1.0, ERROR)
    assert tuple(got[0]) == tuple(got[1]) == rgb(ERROR[0])
    assert tuple(got[2]) == tuple(got[3]) == rgb(ERROR[-1])
    assert tuple(got[4]) == rgb(UNKNOWN)
    assert coloured(np.zeros(0), 0.0, 1.0, ERROR).shape == (0, 3)


@given(st.floats(1e-9, 1e9))
def test_a_scale_ends_at_a_round_number_just_above(value: float) -> None:
    limit = round_limit(value)
    assert value * (1 - 1e-6) <= limit <= 2.001 * value
    mantissa = limit / 10 ** np.floor(np.log10(limit) + 1e-9)
    assert min(abs(mantissa - m) for m in (1, 2, 3, 5, 10)) < 1e-6


def test_a_scale_of_nothing_is_one() -> None:
    assert [round_limit(v) for v in (0.0, -1.0, float("nan"), float("inf"))] == [1.0] * 4


@pytest.mark.parametrize(
    ("low", "high", "ends"),
    [(0.0, 0.5, ["0 mm", "0.25 mm", "0.5 mm"]), (-0.1, 0.1, ["-0.1 mm", "0 mm", "+0.1 mm"])],
)
def test_the_bar_has_its_ends_with_their_unit(low: float, high: float, ends: list[str]) -> None:
    text = bar("error <b>", low, high, ERROR)
    for end in ends:
        assert f">{end}</span>" in text
    assert "error &lt;b&gt;" in text
    assert "line:" not in text


def test_a_mark_lies_where_its_number_does_or_is_left_out() -> None:
    assert "calc(25.00% - 1px)" in bar("e", 0.0, 2.0, ERROR, mark=(0.5, "noise <i>"))
    assert "line: noise &lt;i&gt;" in bar("e", 0.0, 2.0, ERROR, mark=(0.5, "noise <i>"))
    assert "line:" not in bar("e", 0.0, 2.0, ERROR, mark=(2.5, "noise"))
