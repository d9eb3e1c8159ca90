"""Figures show the numbers they were given, with units, in light and dark."""

from __future__ import annotations

import html
import json

import numpy as np
import plotly.graph_objects as go
import pytest

from inspector.palette import FACE_COLOURS, GROUP_COLOURS, ROLE_COLOURS, group_colour, rgb, role_colour
from inspector.plots import convergence, correlation_heatmap, parameter_label, pose_residuals

NAMES = ("a1", "alpha2", "theta3", "d6", "aTCP")


def _pearson() -> np.ndarray:
    r = np.array(
        [[1, 0.5, -0.25, np.nan, 0], [0.5, 1, 0, np.nan, -1], [-0.25, 0, 1, np.nan, 0.1], [np.nan] * 5,
         [0, -1, 0.1, np.nan, 1]]
    )  # fmt: skip
    return r


@pytest.mark.parametrize(
    ("name", "label"),
    [("alpha3", "α3"), ("beta1", "β1"), ("thetaTCP", "θTCP"), ("a2", "a2"), ("dTCP", "dTCP")],
)
def test_parameter_label(name: str, label: str) -> None:
    assert parameter_label(name) == label


def test_heatmap_shows_every_value_and_marks_what_has_no_influence() -> None:
    r = _pearson()
    fig = correlation_heatmap(NAMES, r)
    missing, values = fig.data
    np.testing.assert_array_equal(np.asarray(values.z, float), r)
    assert (values.zmin, values.zmax) == (-1, 1)
    assert list(values.x) == list(values.y) == ["a1", "α2", "θ3", "d6", "aTCP"]
    # exactly the NaN cells are covered by the grey trace, each named with the parameter that does nothing
    np.testing.assert_array_equal(np.isnan(np.asarray(missing.z, float)), ~np.isnan(r))
    assert "no influence" in missing.hovertemplate
    assert missing.customdata[0][3] == "d6"
    assert missing.customdata[3][3] == "d6"


def test_heatmap_scale_is_symmetric_and_white_at_zero() -> None:
    fig = correlation_heatmap(NAMES, np.eye(5))
    assert len(fig.data) == 1  # nothing missing: no grey trace
    scale = dict(fig.data[0].colorscale)
    assert scale[0.5] == "#F7F7F7"
    blue, red = rgb(scale[0.0]), rgb(scale[1.0])
    assert blue[2] > blue[0]
    assert red[0] > red[2]


def test_heatmap_reads_from_the_top_left() -> None:
    assert correlation_heatmap(NAMES, np.eye(5)).layout.yaxis.autorange == "reversed"


def test_convergence_is_logarithmic_in_mm_and_keeps_the_numbers() -> None:
    fig = convergence([10.0, 1.0, 0.1], [12.0, 2.0, 0.9])
    assert fig.layout.yaxis.type == "log"
    assert "mm" in fig.layout.yaxis.title.text
    np.testing.assert_allclose(fig.data[0].y, [10, 1, 0.1])
    np.testing.assert_allclose(fig.data[1].y, [12, 2, 0.9])
    assert [t.name for t in fig.data] == ["training", "test"]
    assert list(fig.data[0].x) == [0, 1, 2]


def test_convergence_without_test_poses_and_with_an_exact_zero() -> None:
    fig = convergence([1.0, 0.0], None)
    assert len(fig.data) == 1
    assert np.isnan(fig.data[0].y[1])


def test_pose_residuals_colour_by_role_and_outline_the_selected_pose() -> None:
    fig = pose_residuals(["p1", "p2", "p3"], ["reference", "train", "test"], [0.0, 0.1, 0.4], selected="p2")
    by_name = {trace.name: trace for trace in fig.data}
    assert by_name["test"].marker.color == ROLE_COLOURS["test"]
    assert list(by_name["test"].y) == [0.4]
    assert list(by_name["training"].marker.line.width) == [2]
    assert list(by_name["test"].marker.line.width) == [0]
    assert list(fig.layout.xaxis.categoryarray) == ["p1", "p2", "p3"]
    assert "mm" in fig.layout.yaxis.title.text


def test_a_hostile_pose_name_stays_text() -> None:
    name = '<a href="http://evil.example">p1</a>'
    bar = pose_residuals([name], ["train"], [0.1]).data[0]
    assert bar.x[0] == html.escape(name)
    assert "<" not in bar.x[0]
    assert "<" not in parameter_label(name)


def _figures(dark: bool) -> list[go.Figure]:
    return [
        correlation_heatmap(NAMES, _pearson(), dark=dark),
        convergence([1.0, 0.1], [1.0, 0.2], dark=dark),
        pose_residuals(["p1"], ["train"], [0.1], dark=dark),
    ]


def test_dark_and_light_differ_and_both_become_json() -> None:
    for light, dark in zip(_figures(False), _figures(True), strict=True):
        assert light.layout.font.color != dark.layout.font.color
        assert light.layout.template != dark.layout.template
        for fig in (light, dark):
            assert json.loads(fig.to_json())["data"]


def test_palette_has_one_meaning_a_colour() -> None:
    strong = [*FACE_COLOURS, *ROLE_COLOURS.values()]
    assert len(set(strong)) == len(strong)
    assert rgb("#FF8000") == (255, 128, 0)
    assert role_colour("no such role") not in ROLE_COLOURS.values()
    assert group_colour(0) == group_colour(len(GROUP_COLOURS))
