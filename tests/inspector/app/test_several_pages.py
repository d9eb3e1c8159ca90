"""Several pages on one server."""

from __future__ import annotations

import pytest

from inspector.app.app import App
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow


@pytest.mark.thorough
def test_pages_say_that_they_share_what_is_shown(app: App) -> None:
    port, words = app.server.get_port(), "2 pages are open: they share what is shown."
    with WireClient(port) as one:
        assert words not in one.text()
        with WireClient(port) as other:
            one.wait(lambda page: words in page.text(), 30)
            other.wait(lambda page: words in page.text(), 30)
        one.wait(lambda page: words not in page.text(), 30)
