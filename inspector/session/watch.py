"""Watching of files that a user changes while the page is open."""

from __future__ import annotations

import threading
from collections.abc import Callable

POLL_S = 0.5


class Watch:
    """Thread that calls `on_change` after what `version` tells has changed, until stopped."""

    def __init__(self, version: Callable[[], object], on_change: Callable[[], None]) -> None:
        self._version, self._on_change = version, on_change
        self._stop = threading.Event()
        self._seen = version()
        threading.Thread(target=self._run, name="inspector-watch", daemon=True).start()

    def stop(self) -> None:
        """End the thread; a call that has begun is finished."""
        self._stop.set()

    def _run(self) -> None:
        while not self._stop.wait(POLL_S):
            version = self._version()
            if version != self._seen:
                self._seen = version
                self._on_change()
