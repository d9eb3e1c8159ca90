"""Slider and playback over the poses in time order, where poses.csv has times."""

from __future__ import annotations

import math

import numpy as np
import viser

from calib.array_types import Array, IndexArray
from inspector.markup.parts import elements
from inspector.panels.base import SECONDARY, Actions, ChangedValues, by_page
from inspector.panels.input_checks import clamped
from inspector.session.view import View

PLAY, PAUSE = "Play", "Pause"
LONG_S = 600.0  # from this long on the slider is in minutes


class TimelinePanel:
    """Slider over the time of the measurement, and a playback button."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self._gui, self._actions = gui, actions
        self._changed = ChangedValues()
        self._folder = gui.add_folder("Time", expand_by_default=True, visible=False)
        with self._folder:
            self.slider = gui.add_slider("s", min=0.0, max=1.0, step=0.1, initial_value=0.0)
            self.play = gui.add_button(
                PLAY, icon=viser.Icon.PLAYER_PLAY, color=SECONDARY, hint="from pose to pose as they were measured"
            )
            self._said = gui.add_html("")
        self._unit_s = 1.0
        self._of: object = None  # the times that the slider is of
        self.slider.on_update(lambda e: self._dragged(e.target.value) if by_page(e) else None)
        self.play.on_click(lambda _: actions.play(self.play.label == PLAY))

    def _dragged(self, value: float) -> None:
        low, high = float(self.slider.min), float(self.slider.max)
        self._actions.at_time(clamped(value, low, high, low) * self._unit_s)

    def playing(self, running: bool) -> None:
        """Label the button to stop playback while playback runs."""
        self.play.label = PAUSE if running else PLAY
        self.play.icon = viser.Icon.PLAYER_PAUSE if running else viser.Icon.PLAYER_PLAY

    def update(self, view: View) -> None:
        """Show the time of the selected pose."""
        time_s = view.session.dataset.poses.time_s
        order = in_time(time_s)
        self._folder.visible = len(order) > 1
        if time_s is None or len(order) < 2:
            return
        first_s, last_s = float(time_s[order[0]]), float(time_s[order[-1]])
        if self._of is not time_s:
            self._of = time_s
            self._unit_s = 60.0 if last_s - first_s >= LONG_S else 1.0
            self.slider.label = "min" if self._unit_s > 1.0 else "s"
            low, high = (math.floor(10 * first_s / self._unit_s) / 10, math.ceil(10 * last_s / self._unit_s) / 10)
            self.slider.min, self.slider.max = min(low, float(self.slider.min)), high
            self.slider.min = low
        at_s = float(time_s[view.pose])
        self._changed.put(self.slider, round(at_s / self._unit_s, 1))
        place = int(np.flatnonzero(order == view.pose)[0]) + 1
        self._said.content = elements.note(
            f"{clock(at_s - first_s)} after the first of {len(order)} poses, number {place} by time"
        )


def in_time(time_s: Array | None) -> IndexArray:
    """Indices of the poses in time order; none without times."""
    return np.argsort(np.zeros(0) if time_s is None else time_s, kind="stable")


def clock(seconds: float) -> str:
    """Time as text: "1:02:05" in hours, minutes, seconds; "2:05" below an hour."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
