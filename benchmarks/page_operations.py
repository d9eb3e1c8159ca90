"""Operations that a user repeats on the page, by the app's own requests, for the benchmark of its memory."""

from __future__ import annotations

import gc
from collections.abc import Callable
from pathlib import Path

from inspector.app.app import App
from inspector.session.view import VIEWS

ROUND = 20  # operations of one round; each leaves model, version and selection as it found them
IDLE_S = 120.0


def operate(app: App, count: int) -> None:
    """So many operations, in rounds: poses, views, joints, versions, steps; an effect added, undone, redone, removed.

    Each is done before the next is asked for.
    """
    best = str(app.panels.missing_effects.chosen)
    acts: list[Callable[[], None]] = [
        *[lambda: app.step(1)] * 4,
        lambda: app.show_view(VIEWS[-1]),
        lambda: app.select_joint(2),
        lambda: app.add_effect(best),
        lambda: app.show_step(0),
        lambda: app.show_step(1),
        *[lambda: app.step(-1)] * 4,
        lambda: app.show_view("All corners"),
        lambda: app.move(-1),
        lambda: app.select_joint(None),
        lambda: app.move(1),
        lambda: app.version("with effects"),
        lambda: app.remove_effect(best),
        lambda: app.arrows(30.0),
    ]
    assert len(acts) == ROUND
    for number in range(count):
        acts[number % ROUND]()
        assert app.worker.wait_idle(IDLE_S)
    gc.collect()


def rss_mb() -> float:
    """Resident memory of this process."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1024
