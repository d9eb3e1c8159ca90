"""Figure of a fleet, as `inspector.figures` offers it."""

from __future__ import annotations

import plotly.graph_objects as go

from calib.extras.fleet.result import Fleet
from inspector.extras.fleet import fleet_plots
from inspector.figures.results.alone import titled


def fleet_errors(fleet: Fleet, *, dark: bool = False) -> go.Figure:
    """Figure of the RMS error of every dataset of a fleet, mm: as delivered, links calibrated, all effects found."""
    rows = sorted((row for row in fleet.rows if row.error_mm is not None), key=lambda row: (row.error_mm, row.path))
    stages = [row.train if row.test.final_mm is None else row.test for row in rows]
    errors = [(stage.nominal_mm, stage.links_mm, stage.final_mm) for stage in stages]
    drawn = fleet_plots.fleet_errors([row.path for row in rows], errors)
    return titled(drawn, f"Errors of {len(rows)} datasets", dark=dark)
