"""A pose left out on the page, without a browser: lists, colours, plots, history, undo by its key, the session file."""

from __future__ import annotations

import numpy as np
import pytest

from inspector.app.app import App
from inspector.markup.parts.palette import LEFT_OUT, rgb
from inspector.panels.review import LEAVE_OUT, TAKE_IN
from inspector.scene.scene_view import ROOT
from inspector.session.session import Session
from tests.support.app import idle, plain, shows
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
    idle(app)
    assert session(app).uncounted == {POSE}
    assert session(app).screening is not None  # ranked again
    shows(
        page,
        f"− pose {POSE}: the error of the held-out test poses that count now is ",
        "no figure takes it",
        f"asked: {POSE}",
    )
    assert page.value("Pose") == f"{POSE} · training · left out"
    page.wait(lambda p: grey_points(p) == 1)
    page.wait(lambda p: not in_plots(p, POSE))
    assert any(f" pose {POSE}" in figure for figure in page.figures())  # the history of the error
    assert f"{ROOT}/corner/ellipsoid" in page.scene  # it can still be looked at
    page.click(TAKE_IN)
    page.wait(lambda p: p.has(LEAVE_OUT))
    idle(app)
    assert session(app).uncounted == frozenset()
    page.wait(lambda p: grey_points(p) == 0)
    assert np.array_equal(session(app).calibration.fit.x, first.fit.x)  # type: ignore[union-attr]
    assert not page.notifications
