"""A pose left out on the page, without a browser: lists, colours, plots, history, undo by its key, the session file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from inspector.app.app import App
from inspector.markup.parts.palette import LEFT_OUT, rgb
from inspector.panels.learn.missing_effects import REDO_MODEL, UNDO_MODEL
from inspector.panels.review import LEAVE_OUT, TAKE_IN
from inspector.scene.scene_view import ROOT
from inspector.session.reopening import opening
from inspector.session.session import Session
from inspector.session.session_file import load_session
from tests.support.app import ADD, IDLE_S, idle_app, plain, shows
from tests.support.hidden_dataset import HIDDEN
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running

POSE = "p05"


def session(app: App) -> Session:
    return app.state.now.session


def grey_points(page: WireClient) -> int:
    colours = page.scene[f"{ROOT}/corners/points"]["props"]["colors"]
    return int(np.all(np.asarray(colours).reshape(-1, 3) == rgb(LEFT_OUT), axis=1).sum())


def in_plots(page: WireClient, pose: str) -> bool:
    """Whether the bars of the residuals, or any other figure, have this pose."""
    return any(f'"{pose}"' in figure for figure in page.figures())


def select(app: App, page: WireClient, pose: str) -> None:
    app.select_id(pose)
    page.wait(lambda p: f"Pose {pose}" in plain(p))


def test_left_out_and_taken_in_again(app: App, page: WireClient) -> None:
    first = session(app).calibration
    select(app, page, POSE)
    page.wait(lambda p: in_plots(p, POSE))
    assert (grey_points(page), "left out" in plain(page)) == (0, False)
    page.click(LEAVE_OUT)
    page.wait(lambda p: p.has(TAKE_IN))
    assert app.worker.wait_idle(IDLE_S)
    assert session(app).uncounted == {POSE}
    assert session(app).screening is not None  # ranked again
    shows(
        page,
        f"− pose {POSE}: the test error is ",
        "no figure takes it",
        f"asked: {POSE}",
    )
    assert page.value("Pose") == f"{POSE} · training · left out"
    page.wait(lambda p: grey_points(p) == 1)
    page.wait(lambda p: not in_plots(p, POSE))
    assert any(f" pose {POSE}" in figure for figure in page.figures())  # the history of the error
    assert f"{ROOT}/corner/label" in page.scene  # it can still be looked at
    page.click(TAKE_IN)
    page.wait(lambda p: p.has(LEAVE_OUT))
    assert app.worker.wait_idle(IDLE_S)
    assert session(app).uncounted == frozenset()
    page.wait(lambda p: grey_points(p) == 0)
    assert np.array_equal(session(app).calibration.fit.x, first.fit.x)  # type: ignore[union-attr]
    assert not page.notifications


@pytest.mark.thorough
def test_ctrl_z_and_ctrl_y_go_through_it_and_the_key_is_off_where_it_does_nothing(app: App, page: WireClient) -> None:
    def command(label: str) -> dict:
        return next(p for p in page.commands.values() if p["label"] == label)

    while app.model.steps.past:
        app.move(-1)
        assert app.worker.wait_idle(IDLE_S)
    keys = [(command(label)["hotkey"], command(label)["modifier"]) for label in (UNDO_MODEL, REDO_MODEL)]
    assert keys == [("Z", "cmd/ctrl"), ("Y", "cmd/ctrl")]
    page.wait(lambda p: command(UNDO_MODEL)["disabled"])
    select(app, page, POSE)
    page.click(LEAVE_OUT)
    page.wait(lambda p: not command(UNDO_MODEL)["disabled"] and command(REDO_MODEL)["disabled"])
    assert app.worker.wait_idle(IDLE_S)
    page.trigger(UNDO_MODEL)
    page.wait(lambda p: p.has(LEAVE_OUT) and not command(REDO_MODEL)["disabled"])
    assert app.worker.wait_idle(IDLE_S)
    assert session(app).uncounted == frozenset()
    page.trigger(REDO_MODEL)
    page.wait(lambda p: p.has(TAKE_IN))
    assert app.worker.wait_idle(IDLE_S)
    assert session(app).uncounted == {POSE}
    assert session(app).redundancy is not None


@pytest.mark.thorough
def test_the_session_leaves_with_its_undo(app: App, page: WireClient, folder: Path, tmp_path: Path) -> None:
    """A pose left out, another residual, an effect: all of it can be taken back in the reopened session."""
    if POSE not in session(app).uncounted:
        app.leave_out(POSE, True)
        assert app.worker.wait_idle(IDLE_S)
    app.calibrate("pairs")
    assert app.worker.wait_idle(IDLE_S)
    app.add_effect(HIDDEN)
    assert app.worker.wait_idle(IDLE_S)
    page.downloads.clear()
    page.click("Session (JSON)")
    page.wait(lambda p: p.downloads, 30.0)
    path = tmp_path / "session.json"
    path.write_bytes(next(iter(page.downloads.values())))
    assert len(json.loads(path.read_text())["undo"]["past"]) == len(app.model.steps.past)
    now = session(app)
    saved, notes = opening(load_session(path), folder)
    assert notes == ()
    with idle_app(folder, saved=saved) as again, WireClient(again.server.get_port()) as other:
        assert str(session(again).history) == str(now.history)
        shows(other, f"+ {HIDDEN}: the test error")
        seen = []
        while again.model.steps.past:
            left = len(again.model.steps.past)
            other.trigger(UNDO_MODEL)
            other.wait(lambda p, left=left: len(again.model.steps.past) < left)  # type: ignore[misc]
            assert again.worker.wait_idle(IDLE_S)
            calibration = session(again).calibration
            assert calibration is not None
            out = sorted(session(again).uncounted)
            seen.append(([e.name for e in session(again).effects], calibration.residual, out))
        assert seen == [([], "pairs", [POSE]), ([], "position", [POSE]), ([], "position", [])]
        other.wait(lambda p: "left out" not in plain(p))
        assert other.has(ADD)
        assert not other.notifications
