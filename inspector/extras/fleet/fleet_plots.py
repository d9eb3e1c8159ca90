"""Figure of the errors of a whole fleet."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go

from calib.html_text import escape
from inspector.figures.style import figure, log_axis
from inspector.markup.parts.palette import MODEL_COLOURS

STAGES = {"as delivered": "nominal", "with calibrated links": "link errors", "with all that was found": "with effects"}


def fleet_errors(
    names: Sequence[str], errors_mm: Sequence[tuple[float | None, float | None, float | None]]
) -> go.Figure:
    """Figure of each dataset's 3D RMSE at the stages of STAGES, in the order given; None leaves a gap."""
    traces = [
        {
            "type": "scatter", "mode": "markers", "name": stage, "x": list(range(1, len(names) + 1)),
            "y": [value[k] if value[k] else None for value in errors_mm],
            "marker": {"color": MODEL_COLOURS[model], "size": 5},
            "customdata": [escape(name) for name in names],
            "hovertemplate": "%{customdata}<br>" + stage + " %{y:.4g} mm<extra></extra>",
        }
        for k, (stage, model) in enumerate(STAGES.items())
    ]  # fmt: skip
    shown = [v for value in errors_mm for v in value if v]
    low, high = (min(shown), max(shown)) if shown else (0.1, 1.0)
    return figure(
        traces,
        xaxis={
            "title": "datasets, by their last error", "zeroline": False, "range": [0.5, len(names) + 0.5],
            "tickvals": list(range(1, len(names) + 1, max(1, len(names) // 8))),
        },
        yaxis={"title": "3D RMSE, mm", **log_axis(low, high)},
        margin=(56, 14, 30, 10),
    )  # fmt: skip
