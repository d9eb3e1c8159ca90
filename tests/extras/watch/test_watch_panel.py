"""Later measurements against the calibration on show, without a browser."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.dataset import About
from calib.dataset.files.folder import write_dataset
from inspector.app.app import App
from inspector.extras.watch.watch_panel import ALL, NONE
from tests.support.app import IDLE_S, plain
from tests.support.checked_cell import Cell
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("watch")
    rng = np.random.default_rng(7)
    cell = Cell.drawn(rng)
    march = cell.measured(rng, 64, "1 march")
    q = np.repeat(march.poses.q[:5], 2, axis=0)
    slipped = cell.with_changes({"theta3": np.radians(0.05)})
    measured = (march, cell.measured(rng, name="2 june", q=q), slipped.measured(rng, name="3 october", q=q))
    for dataset, date in zip(measured, ("2026-03-02", "2026-06-01", "2026-10-01"), strict=True):
        write_dataset(replace(dataset, about=About(date=date)), folder / dataset.name)
    write_dataset(Cell.drawn(rng, "panda").measured(rng, name="4 other arm"), folder / "4 other arm")
    return folder


def watched(app: App, choice: str) -> str:
    """What the page says once this is chosen."""
    app.panels.contributed["Watch"].later.value = choice
    app.contributed["Watch"].ask()
    assert app.worker.wait_idle(IDLE_S)
    with WireClient(app.server.get_port()) as page:
        return plain(page)


def test_what_changed_since_the_calibration_on_show(app: App) -> None:
    assert app.state.name == "1 march"
    assert "measured later" in watched(app, NONE)
    assert "2 june: unchanged." in watched(app, "2 june")
    panel = app.panels.contributed["Watch"]
    said = watched(app, "3 october")
    assert "joint 3 (theta3) changed by 0.0" in said
    assert "could not see" in said
    limit, changed = panel._plot.figure.data
    assert changed.name == "changed"
    assert changed.y[0] > limit.y[0]
    app.open("2 june")  # each dataset on show has its own choice
    assert app.worker.wait_idle(IDLE_S)
    assert panel.later.value == NONE
    app.open("1 march")
    assert app.worker.wait_idle(IDLE_S)


def test_another_arm_is_refused(app: App) -> None:
    assert "other joints" in watched(app, ALL)
    assert not app.panels.contributed["Watch"]._plot.visible
