"""What all tests of the server need."""

from __future__ import annotations

import math

import pytest

from inspector.server import connection_log


@pytest.fixture(autouse=True)
def a_fresh_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines that other tests caused do not count against what this one may cause in a minute."""
    monkeypatch.setattr(connection_log._BOUND, "_since_s", -math.inf)
