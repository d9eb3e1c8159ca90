"""Equal scales for panels: the same millimetres per pixel horizontally and vertically in each panel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from inspector.figures.svg.axis import Axis, axis_of
from inspector.figures.svg.marks import Panel

Key = tuple[str, str]  # the names of a panel's axes


def to_one_scale(panels: Mapping[Key, Panel], layout: Mapping[str, Any]) -> dict[Key, Panel]:
    """Panels with ranges widened to equal scales where the layout requires that; else unchanged.

    Of panels above each other the lowest alone has numbers and a title below. A single panel whose ranges stay is drawn
    smaller instead.
    """
    if not all("scaleanchor" in (layout.get(f"yaxis{y[1:]}") or {}) for _, y in panels):
        return dict(panels)
    if len(panels) < 2:
        keeps_range = (layout.get("yaxis") or {}).get("constrain") == "domain"
        return {key: _shrunk(panel) if keeps_range else panel for key, panel in panels.items()}
    scale = max(max((p.x.high - p.x.low) / p.width, (p.y.high - p.y.low) / p.height) for p in panels.values())
    lowest = max(panel.top for panel in panels.values())
    width = max((p.x.high - p.x.low) / scale for p in panels.values())
    return {
        key: replace(
            panel,
            x=_widened(panel.x, scale * width, width, told=panel.top == lowest),
            y=_widened(panel.y, scale * panel.height, panel.height),
            width=width,
        )
        for key, panel in panels.items()
    }


def _shrunk(panel: Panel) -> Panel:
    """Panel with its ranges as they are, and less width or height."""
    across, up = abs(panel.x.high - panel.x.low), abs(panel.y.high - panel.y.low)
    scale = max(across / panel.width, up / panel.height)
    return replace(panel, width=across / scale, height=up / scale)


def _widened(axis: Axis, length: float, pixels: float, *, told: bool = True) -> Axis:
    """Axis widened around its middle to a length; without tick labels where they are hidden."""
    middle = 0.5 * (axis.low + axis.high)
    ends = [middle - 0.5 * length, middle + 0.5 * length]
    given = {"title": {"text": axis.title if told else ""}, "range": ends, "domain": axis.domain}
    wider = axis_of(given, [], 0.85 * pixels, marks=True)
    return wider if told else replace(wider, ticks=tuple((at, "") for at, _ in wider.ticks))
