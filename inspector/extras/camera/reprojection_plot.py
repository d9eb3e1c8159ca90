"""Figure of one image of a board: the photograph, its corners, and arrows of the reprojection error."""

from __future__ import annotations

import base64
import io
from functools import lru_cache
from pathlib import Path

import numpy as np
import plotly.graph_objects as go

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.extras.camera.observed import camera_of, image_path
from calib.extras.camera.view import View
from calib.served_process import within_limits
from inspector.figures.style import figure

_LONGEST_SHARE = 0.06  # of the image's width, of the longest arrow
_ARROW, _CORNER = "#C0392B", "#1F77B4"
_WIDEST_PX = 1000  # of the photograph behind the corners
_JPEG_QUALITY = 75
_PALE = 0.55  # share of the photograph that shows through, so that corners and arrows stand out


def reprojected_corners(dataset: Dataset, view: View, predicted: Array | None = None) -> go.Figure:
    """Corners as seen, with arrows from where a fit puts them, enlarged by a round factor.

    The factor stands in the title of x, and the photograph behind the corners.

    predicted  # (N, 2) pixels, where the fit puts the corners; None where no fit tells
    """
    camera = camera_of(dataset)
    assert camera is not None
    size_px = camera.lens.size_px
    image = image_path(dataset, dataset.poses.index(view.pose))
    seen = view.pixels
    words = [f"corner {k}" for k in view.corner.tolist()]
    traces, told = [], ""
    if predicted is not None:
        off = seen - predicted
        length = np.linalg.norm(off, axis=1)
        longest = max(float(length.max()), 1e-9)
        factor = float(10.0 ** np.floor(np.log10(max(_LONGEST_SHARE * size_px[0] / longest, 1.0))))
        ends = np.stack([seen - factor * off, seen, np.full_like(seen, np.nan)], axis=1).reshape(-1, 2)
        lines_x, lines_y = ends.T.tolist()
        told = f"; arrows × {factor:g}"
        name, colour = f"error × {factor:g}", {"width": 2, "color": _ARROW}
        traces.append({"type": "scatter", "mode": "lines", "x": lines_x, "y": lines_y, "line": colour, "name": name})
    traces.append(
        {"type": "scatter", "mode": "markers", "x": seen[:, 0].tolist(), "y": seen[:, 1].tolist(),
         "marker": {"size": 5, "color": _CORNER}, "name": "corner", "text": words,
         "hovertemplate": "%{text}<extra></extra>"}
    )  # fmt: skip
    photo = None if image is None else photograph(image)
    behind = {
        "source": photo, "xref": "x", "yref": "y", "x": -0.5, "y": -0.5, "sizex": size_px[0], "sizey": size_px[1],
        "xanchor": "left", "yanchor": "top", "sizing": "stretch", "layer": "below", "opacity": _PALE,
    }  # fmt: skip
    return figure(
        traces,
        xaxis={"title": f"u, pixels{told}", "range": [-0.5, size_px[0] - 0.5], "showgrid": photo is None},
        yaxis={"title": "v, pixels", "range": [size_px[1] - 0.5, -0.5], "scaleanchor": "x", "constrain": "domain",
               "showgrid": photo is None},
        margin=(56, 16, 28, 44),
        layout=None if photo is None else {"images": [behind]},
    )  # fmt: skip


@lru_cache(maxsize=8)
def photograph(path: Path) -> str | None:
    """Image file as the data URI of a small grey JPEG; None where it cannot be read or Pillow is not installed."""
    try:
        content = within_limits(path.name, _small_jpeg, path)
    except Exception:  # whatever stands in the file: the corners are shown without it
        return None
    return f"data:image/jpeg;base64,{base64.b64encode(content).decode('ascii')}"


def _small_jpeg(path: Path) -> bytes:
    from PIL import Image

    with Image.open(path) as opened:
        picture = opened.convert("L")
    picture.thumbnail((_WIDEST_PX, _WIDEST_PX))
    content = io.BytesIO()
    picture.save(content, "JPEG", quality=_JPEG_QUALITY)
    return content.getvalue()
