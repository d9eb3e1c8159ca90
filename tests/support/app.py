"""The app for tests without a browser: running with its work done, what a page of it says, what a command prints."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

from inspector.app.app import App
from inspector.app.controllers import model_controller
from inspector.app.serving import serving
from inspector.session.reopening import Opening
from inspector.session.session import Session
from inspector.session.session_file import NOTHING_SHOWN, Shown, session_text
from tests.support.wire_client import WireClient

IDLE_S = 90.0  # the longest that a page's work is waited for
ADD = "Add to the model"  # the button


@contextmanager
def idle_app(
    folder: Path,
    effects_file: Path | None = None,
    saved: Opening | None = None,
    *,
    as_users_see_it: bool = False,
    ahead: bool = False,
) -> Iterator[App]:
    """The app on `folder`, at a port of its own, once everything that it begins with is done.

    `as_users_see_it` is for pictures: otherwise nothing is reflected, and metal is black. `ahead`: the advised model is
    judged before somebody asks, which takes a second that most tests do not need.
    """
    most_poses = model_controller.AHEAD_POSES if ahead or as_users_see_it else 0
    with (
        patch.object(model_controller, "AHEAD_POSES", most_poses),
        serving(folder, port=0, effects_file=effects_file, saved=saved) as app,
    ):
        if not as_users_see_it:
            without_reflections(app)
        idle(app)
        yield app


def idle(app: App) -> None:
    """Wait until the app has done all that it was asked for."""
    assert app.worker.wait_idle(IDLE_S)


def without_reflections(app: App) -> None:
    """Turn reflections off: without a GPU a browser takes seconds to blur the picture of a hall around the scene."""
    app.server.scene.configure_environment_map(None)


def plain(page: WireClient) -> str:
    """The page's words without markup."""
    without_links = re.sub(r"</?a\b[^>]*>", "", page.text())
    return html.unescape(re.sub(r"<[^>]+>", " ", without_links))


def shows(page: WireClient, *parts: str) -> None:
    """Wait until the page says all of this."""
    page.wait(lambda p: all(part in plain(p) for part in parts), 60.0)


def save_session(path: Path, session: Session, shown: Shown = NOTHING_SHOWN) -> None:
    """Write a session file, as a page's download does."""
    path.parent.mkdir(exist_ok=True)
    path.write_text(session_text(session, beside=path.parent, shown=shown), encoding="utf-8")
