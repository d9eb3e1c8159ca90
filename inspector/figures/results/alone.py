"""Self-contained figures: with a title and a background, and as a static picture where no script runs."""

from __future__ import annotations

from collections.abc import Container
from importlib import import_module

import plotly.graph_objects as go

from calib.errors import CalibError
from calib.html_text import escape
from calib.progress import in_notebook
from inspector.figures.results.still import to_svg
from inspector.figures.style import INK, Part
from inspector.figures.svg.file import DARK_PAPER, LIGHT_PAPER

_TITLE_PX, _ALONE_PX = 34, 420  # what a title takes; the height of a figure that gives none
_SVG = "image/svg+xml"
_INK_ON_DARK, _VEIL_ON_DARK = "#E8EAED", "rgba(21,25,31,0.75)"


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


def titled(fig: go.Figure, title: str, *, dark: bool, height_px: int = 0) -> ResultFigure:
    """Figure with a title and its own background, light or dark; `height_px` without the title, 0 for the default."""
    paper = DARK_PAPER if dark else LIGHT_PAPER
    given = fig.to_dict()
    layout = given["layout"]
    top = layout["margin"]["t"] + _TITLE_PX
    alone = {
        "title": {
            "text": escape(title), "font": {"size": 15}, "x": 0, "xref": "paper", "y": 1, "yref": "container",
            "yanchor": "top", "pad": {"t": 10},
        },
        "paper_bgcolor": paper,
        "plot_bgcolor": paper,
        "font": {**layout["font"], "color": _INK_ON_DARK if dark else INK},
        "annotations": [
            {**note, "bgcolor": _VEIL_ON_DARK} if dark and "bgcolor" in note else note
            for note in layout.get("annotations", ())
        ],
        "margin": {**layout["margin"], "t": top},
        "height": height_px + _TITLE_PX if height_px else _ALONE_PX,
    }  # fmt: skip
    return ResultFigure({"data": given["data"], "layout": {**layout, **alone}}, _validate=False)
