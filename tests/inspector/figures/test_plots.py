"""Figures show the numbers they were given, with units, for light and dark pages."""

from __future__ import annotations

import html
import json
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from inspector.figures.plots import (
    correlation_heatmap,
    error_history,
    outline,
    pose_residuals,
)
from inspector.figures.residual_plots import (
    SELECTED,
    added_variable,
    residual_against,
    select,
)

NAMES = ("a1", "alpha2", "theta3", "d6", "aTCP")


def _pearson() -> np.ndarray:
    r = np.array(
        [[1, 0.5, -0.25, np.nan, 0], [0.5, 1, 0, np.nan, -1], [-0.25, 0, 1, np.nan, 0.1], [np.nan] * 5,
         [0, -1, 0.1, np.nan, 1]]
    )  # fmt: skip
    return r


def test_heatmap_reads_from_the_top_left() -> None:
    assert correlation_heatmap(NAMES, np.eye(5)).layout.yaxis.autorange == "reversed"


def test_a_hostile_pose_name_stays_text() -> None:
    name = '<a href="http://evil.example">p1</a>'
    drawn = residual_against([1], [1], [name], [False], x_title=name, y_title=name, band=(0, 1), selected=name)
    assert "<a" not in drawn.to_json()
    assert _ringed(drawn) == [(1.0, 1.0)]
    bar = pose_residuals([name], ["train"], [0.1]).data[0]
    assert bar.x[0] == html.escape(name)
    assert "<" not in bar.x[0]
    heatmap = correlation_heatmap((name, "a1"), np.eye(2))
    assert "<a" not in heatmap.to_json()


IDS = ["p1", "p2", "p3", "p4"]
IS_TEST = [False, True, False, False]


def _against(**more: Any) -> go.Figure:
    return residual_against(
        [1.0, 2.0, 3.0, 4.0], [0.1, 0.2, 0.3, np.nan], IDS, IS_TEST, x_title="joint 1 angle, °", y_title="error, mm",
        band=(0.0, 0.15), **more,
    )  # fmt: skip


def _figures() -> list[go.Figure]:
    smooth = ([1.0, 2.0, np.nan, 4.0], [0.1, 0.2, np.nan, 0.3])
    return [
        correlation_heatmap(NAMES, _pearson()),
        pose_residuals(["p1"], ["train"], [0.1]),
        error_history(["as delivered", "calibrated links"], [1.0, 0.1], [1.0, np.nan], 0.05),
        _against(smooth=smooth, selected="p2"),
        added_variable([0.1, 0.2], [0.2, 0.1], "joint_compliance"),
    ]


def test_figures_leave_ground_and_text_to_the_page_and_become_json() -> None:
    for fig in _figures():
        assert fig.layout.paper_bgcolor == fig.layout.plot_bgcolor == "rgba(0,0,0,0)"
        assert "color" not in str([note.font for note in fig.layout.annotations])
        assert json.loads(fig.to_json())["data"]


def test_every_value_of_every_figure_is_one_that_plotly_knows_and_every_axis_has_its_unit() -> None:
    for fig in _figures():
        checked = go.Figure(fig.to_plotly_json())  # raises on what plotly does not know
        assert len(checked.data) == len(fig.data)
    for fig in _figures()[3:4]:
        titles = [axis["title"]["text"] for key, axis in fig.to_plotly_json()["layout"].items() if "axis" in key]
        assert all("mm" in title or "°" in title for title in titles)


def _ringed(fig: go.Figure) -> list[tuple[float | None, float | None]]:
    return [(ring.x[0], ring.y[0]) for ring in fig.data if ring.name == SELECTED]


def test_selection_moves_a_ring_and_nothing_else() -> None:
    fig = _against(selected="p1")
    before = [trace.to_plotly_json() for trace in fig.data if trace.name != SELECTED]
    assert _ringed(fig) == [(1.0, 0.1)]
    assert _ringed(select(fig, "p2")) == [(2.0, 0.2)]
    assert _ringed(select(fig, "not measured")) == _ringed(select(fig, None)) == [(None, None)]
    assert [trace.to_plotly_json() for trace in fig.data if trace.name != SELECTED] == before
    bars = pose_residuals(["p1", "p2"], ["train", "train"], [0.1, 0.2], selected="p1")
    assert list(outline(bars, "p2").data[0].marker.line.width) == [0, 2]


def test_of_two_hundred_poses_few_are_named_on_the_axis() -> None:
    ids = [f"p{i:03d}" for i in range(200)]
    axis = pose_residuals(ids, ["train"] * 200, np.ones(200)).layout.xaxis
    assert 8 <= len(axis.tickvals) <= 16
    assert list(axis.tickvals) == list(axis.ticktext)
    assert len(axis.categoryarray) == 200


def test_what_a_click_on_a_figure_asks_for() -> None:
    """Ids are unique in a trace, as plotly wants them; where points share a pose there is a value for each."""
    shared = added_variable([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], "backlash", ["p1", "p1", "<p2>"]).data[0]
    assert shared.meta == {"ask": "pose", "values": ["p1", "p1", "&lt;p2&gt;"]}
    assert shared.ids is None
    history = error_history(["as delivered", "calibrated links"], [1.0, 0.5], [1.1, 0.6], 0.1)
    assert [list(t.ids) for t in history.data if t.meta == {"ask": "step"}] == [["0", "1"]] * 2
    heat = correlation_heatmap(NAMES, _pearson(), joints={"a1": 1, "theta3": 3})
    assert all(t.meta == {"ask": "joint", "rows": {"a1": 1, "θ3": 3}} for t in heat.data)


def test_a_wild_value_is_counted_and_marked_at_the_edge_and_flattens_nothing() -> None:
    values = [0.1, 0.2, 0.15, 0.12, 0.18, 0.11, 0.16, 0.14, 0.13, 14.0]
    ids = [f"p{i}" for i in range(9)] + ["<b>"]
    fig = pose_residuals(ids, ["train"] * 10, values)
    assert fig.layout.yaxis.range[1] < 0.25
    edge = next(t for t in fig.data if t.name == "beyond")
    assert list(edge.ids) == [html.escape("<b>")]
    assert "14 mm" in edge.text[0]
    assert fig.layout.annotations[0].text == "1 beyond, up to 14 mm"
    assert fig.data[0].y[9] == 14.0  # a double-click shows it
    among = residual_against(
        range(10), [-v for v in values], ids, [False] * 10, x_title="x", y_title="y, mm", band=(-1, 1)
    )
    assert among.layout.yaxis.range[0] > -0.25
    assert among.layout.annotations[0].text == "1 beyond, up to −14 mm"


@pytest.mark.parametrize(
    "values",
    [
        [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0],
        [1.0, 50.0],
        [0.1] * 7 + [9.0, 9.1, 9.2],
        [0.0] * 9 + [1.0],
        [np.nan] * 10,
    ],
)
def test_what_is_no_exception_is_shown(values: list[float]) -> None:
    fig = pose_residuals([f"p{i}" for i in range(len(values))], ["train"] * len(values), values)
    assert fig.layout.yaxis.range is None
    assert all(t.name != "beyond" for t in fig.data)
