"""The learning loop in a real headless Chromium: the numbers that a person reads are those of the command."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from calib.rendering import numbers
from inspector.app.app import App
from inspector.panels.learn.missing_effects import FIND, REDO, REMOVE, UNDO
from tests.support.app import ADD, idle
from tests.support.browser import MS, says
from tests.support.commands import answered
from tests.support.hidden_dataset import HIDDEN

pytestmark = pytest.mark.browser


def fact(page: Any, name: str) -> str:
    """The value that is written beside a name."""
    row = page.get_by_role("row").filter(has=page.get_by_role("rowheader", name=name, exact=True))
    return str(row.locator("visible=true").first.get_by_role("cell").last.inner_text())


def press(page: Any, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click()


def steps_drawn(page: Any, count: int) -> None:
    """Wait until the history of the error has so many steps of test poses."""
    page.wait_for_function(
        """count => [...document.querySelectorAll('.js-plotly-plot')].some(plot => (plot.data || []).some(
            t => t.name == 'noise alone') && plot.data.find(t => t.name == 'test').y.length == count)""",
        arg=count, timeout=MS,
    )  # fmt: skip


def test_the_loop_add_fall_undo_redo(page: Any, folder: Path) -> None:
    told = answered("diagnose", folder)
    before, after = (step["test_rmse_mm"] for step in told["steps"])
    steps_drawn(page, 2)
    press(page, ADD)
    falls = f"+ {HIDDEN}: the error of the held-out test poses falls by {numbers.share(1.0 - after / before)}"
    says(page, f"{falls}, {numbers.length_change(before, after)}")
    steps_drawn(page, 3)
    press(page, UNDO)
    steps_drawn(page, 2)
    press(page, REDO)
    steps_drawn(page, 3)
    press(page, REMOVE)
    says(page, "It was needed")
    steps_drawn(page, 4)


@pytest.mark.thorough
def test_find_what_is_missing_ends_with_the_commands_verdict(page: Any, app: App, folder: Path) -> None:
    told = answered("diagnose", folder)
    press(page, FIND)
    says(page, told["explanation"].split("\n\n")[-1])
    idle(app)
    assert told["verdict"] == "named"


def test_nothing_is_cut_off_sideways(page: Any) -> None:
    for name in ("Learn", "Where it fails"):
        page.get_by_role("tab", name=name, exact=True).click()
        page.wait_for_timeout(200)
        wide = page.evaluate(
            """() => [...document.querySelectorAll('table')].filter(t => t.offsetParent)
                     .filter(t => t.scrollWidth > t.parentElement.clientWidth + 1).map(t => t.innerText.slice(0, 60))"""
        )
        assert wide == [], name
