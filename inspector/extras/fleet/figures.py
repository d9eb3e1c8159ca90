"""Figure of a fleet, as `inspector.figures` offers it."""

from __future__ import annotations

import plotly.graph_objects as go

from calib.extras.fleet.result import Fleet
from calib.html_text import escape
from inspector.figures.results.alone import titled
from inspector.figures.style import figure, log_axis
from inspector.markup.parts.palette import MODEL_COLOURS

_STAGES = {  # of a row's errors: name and colour
    "nominal_mm": ("as delivered", "nominal"),
    "links_mm": ("with calibrated links", "link errors"),
    "final_mm": ("with all that was found", "with effects"),
}


def fleet_errors(fleet: Fleet) -> go.Figure:
    """Figure of the RMS error of every dataset of a fleet, mm: as delivered, links calibrated, all effects found."""
    rows = sorted((row for row in fleet.rows if row.error_mm is not None), key=lambda row: (row.error_mm, row.path))
    errors = [row.train if row.test.final_mm is None else row.test for row in rows]
    places = list(range(1, len(rows) + 1))
    heights = {stage: [getattr(of_row, stage) or None for of_row in errors] for stage in _STAGES}
    traces = [
        {
            "type": "scatter", "mode": "markers", "name": name, "x": places,
            "y": heights[stage],
            "marker": {"color": MODEL_COLOURS[model], "size": 5},
            "customdata": [escape(row.path) for row in rows],
            "hovertemplate": "%{customdata}<br>" + name + " %{y:.4g} mm<extra></extra>",
        }
        for stage, (name, model) in _STAGES.items()
    ]  # fmt: skip
    shown = [y for of_stage in heights.values() for y in of_stage if y] or [0.1, 1.0]
    drawn = figure(
        traces,
        xaxis={
            "title": "datasets, by their last error", "zeroline": False, "range": [0.5, len(rows) + 0.5],
            "tickvals": places[:: max(1, len(rows) // 8)],
        },
        yaxis={"title": "3D RMSE, mm", **log_axis(min(shown), max(shown))},
        margin=(56, 14, 30, 10),
    )  # fmt: skip
    return titled(drawn, f"Errors of {len(rows)} datasets")
