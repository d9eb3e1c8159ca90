"""The poses in the order of their time, without a browser."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.folder import write_dataset
from inspector.app.app import App
from inspector.panels.timeline import PAUSE, PLAY, clock, in_time
from tests.support.app import idle, plain
from tests.support.hidden_dataset import arm
from tests.support.wire_client import WireClient

TIMES_S = np.random.default_rng(0).permutation(64) * 60.0 + 30.0


def test_the_order_of_times() -> None:
    assert in_time(None).tolist() == []
    assert in_time(np.array([3.0, 1.0, 3.0])).tolist() == [1, 0, 2]


@pytest.mark.parametrize(("seconds", "words"), [(5, "0:05"), (125, "2:05"), (3725, "1:02:05"), (59.7, "1:00")])
def test_a_clock(seconds: float, words: str) -> None:
    assert clock(seconds) == words


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("timeline")
    dataset = arm(3)
    write_dataset(replace(dataset, name="timed", poses=replace(dataset.poses, time_s=TIMES_S)), folder / "a timed")
    write_dataset(replace(dataset, name="plain"), folder / "b plain")
    return folder


def selected(app: App) -> int:
    idle(app)
    return app.state.now.pose


def page_says(app: App) -> str:
    with WireClient(app.server.get_port()) as page:
        return plain(page)


@pytest.mark.slow
def test_a_time_selects_the_nearest_pose_and_a_pose_its_time(app: App) -> None:
    at = int(np.flatnonzero(TIMES_S == 630.0)[0])
    app.at_time(640.0)
    assert selected(app) == at
    timeline = app.panels.review.timeline
    assert timeline.slider.label == "min"
    assert timeline.slider.value == pytest.approx(10.5)
    assert "number 11 by time" in page_says(app)


@pytest.mark.thorough
def test_it_plays_to_the_last_pose_and_stops(app: App) -> None:
    order = in_time(TIMES_S)
    app.select(int(order[-3]))
    assert selected(app) == order[-3]
    timeline = app.panels.review.timeline
    app.play(True)
    assert timeline.play.label == PAUSE
    until = time.monotonic() + 30.0
    while timeline.play.label == PAUSE and time.monotonic() < until:
        time.sleep(0.05)
    assert selected(app) == order[-1]
    assert timeline.play.label == PLAY
    app.play(True)  # again, from the first
    app.play(False)
    assert selected(app) in order[:3]
