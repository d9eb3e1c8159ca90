"""Figure of a fit: an image of a board, with arrows from where the fit puts the corners."""

from __future__ import annotations

import plotly.graph_objects as go

from calib.calibration.result import Calibration
from calib.errors import CalibError
from calib.extras.camera.reprojection import reprojected_views
from inspector.extras.camera.reprojection_plot import reprojected_corners
from inspector.figures.results.alone import titled

_TALL_PX = 620


def reprojection(calibration: Calibration, pose: str | None = None) -> go.Figure:
    """Figure of the corners in one image of a board, with arrows from where the fit puts them.

    Args:
        calibration: a fit of full poses of a dataset of images.
        pose: whose image; None for the one that the fit meets worst.

    Raises CalibError where there is no such image.
    """
    views = reprojected_views(calibration)
    chosen = [one for one in views if pose is None or one.view.pose == pose]
    if not chosen:
        raise CalibError(
            f"no image of a board {'is fitted' if pose is None else f'at pose {pose!r}'}; see residual pose"
        )
    one = max(chosen, key=lambda view: view.rms_px)
    drawn = reprojected_corners(calibration.dataset, one.view, one.predicted)
    return titled(drawn, f"Reprojection at {one.view.pose}: {calibration.dataset.name}", height_px=_TALL_PX)
