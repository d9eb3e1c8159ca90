"""The traces of a figure as SVG: lines, points, bands, bars, cells."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from inspector.figures.svg.axis import Axis
from inspector.figures.svg.text import hover, number

Trace = Mapping[str, Any]
_CORNERS = {  # of markers, over half their size: to the right and down
    "square": ((-1, -1), (1, -1), (1, 1), (-1, 1)),
    "diamond": ((0, -1.25), (1.25, 0), (0, 1.25), (-1.25, 0)),
    "triangle-up": ((0, -1), (1, 1), (-1, 1)),
    "triangle-down": ((0, 1), (1, -1), (-1, -1)),
    "line-ns": ((0, -1), (0, 1)),
    "line-ew": ((-1, 0), (1, 0)),
}
_LINE_PX = {"line-ns": 1, "line-ew": 3}
DASHES = {"dash": ' stroke-dasharray="7 5"', "dot": ' stroke-dasharray="2 4"'}


@dataclass(frozen=True)
class Panel:
    """A pair of axes and their rectangle on the picture, px."""

    x: Axis
    y: Axis
    left: float
    top: float
    width: float
    height: float

    def at(self, x: object, y: object) -> tuple[float, float]:
        """Position of a pair of values, px; NaN where one value has none."""
        return self.left + self.width * self.x.share(x), self.top + self.height * (1.0 - self.y.share(y))


def drawn(trace: Trace, before: Trace | None, panel: Panel) -> str:
    """SVG of a trace; `before` is the preceding trace, up to which a band is filled."""
    kinds: dict[str, Callable[[], str]] = {
        "bar": lambda: _bars(trace, panel),
        "heatmap": lambda: _cells(trace, panel),
        "scatter": lambda: (
            _band(trace, before, panel) + _line(trace, panel) + _spread(trace, panel) + _points(trace, panel)
        ),
    }
    return kinds[str(trace.get("type", "scatter"))]()


def symbol(kind: str, x: float, y: float, size: float, colour: str, *, title: str = "") -> str:
    """SVG of a plotly marker: a circle, a diamond, a square, or a dash ("line-ns", "line-ew")."""
    if kind == "circle":
        shape = f'<circle cx="{number(x)}" cy="{number(y)}" r="{number(0.5 * size)}" fill="{colour}"'
    else:
        corners = _CORNERS.get(kind, _CORNERS["diamond"])
        places = " ".join(f"{number(x + 0.5 * size * u)},{number(y + 0.5 * size * v)}" for u, v in corners)
        width = f' stroke="{colour}" stroke-width="{_LINE_PX[kind]}"' if kind in _LINE_PX else ""
        shape = f'<polygon points="{places}" fill="{colour}"{width}'
    return f"{shape}>{title}</{shape[1:].split(' ')[0]}>" if title else f"{shape}/>"


def line_colour(trace: Trace) -> str:
    """Colour of a trace's line."""
    return str((trace.get("line") or {}).get("color", "var(--ink)"))


def marker_of(trace: Trace) -> tuple[str | Sequence[str], str]:
    """Symbol (one, or one per point) and colour of a trace's points."""
    marker = trace.get("marker") or {}
    colour = marker.get("color") or (marker.get("line") or {}).get("color") or line_colour(trace)
    return marker.get("symbol", "circle"), str(colour)


def _places(trace: Trace, panel: Panel) -> list[tuple[float, float]]:
    return [panel.at(x, y) for x, y in zip(trace["x"], trace["y"], strict=True)]


def _path(places: Sequence[tuple[float, float]]) -> str:
    """SVG path through positions, interrupted where one is NaN."""
    out, pen = [], False
    for x, y in places:
        if math.isnan(x) or math.isnan(y):
            pen = False
            continue
        out.append(f"{'L' if pen else 'M'}{number(x)} {number(y)}")
        pen = True
    return "".join(out)


def _line(trace: Trace, panel: Panel) -> str:
    line = trace.get("line") or {}
    if "lines" not in str(trace.get("mode", "")) or not line.get("width", 2):
        return ""
    return (
        f'<path d="{_path(_places(trace, panel))}" fill="none" stroke="{line_colour(trace)}" '
        f'stroke-width="{line.get("width", 2):g}" stroke-linejoin="round"{DASHES.get(str(line.get("dash", "")), "")}/>'
    )


def _band(trace: Trace, before: Trace | None, panel: Panel) -> str:
    if trace.get("fill") != "tonexty" or before is None:
        return ""
    edge = _path([*_places(trace, panel), *reversed(_places(before, panel))])
    return f'<path d="{edge}z" fill="{trace["fillcolor"]}" stroke="none"/>'


def _spread(trace: Trace, panel: Panel) -> str:
    """SVG of the error bar of each point, with the length from `error_y`."""
    lengths = (trace.get("error_y") or {}).get("array")
    if lengths is None:
        return ""
    out = []
    for x, y, half in zip(trace["x"], trace["y"], lengths, strict=True):
        (px, low), (_, high) = panel.at(x, y - half), panel.at(x, y + half)
        if not math.isnan(low + high):
            out.append(f"M{number(px)} {number(low)}V{number(high)}")
    return f'<path d="{"".join(out)}" stroke="{line_colour(trace)}" stroke-width="1.2" fill="none"/>'


def _points(trace: Trace, panel: Panel) -> str:
    if "markers" not in str(trace.get("mode", "")):
        return ""
    kind, colour = marker_of(trace)
    marker = trace.get("marker") or {}
    sizes = np.broadcast_to(np.asarray(marker.get("size", 6), dtype=float), len(trace["x"]))
    kinds = [kind] * len(trace["x"]) if isinstance(kind, str) else kind
    told, texts = ([*(trace.get(key) or [""] * len(trace["x"]))] for key in ("customdata", "text"))
    out = []
    for k, (x, y) in enumerate(_places(trace, panel)):
        if math.isnan(x) or math.isnan(y) or sizes[k] <= 0.0:
            continue
        values = {"x": trace["x"][k], "y": trace["y"][k], "customdata": told[k], "text": texts[k]}
        title = hover(trace.get("hovertemplate"), values)
        out.append(symbol(kinds[k], x, y, float(sizes[k]), colour, title=title))
    return "".join(out)


def _bars(trace: Trace, panel: Panel) -> str:
    colour = marker_of(trace)[1]
    wide = 0.85 * panel.width / max(len(panel.x.categories), 1)
    out = []
    for name, value in zip(trace["x"], trace["y"], strict=True):
        x, y = panel.at(name, value)
        if math.isnan(x) or math.isnan(y):
            continue
        zero = panel.at(name, 0.0)[1]
        out.append(
            f'<rect x="{number(x - 0.5 * wide)}" y="{number(min(y, zero))}" width="{wide:.2f}" '
            f'height="{number(abs(zero - y))}" fill="{colour}">'
            f"{hover(trace.get('hovertemplate'), {'x': name, 'y': value})}</rect>"
        )
    return "".join(out)


def _cells(trace: Trace, panel: Panel) -> str:
    """SVG of a matrix, each cell in its colour; cells without a value are left open."""
    rows, columns = len(trace["y"]), len(trace["x"])
    wide, high = panel.width / columns, panel.height / rows
    out = []
    for i, row in enumerate(trace["z"]):
        for j, value in enumerate(row):
            if value is None or math.isnan(value):
                continue
            x, y = panel.at(trace["x"][j], trace["y"][i])
            values = {"x": trace["x"][j], "y": trace["y"][i], "z": value}
            out.append(
                f'<rect x="{number(x - 0.5 * wide)}" y="{number(y - 0.5 * high)}" width="{wide - 1:.1f}" '
                f'height="{high - 1:.1f}" fill="{cell_colour(trace, value)}">'
                f"{hover(trace.get('hovertemplate'), values)}</rect>"
            )
    return "".join(out)


def cell_colour(trace: Trace, value: float) -> str:
    """Colour of a value on a trace's scale, as #rrggbb."""
    at = (value - trace["zmin"]) / (trace["zmax"] - trace["zmin"])
    stops = [float(stop[0]) for stop in trace["colorscale"]]
    colours = np.array([[int(stop[1][k : k + 2], 16) for k in (1, 3, 5)] for stop in trace["colorscale"]], dtype=float)
    mixed = [round(float(np.interp(at, stops, colours[:, k]))) for k in range(3)]
    return "#" + "".join(f"{part:02x}" for part in mixed)
