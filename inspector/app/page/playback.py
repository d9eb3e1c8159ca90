"""Playback of the poses in time order."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from calib.array_types import Array
from inspector.panels.timeline import TimelinePanel, in_time

INTERVAL_S = 0.5


class Playback:
    """Playback that selects poses in time order, without drawing anything itself.

    times: of the dataset's poses, s; None where it has none or none is open. wanted: the index of the pose asked for
    last. select: asks for a pose. drawing: whether the one asked for last is not drawn yet.
    """

    def __init__(
        self,
        panel: TimelinePanel,
        *,
        times: Callable[[], Array | None],
        wanted: Callable[[], int],
        select: Callable[[int], None],
        drawing: Callable[[], bool],
    ) -> None:
        self._panel, self._times, self._wanted = panel, times, wanted
        self._select, self._drawing = select, drawing
        self._stopped = threading.Event()  # of the run that goes on
        self._stopped.set()

    @property
    def running(self) -> bool:
        """Whether playback is running."""
        return not self._stopped.is_set()

    def at_time(self, seconds: float) -> None:
        """Select the pose that was measured nearest to a time."""
        time_s, order = self._times(), in_time(self._times())
        if time_s is not None and len(order):
            self._select(int(order[np.argmin(np.abs(time_s[order] - seconds))]))

    def play(self) -> None:
        """Start playback at the selected pose, or at the first where the last is selected."""
        order = in_time(self._times())
        if self.running or len(order) < 2:
            return
        if self._wanted() == order[-1]:
            self._select(int(order[0]))
        self._stopped = threading.Event()
        self._panel.playing(True)
        threading.Thread(target=self._run, args=(self._stopped,), name="inspector-play", daemon=True).start()

    def stop(self) -> None:
        """Stop playback at once."""
        self._stopped.set()

    def _run(self, stopped: threading.Event) -> None:
        while not stopped.wait(INTERVAL_S) and (self._drawing() or self._forward()):
            pass
        stopped.set()
        self._panel.playing(False)

    def _forward(self) -> bool:
        """Select the next pose; False at the last."""
        order = in_time(self._times()).tolist()
        at = self._wanted()
        after = order[order.index(at) + 1 :] if at in order else order
        if after:
            self._select(after[0])
        return bool(after)
