"""Self-contained figures: with a title and a background, and as a static picture where no script runs."""

from __future__ import annotations

from collections.abc import Container
from importlib import import_module

import plotly.graph_objects as go

from calib.errors import CalibError
from calib.html_text import escape
from calib.progress import in_notebook
from inspector.figures.results.still import to_svg
from inspector.figures.style import Part
from inspector.figures.svg.file import PAPER

_TITLE_PX, _ALONE_PX = 34, 420  # what a title takes; the height of a figure that gives none
_SVG = "image/svg+xml"


class ResultFigure(go.Figure):  # type: ignore[misc]
    """A plotly figure that a notebook can show without a script.

    Beside what plotly's renderer makes of it a cell gets the still picture: an export to HTML or PDF, a code host or an
    untrusted notebook shows that. Nothing is asked of the network.
    """

    def _repr_mimebundle_(self, include: Container[str] | None = None, exclude: Container[str] | None = None) -> Part:
        bundle: Part = super()._repr_mimebundle_(include, exclude)
        try:
            return {**bundle, _SVG: to_svg(self)}
        except CalibError:  # plotly alone draws it
            return bundle

    def _ipython_display_(self) -> None:
        if in_notebook():
            import_module("IPython.display").display(self._repr_mimebundle_(), raw=True)
        else:
            super()._ipython_display_()

    def _repr_html_(self) -> str:
        try:
            return to_svg(self)
        except CalibError:
            return str(self.to_html(full_html=False, include_plotlyjs=True))


def titled(fig: go.Figure, title: str, *, height_px: int = 0) -> ResultFigure:
    """Figure with a title and its own background; `height_px` without the title, 0 for the default."""
    given = fig.to_dict()
    layout = given["layout"]
    alone = {
        "title": {
            "text": escape(title), "font": {"size": 15}, "x": 0, "xref": "paper", "y": 1, "yref": "container",
            "yanchor": "top", "pad": {"t": 10},
        },
        "paper_bgcolor": PAPER,
        "plot_bgcolor": PAPER,
        "margin": {**layout["margin"], "t": layout["margin"]["t"] + _TITLE_PX},
        "height": height_px + _TITLE_PX if height_px else _ALONE_PX,
    }  # fmt: skip
    return ResultFigure({"data": given["data"], "layout": {**layout, **alone}}, _validate=False)
