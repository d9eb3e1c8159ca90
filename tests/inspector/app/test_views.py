"""The 3D view follows the tabs, may be kept still, and is looked at from the sides of the arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.array_types import Array
from inspector.app.app import App
from inspector.session.view import FRONT, RESET, SIDE, TOP
from tests.support.app import IDLE_S, idle
from tests.support.tiny_dataset import write_tiny
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny(tmp_path_factory.mktemp("views"))


@pytest.fixture
def app(running: App) -> App:
    running.keep_view(False)
    running.open("cell")
    assert running.worker.wait_idle(IDLE_S)
    return running


def after(app: App, tabs: str) -> str:
    """The view on show once these tabs are open."""
    app.tabs(tabs)
    idle(app)
    return app.stage.view_name


def test_each_tab_shows_what_it_is_about(app: App) -> None:
    assert app.stage.view_name == "Arm"
    for tabs, view in (
        ("Review/Measure/Scans", "Scan"),
        ("Review/Measure/Planes", "Planes"),
        ("Review/Model/Redundancy", "Planes"),  # it is about no place
        ("Review/Measure/Corner", "Corner"),
        ("Review/Learn/What is missing", "Arm"),
        ("Measure/Planes", "Planes"),  # on a phone
        ("Review/Model/Fit", "Arm"),
        ("", "Arm"),
    ):
        assert after(app, tabs) == view


def test_a_view_that_is_kept_follows_no_tab(app: App) -> None:
    with WireClient(app.server.get_port()) as page:
        page.set("Keep this view", True)
        page.wait(lambda _: app.stage._camera.kept)
        assert after(app, "Review/Measure/Planes") == "Arm"
        page.set("3D view", "Corner")  # what the user asks for himself is shown
        page.wait(lambda _: app.stage.view_name == "Corner")
        page.set("Keep this view", False)
        page.wait(lambda _: not app.stage._camera.kept)
        assert after(app, "Review/Measure/Planes") == "Planes"


def eye(app: App) -> tuple[Array, Array]:
    """Where the camera stands, seen from what it looks at, in the base's frame; and what is up there."""
    version = app.state.now.version
    base = next(iter(version.evaluation.scanner_T_base.values()))[:3, :3]
    camera = app.server.initial_camera
    position = base.T @ np.array(camera.position)
    return position / np.linalg.norm(position), base.T @ np.array(camera.up)


def test_the_arm_is_looked_at_from_its_front_its_side_and_above(app: App) -> None:
    usual, _ = eye(app)
    for side, towards in ((FRONT, (1, 0, 0)), (SIDE, (0, -1, 0)), (TOP, (0, 0, 1))):
        app.look_from(side)
        idle(app)
        at, up = eye(app)
        np.testing.assert_allclose(at, towards, atol=0.03)
        np.testing.assert_allclose(up, (0, 0, 1), atol=1e-9)
    app.look_from(RESET)
    idle(app)
    np.testing.assert_allclose(eye(app)[0], usual, atol=1e-9)
