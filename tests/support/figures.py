"""What is asked of every figure of a result."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go


def named(figure: go.Figure, name: str) -> go.Scatter:
    (trace,) = (trace for trace in figure.data if trace.name == name)
    return trace


def stands_alone(figure: go.Figure, *units: str) -> None:
    """Title and axes are there, the units stand in the axes, and plotly takes every value."""
    checked = go.Figure(figure.to_dict())
    layout = checked.layout
    assert layout.title.text
    titles = [axis.title.text or "" for axis in (*checked.select_xaxes(), *checked.select_yaxes())]
    for unit in units:
        assert any(unit in title for title in titles), (unit, titles)
    assert abs(luminance(layout.font.color) - luminance(layout.paper_bgcolor)) > 0.6


def luminance(colour: str) -> float:
    return float(np.mean([int(colour[k : k + 2], 16) for k in (1, 3, 5)])) / 255.0
