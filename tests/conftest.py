"""What all tests share: settings, and one browser a module."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import pytest

# Before any test loads numpy: BLAS threads that wait for each other cost more than they save on small matrices.
for _variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

from hypothesis import settings  # noqa: E402

pytest.register_assert_rewrite("tests.support")  # their assertions say what they compared, as those of test files do

# No deadline: a slow machine is not a wrong result. In CI the drawn inputs are the same on every run.
settings.register_profile("project", deadline=None, print_blob=True, derandomize=bool(os.environ.get("CI")))
settings.load_profile("project")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Browser tests are slow: a browser takes seconds to start and to draw. So is what is thorough."""
    for item in items:
        if item.get_closest_marker("browser") or item.get_closest_marker("thorough"):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """A headless Chromium; see tests/support/browser.py for what happens where there is none."""
    from tests.support.browser import browser  # the browser's driver is needed by few tests

    with browser() as running:
        yield running
