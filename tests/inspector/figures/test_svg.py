"""Figures as still SVG: every value is where the axis says, nothing becomes markup, hovering tells the values."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from inspector.figures.residual_plots import residual_against
from inspector.figures.style import figure, scatter
from inspector.figures.svg.axis import axis_of
from inspector.figures.svg.figure import svg_of
from inspector.figures.svg.marks import cell_colour
from inspector.figures.svg.text import hover, plain
from tests.support.tiny_dataset import HOSTILE

WIDTH, HEIGHT = 850, 330


def parsed(svg: str) -> ET.Element:
    return ET.fromstring(svg)


def ticks(svg: str, anchor: str) -> dict[float, float]:
    """Numbers of an axis and where they stand, px: "middle" for x, "end" for y."""
    place = "x" if anchor == "middle" else "y"
    return {
        float(text.text or "nan"): float(text.get(place) or "nan")
        for text in parsed(svg).iter("text")
        if text.get("class") == "faint" and text.get("text-anchor") == anchor
    }


def test_points_stand_where_the_axes_say() -> None:
    x, y = [0.0, 1.0, 4.0], [-2.0, 0.5, 3.0]
    drawn = residual_against(
        x,
        y,
        ["a", HOSTILE, "c"],
        [False, False, True],
        x_title="q1, °",
        y_title="error, mm",
        band=(-1.0, 1.0),
    )
    svg = svg_of(drawn, WIDTH, HEIGHT, name="f", title=HOSTILE)
    across, up = ticks(svg, "middle"), ticks(svg, "end")
    fit_x, fit_y = (np.polyfit(list(of), list(of.values()), 1) for of in (across, up))
    points = [circle for circle in parsed(svg).iter("circle") if circle.find("title") is not None]
    assert [float(p.get("cx") or 0) for p in points] == pytest.approx(np.polyval(fit_x, x[:2]), abs=0.2)
    assert [float(p.get("cy") or 0) for p in points] == pytest.approx(np.polyval(fit_y, y[:2]), abs=0.2)
    said = [p.findtext("title") or "" for p in points]
    assert said[1] == f"pose {HOSTILE} (training)\nq1, ° 1\nerror, mm 0.5"
    assert HOSTILE not in svg
    band = next(r for r in parsed(svg).iter("rect") if "138,143,152,0.22" in (r.get("fill") or ""))
    assert float(band.get("height") or 0) == pytest.approx(2.0 * abs(fit_y[0]), abs=0.3)


@given(st.floats(-1.0, 1.0))
def test_a_colour_lies_between_its_neighbours(value: float) -> None:
    scale = [(0.0, "#000000"), (1.0, "#ffffff")]
    colour = cell_colour({"zmin": -1.0, "zmax": 1.0, "colorscale": scale}, value)
    assert int(colour[1:3], 16) == round(255 * (value + 1.0) / 2.0)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=9), st.sampled_from(["linear", "log"]))
def test_an_axis_holds_its_values_and_its_ticks_are_few(values: list[float], kind: str) -> None:
    axis = axis_of({"type": kind}, values, 300.0, marks=True)
    for value in values:
        share = axis.share(value)
        assert math.isnan(share) if kind == "log" and value <= 0 else -1e-6 <= share <= 1.0 + 1e-6
    assert len(axis.ticks) <= 12
    assert all(-1e-6 <= axis.share_of_scaled(at) <= 1.0 + 1e-6 for at, _ in axis.ticks)


def test_words_of_plotly_become_plain_words() -> None:
    assert plain("<b>Joint 1</b> &lt;x&gt;") == "Joint 1 <x>"
    told = hover("at %{x:.2f} %{customdata}<extra>no</extra>", {"x": 1.234, "customdata": "<p>"})
    assert re.fullmatch(r"<title>at 1\.23 .*</title>", told)
    assert hover(None, {}) == ""


def test_a_panel_of_one_scale_has_as_many_pixels_a_unit_across_as_up() -> None:
    equal = {"range": [0.0, 300.0], "constrain": "domain"}
    dots = scatter("a", [0.0, 1000.0], [0.0, 200.0], marker={}, hover="%{x}")
    drawn = figure([dots], xaxis={"range": [0.0, 1000.0]}, yaxis=equal)
    marks = list(parsed(svg_of(drawn, 800, 600, name="views", title="views")).iter("circle"))
    (x0, y0), (x1, y1) = (
        (float(c.get("cx", "")), float(c.get("cy", ""))) for c in marks if c.find("title") is not None
    )
    assert (y0 - y1) / 200.0 == pytest.approx((x1 - x0) / 1000.0, rel=1e-2)


def test_an_axis_of_one_value_as_small_as_numbers_go_has_ticks() -> None:
    assert axis_of({}, [5e-324], 300.0, marks=True).ticks
