"""Static SVG of a plotly figure: the same traces, axes, legend and hover texts, without a script.

It takes what the figures of this package use: scatter, bar and heatmap, rectangles, annotations. Text and the grid
have the colours of the page it stands in (`--ink`, `--soft`, `--line`): one picture serves light, dark and paper.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import plotly.graph_objects as go

from inspector.figures.svg.axis import Axis, axis_of
from inspector.figures.svg.marks import DASHES, Panel, Trace, cell_colour, drawn, line_colour, marker_of, symbol
from inspector.figures.svg.text import USUAL_PX, escaped, label, number, plain, width_px

_LEGEND_PX, _TITLE_PX, _GAP_PX = 20.0, 18.0, 6.0
_BAR_PX = 58.0  # what a colour bar takes at the right


def svg_of(figure: go.Figure, width: int, height: int, *, name: str, title: str) -> str:
    """`<svg>` element of a figure in this size; `name` is the prefix of its ids; `title` is for screen readers."""
    given = figure.to_dict()
    traces: list[Trace] = [trace for trace in given["data"] if trace.get("visible") is not False]
    layout: Mapping[str, Any] = given["layout"]
    entries = _legend_rows(traces, width)
    panels = _panels(traces, layout, width, height, len(entries))
    out = [_clips(panels, name)]
    for k, (key, panel) in enumerate(panels.items()):
        inside = f'clip-path="url(#{name}-{k})"'
        own = [trace for trace in traces if _axes_of(trace) == key]
        below = _images(layout, key, panel) + _rectangles(layout, key, panel)
        out.append(f"<g {inside}>{below}</g>{_grid(panel, heat=_is_heat(own))}")
        for i, trace in enumerate(own):
            free = trace.get("cliponaxis") is False or trace.get("type") == "heatmap"
            out.append(f"<g{'' if free else ' ' + inside}>{drawn(trace, own[i - 1] if i else None, panel)}</g>")
        out += [_colour_bar(trace, panel) for trace in own if "colorbar" in trace]
    out.append(_annotations(layout, panels))
    out += [_legend(row, _LEGEND_PX * (k + 0.5)) for k, row in enumerate(entries)]
    return (
        f'<svg class="plot" viewBox="0 0 {width} {height}" role="img" aria-label="{escaped(title)}" '
        f'style="max-width:{width}px">{"".join(out)}</svg>'
    )


def _axes_of(trace: Trace) -> tuple[str, str]:
    return str(trace.get("xaxis") or "x"), str(trace.get("yaxis") or "y")


def _is_heat(traces: Sequence[Trace]) -> bool:
    return any(trace.get("type") == "heatmap" for trace in traces)


def _panels(
    traces: Sequence[Trace], layout: Mapping[str, Any], width: int, height: int, legend_rows: int
) -> dict[tuple[str, str], Panel]:
    """Panels with their places: margins as the longest labels need them, the rest shared by the axes."""
    keys = list(dict.fromkeys(map(_axes_of, traces))) or [("x", "y")]
    axes = {key: _axes(traces, layout, key, width, height) for key in keys}
    left = max(max(_room(y), _room_of_first(x)) for x, y in axes.values())
    bottom = max(_room_below(x) for x, _ in axes.values())
    right = _BAR_PX if any("colorbar" in trace for trace in traces) else 14.0
    many = len(keys) > 1  # their titles stand above the panels
    top = max(_LEGEND_PX * legend_rows, 4.0) + (24.0 if many else 8.0)
    inner_w, inner_h = width - left - right, height - top - bottom
    if _is_heat(traces):
        inner_w = inner_h = min(inner_w, inner_h)
    placed = {
        key: Panel(
            x, y, left + inner_w * x.domain[0], top + inner_h * (1.0 - y.domain[1]),
            inner_w * (x.domain[1] - x.domain[0]), inner_h * (y.domain[1] - y.domain[0]),
        )
        for key, (x, y) in axes.items()
    }  # fmt: skip
    return {
        key: _to_scale(panel) if (layout.get(f"yaxis{key[1][1:]}") or {}).get("constrain") == "domain" else panel
        for key, panel in placed.items()
    }


def _to_scale(panel: Panel) -> Panel:
    """Panel with as many units a pixel across as up: its ranges as they are, and less width or height."""
    across, up = abs(panel.x.high - panel.x.low), abs(panel.y.high - panel.y.low)
    scale = max(across / panel.width, up / panel.height)
    return replace(panel, width=across / scale, height=up / scale)


def _axes(
    traces: Sequence[Trace], layout: Mapping[str, Any], key: tuple[str, str], width: int, height: int
) -> tuple[Axis, Axis]:
    def axis(letter: str, length_px: int) -> Axis:
        place = 0 if letter == "x" else 1
        own = [trace for trace in traces if _axes_of(trace)[place] == key[place]]
        values = [value for trace in own for value in trace[letter] if value is not None]
        given = layout.get(f"{letter}axis{key[place][1:]}") or {}
        domain = given.get("domain") or (0.0, 1.0)
        marks = letter == "y" or any("markers" in str(trace.get("mode", "")) for trace in own)
        return axis_of(given, values, 0.85 * length_px * (domain[1] - domain[0]), marks=marks)

    return axis("x", width), axis("y", height)


def _room(y: Axis) -> float:
    """Width of title and numbers to the left of an axis, px."""
    return _TITLE_PX + _GAP_PX + max((width_px(text) for _, text in y.ticks), default=0.0) + 4.0


def _room_of_first(x: Axis) -> float:
    """Width, px, by which a slanted label under the left end of an axis extends to the left of the axis."""
    if not x.ticks or not 1.0 < abs(x.tick_angle_deg) < 80.0:
        return 0.0
    return math.cos(math.radians(x.tick_angle_deg)) * width_px(x.ticks[0][1])


def _room_below(x: Axis) -> float:
    """Height of title and numbers below an axis, px."""
    longest = max((width_px(text) for _, text in x.ticks), default=0.0)
    angle = abs(x.tick_angle_deg)
    slanted = math.sin(math.radians(angle)) * longest + (8.0 if angle < 80.0 else 4.0)
    return _TITLE_PX + _GAP_PX + (slanted if angle > 1.0 else 14.0)


def _clips(panels: Mapping[tuple[str, str], Panel], name: str) -> str:
    clips = "".join(
        f'<clipPath id="{name}-{k}"><rect x="{number(p.left)}" y="{number(p.top)}" width="{number(p.width)}" '
        f'height="{number(p.height)}"/></clipPath>'
        for k, p in enumerate(panels.values())
    )
    return f"<defs>{clips}</defs>"


def _grid(panel: Panel, *, heat: bool) -> str:
    """SVG of grid lines, zero line, numbers and titles."""
    x, y = panel.x, panel.y
    right, below = panel.left + panel.width, panel.top + panel.height
    out = []
    for at, text in x.ticks:
        px = panel.left + panel.width * x.share_of_scaled(at)
        if not heat and x.kind != "category":
            out.append(f'<path class="grid" d="M{number(px)} {number(panel.top)}V{number(below)}"/>')
        slanted = abs(x.tick_angle_deg) > 1.0
        anchor = "end" if slanted else "middle"
        out.append(
            label(text, px, below + (8.0 if slanted else 11.0), anchor=anchor, turn_deg=x.tick_angle_deg, css="faint")
        )
    for at, text in y.ticks:
        py = panel.top + panel.height * (1.0 - y.share_of_scaled(at))
        if not heat:
            out.append(f'<path class="grid" d="M{number(panel.left)} {number(py)}H{number(right)}"/>')
        out.append(label(text, panel.left - _GAP_PX, py, anchor="end", css="faint"))
    if y.shows_zero:
        zero = panel.top + panel.height * (1.0 - y.share(0.0))
        out.append(f'<path class="zero" d="M{number(panel.left)} {number(zero)}H{number(right)}"/>')
    middle = panel.top + 0.5 * panel.height
    out.append(label(y.title, panel.left - _room(y) + 0.5 * _TITLE_PX, middle, size_px=USUAL_PX, turn_deg=-90.0))
    out.append(
        label(x.title, panel.left + 0.5 * panel.width, below + _room_below(x) - 0.5 * _TITLE_PX, size_px=USUAL_PX)
    )
    return "".join(out)


def _images(layout: Mapping[str, Any], key: tuple[str, str], panel: Panel) -> str:
    """SVG of a layout's pictures that lie in a panel, by their upper left corner."""
    out = []
    for image in layout.get("images") or ():
        if (image["xref"], image["yref"]) == key:
            left, top = panel.at(image["x"], image["y"])
            right, bottom = panel.at(image["x"] + image["sizex"], image["y"] + image["sizey"])
            out.append(
                f'<image x="{number(left)}" y="{number(top)}" width="{number(right - left)}" '
                f'height="{number(bottom - top)}" preserveAspectRatio="none" opacity="{image["opacity"]:g}" '
                f'href="{escaped(image["source"])}"/>'
            )
    return "".join(out)


def _rectangles(layout: Mapping[str, Any], key: tuple[str, str], panel: Panel) -> str:
    """SVG of a layout's rectangles that lie in a panel."""
    out = []
    for shape in layout.get("shapes") or ():
        if shape.get("xref", "x") not in ("paper", key[0]) or shape.get("yref", "y").partition(" ")[0] != key[1]:
            continue
        whole_width, whole_height = shape.get("xref") == "paper", "domain" in shape.get("yref", "")
        x0, y0 = panel.at(shape["x0"], shape["y0"])
        x1, y1 = panel.at(shape["x1"], shape["y1"])
        if whole_width:
            x0, x1 = panel.left, panel.left + panel.width
        if whole_height:
            y0, y1 = panel.top, panel.top + panel.height
        out.append(
            f'<rect x="{number(min(x0, x1))}" y="{number(min(y0, y1))}" width="{number(abs(x1 - x0))}" '
            f'height="{number(abs(y1 - y0))}" fill="{shape["fillcolor"]}"/>'
        )
    return "".join(out)


def _annotations(layout: Mapping[str, Any], panels: Mapping[tuple[str, str], Panel]) -> str:
    """SVG of annotations in or above a panel: titles of panels, counts of points beyond an axis."""
    out = []
    for note in layout.get("annotations") or ():
        of_x, of_y = (str(note[ref]).partition(" ")[0] for ref in ("xref", "yref"))
        panel = next((p for (x, y), p in panels.items() if of_x in (x, "paper") and of_y in (y, "paper")), None)
        if panel is None:
            continue
        x = panel.left + panel.width * float(note["x"])
        y = panel.top + panel.height * (1.0 - float(note["y"])) - float(note.get("yshift") or 0.0)
        y += {"bottom": -8.0, "top": 8.0}.get(str(note.get("yanchor")), 0.0)
        anchor = {"left": "start", "right": "end"}.get(str(note.get("xanchor")), "middle")
        css = "bold" if str(note["text"]).startswith("<b>") else ""
        out.append(label(plain(note["text"]), x, y, size_px=USUAL_PX, anchor=anchor, css=css))
    return "".join(out)


def _colour_bar(trace: Trace, panel: Panel) -> str:
    bar = trace["colorbar"]
    left, high = panel.left + panel.width + 14.0, 0.75 * panel.height
    top, parts = panel.top + 0.5 * (panel.height - high), 48
    low_z, high_z = float(trace["zmin"]), float(trace["zmax"])
    out = [
        f'<rect x="{number(left)}" y="{number(top + high * k / parts)}" width="9" height="{high / parts + 0.6:.1f}" '
        f'fill="{cell_colour(trace, high_z - (high_z - low_z) * (k + 0.5) / parts)}"/>'
        for k in range(parts)
    ]
    for value in bar["tickvals"]:
        y = top + high * (high_z - value) / (high_z - low_z)
        out.append(label(f"{value:g}", left + 13.0, y, anchor="start", css="faint"))
    out.append(label(plain(bar["title"]["text"]), left + 4.0, top - 12.0, size_px=USUAL_PX))
    return "".join(out)


def _legend_rows(traces: Sequence[Trace], width: int) -> list[list[Trace]]:
    """Named traces of the legend, in rows that fit the width."""
    named = {
        plain(trace["name"]): trace
        for trace in reversed(traces)
        if trace.get("name") and trace.get("showlegend") is not False and trace.get("type") != "heatmap"
    }
    rows: list[list[Trace]] = []
    room = 0.0
    for name, trace in reversed(named.items()):
        needed = 34.0 + width_px(name, USUAL_PX)
        if not rows or needed > room:
            rows.append([])
            room = float(width)
        rows[-1].append(trace)
        room -= needed
    return rows


def _legend(row: Sequence[Trace], y: float) -> str:
    out, x = [], 8.0
    for trace in row:
        kind, colour = marker_of(trace)
        middle = x + 9.0
        if trace.get("fill"):
            out.append(symbol("square", middle, y, 11.0, str(trace["fillcolor"])))
        else:
            mode = str(trace.get("mode", ""))
            if "lines" in mode:
                line = trace.get("line") or {}
                dash = DASHES.get(str(line.get("dash", "")), "")
                out.append(
                    f'<path d="M{number(x)} {number(y)}h18" stroke="{line_colour(trace)}" '
                    f'stroke-width="{line.get("width", 2):g}"{dash}/>'
                )
            if "markers" in mode and isinstance(kind, str) and kind != "line-ew":
                out.append(symbol(kind, middle, y, 9.0, colour))
            elif trace.get("type") == "bar":
                out.append(symbol("square", middle, y, 10.0, colour))
        words = plain(trace["name"])
        out.append(label(words, x + 23.0, y, size_px=USUAL_PX, anchor="start"))
        x += 34.0 + width_px(words, USUAL_PX)
    return "".join(out)
