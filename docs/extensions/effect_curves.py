"""An effect over its natural input: alone, and what a fit of the links leaves of it; large, and as a stamp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from effect_drawing import AFTER, BEFORE, PANEL, WIDTH, dots, number, svg, text
from effect_signatures import Signature, Standard

from calib.array_types import Array


@dataclass(frozen=True)
class _Axis:
    low: float
    high: float
    start: float  # px
    end: float

    @classmethod
    def of(cls, values: Array, start: float, end: float) -> _Axis:
        low, high = float(np.min(values)), float(np.max(values))
        room = 0.06 * (high - low) or 1.0
        return cls(low - room, high + room, start, end)

    def px(self, values: Array) -> Array:
        return self.start + (values - self.low) / (self.high - self.low) * (self.end - self.start)

    def ticks(self, most: int) -> list[float]:
        span = self.high - self.low
        power = 10.0 ** np.floor(np.log10(span / most))
        step = next(s * power for s in (1.0, 2.0, 5.0, 10.0) if span / (s * power) <= most)
        first = np.ceil(self.low / step)
        return [float(k * step) + 0.0 for k in np.arange(first, np.floor(self.high / step) + 1.0)]


def curve_picture(signature: Signature, standard: Standard) -> str:
    """What the effect does to one channel over its natural input; beside it what geometry leaves of that."""
    label, u = signature.input.label, signature.input.values
    row = standard.projected.residuals.observed.used_poses[1]
    shown = signature.channel.tells
    u = u[row][shown]
    before, after = (values[shown] for values in _channels(signature, standard))
    y_axis = _Axis.of(np.concatenate([before, after, [0.0]]), 208.0, 26.0)
    out = []
    for k, (values, colour, words) in enumerate(
        ((before, BEFORE, "the effect alone"), (after, AFTER, "what a fit of the links leaves of it"))
    ):
        left = 46.0 + k * (WIDTH - PANEL)
        out.append(_panel(u, values, _Axis.of(u, left, left + PANEL - 56.0), y_axis, colour, words, label))
    what = "the whole of it" if signature.left > 0.995 else f"{100 * signature.left:.0f} % of it"
    words = (
        f"Two plots over {label}. Left: {signature.channel.label}, as {signature.family} of usual size makes it at "
        f"{len(u)} poses. Right: what is left where links and the scanner's place were fitted, {what}."
    )
    out.append(text(signature.channel.label, 4.0, 12.0))
    return svg("".join(out), WIDTH, 250.0, words)


def _channels(signature: Signature, standard: Standard) -> tuple[Array, Array]:
    of = signature.channel.of
    sigma = standard.noise_mm
    return of(signature.before_mm.ravel() / sigma), of(signature.after_mm.ravel() / sigma)


def _panel(u: Array, y: Array, x_axis: _Axis, y_axis: _Axis, colour: str, words: str, label: str) -> str:
    left, right, bottom, top = x_axis.start, x_axis.end, y_axis.start, y_axis.end
    grid, names = [], []
    for tick in y_axis.ticks(5):
        at = float(y_axis.px(np.array(tick)))
        grid.append(f"M{number(left)} {number(at)}H{number(right)}")
        names.append(text(f"{tick:g}", left - 6.0, at + 4.0, anchor="end"))
    for tick in x_axis.ticks(6):
        at = float(x_axis.px(np.array(tick)))
        grid.append(f"M{number(at)} {number(bottom)}v4")
        names.append(text(f"{tick:g}", at, bottom + 17.0, anchor="middle"))
    zero = float(y_axis.px(np.array(0.0)))
    middle = f"M{number(left)} {number(zero)}H{number(right)}"
    points = dots(x_axis.px(u), y_axis.px(y), 2.2)
    return "".join(
        (
            f'<path d="{"".join(grid)}" stroke="currentColor" stroke-opacity=".18" fill="none"/>',
            f'<path d="{middle}" stroke="currentColor" stroke-opacity=".55" fill="none"/>',
            f'<path d="{points}" fill="{colour}" fill-opacity=".85"/>',
            *names,
            text(words, right, top - 8.0, anchor="end", extra=f' fill="{colour}" font-weight="600"'),
            text(label, 0.5 * (left + right), bottom + 35.0, anchor="middle"),
        )
    )


def small_picture(signature: Signature, standard: Standard) -> str:
    """What geometry leaves of the effect over its natural input, as large as a stamp."""
    label, u = signature.input.label, signature.input.values
    shown = signature.channel.tells
    u = u[standard.projected.residuals.observed.used_poses[1]][shown]
    y = _channels(signature, standard)[1][shown]
    words = f"What is left of {signature.family}: {signature.channel.label} over {label}"
    width, height = 200.0, 84.0
    body = f'<path d="M6 {number(height / 2)}H{number(width - 6)}" stroke="currentColor" stroke-opacity=".35"/>'
    if np.any(y):
        x_axis = _Axis.of(u, 6.0, width - 6.0)
        y_axis = _Axis(-float(np.abs(y).max()) * 1.1, float(np.abs(y).max()) * 1.1, height - 4.0, 4.0)
        body += f'<path d="{dots(x_axis.px(u), y_axis.px(y), 1.7)}" fill="{AFTER}"/>'
    else:
        body += text("nothing is left", width / 2, height / 2 - 8.0, anchor="middle")
    return svg(body, width, height, words)
