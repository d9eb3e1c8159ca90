"""The app that a test of it needs, running, and a page of it.

A module that opens another folder defines `folder`, one that starts the app otherwise `running`, one that needs the app
in some state before each test `app` (from `running`, or from `folder` where each test needs an app of its own).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from inspector.app.app import App
from inspector.server.viser_server import url_of
from tests.support.app import idle_app
from tests.support.browser import open_page
from tests.support.hidden_dataset import write_hidden
from tests.support.wire_client import WireClient


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder that the app opens: a dataset of measured points whose arm has an effect that the model lacks."""
    return write_hidden(tmp_path_factory.mktemp("app"))


@pytest.fixture(scope="module")
def running(request: pytest.FixtureRequest, folder: Path) -> Iterator[App]:
    """The app on `folder` with its first work done, shared by the tests of a module."""
    if request.node.get_closest_marker("browser"):
        request.getfixturevalue("chromium")  # first: without a browser there is nothing to prepare
    with idle_app(folder) as app:
        yield app


@pytest.fixture
def app(running: App) -> App:
    """The running app, in the state in which the test before left it."""
    return running


@pytest.fixture(scope="module")
def browser_page(chromium: Any, running: App) -> Iterator[Any]:
    """A page of the app in a real browser, shared by the tests of a module."""
    with open_page(chromium, url_of(running.server)) as opened:
        yield opened


@pytest.fixture
def page(request: pytest.FixtureRequest) -> Iterator[Any]:
    """A page of the app: in a real browser for a test marked `browser`, otherwise a client that speaks its protocol."""
    if request.node.get_closest_marker("browser"):
        yield request.getfixturevalue("browser_page")
    else:
        server = request.getfixturevalue("app").server
        before = set(server.get_clients())
        with WireClient(server.get_port()) as client:
            # What is told to every page reaches those that the server lists, which may be after it sent its state.
            client.wait(lambda _: set(server.get_clients()) - before)
            yield client
