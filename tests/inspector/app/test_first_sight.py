"""A real browser: the headline's steps, the view that follows the tabs, a phone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from calib.calibration.model_versions import LINKS, NOMINAL
from calib.present.fit.errors import length
from inspector.app.app import App
from inspector.server.viser_server import url_of
from tests.support.browser import MS, open_page, open_tab
from tests.support.tiny_dataset import write_tiny

pytestmark = [pytest.mark.browser, pytest.mark.slow]

BAR = "#inspector-headline"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny(tmp_path_factory.mktemp("first"))


def until(page: Any, holds: Any) -> None:
    """Wait until something is so in the program."""
    for _ in range(int(MS / 50)):
        if holds():
            return
        page.wait_for_timeout(50)
    raise AssertionError("it never came true")


@pytest.mark.thorough
def test_the_headline_stands_over_the_view_and_its_stages_show_their_model(page: Any, app: App) -> None:
    bar = page.locator(BAR)
    view = page.locator("canvas").first.bounding_box()
    box = bar.bounding_box()
    assert box["y"] == 0
    assert abs(box["x"] - view["x"]) <= 1
    assert abs(box["width"] - view["width"]) <= 1
    assert abs(view["y"] - box["height"]) <= 1  # the view begins below it
    told = app.state.session.headline
    for number, version in ((0, NOMINAL), (1, LINKS)):
        stage = bar.locator(".headline-stage").nth(number)
        assert length(told, told.stages[number].error_mm) in stage.inner_text()
        stage.click()
        until(page, lambda version=version: app.state.now.version.name == version)  # type: ignore[union-attr]
        bar.locator(".headline-stage").nth(number).and_(page.locator('[aria-pressed="true"]')).wait_for()


CUT_OFF = """() => [...document.querySelectorAll('#inspector-headline *, [data-inspector-sheet] *')].filter(e => {
    const r = e.getBoundingClientRect();
    return r.width > 0 && r.height > 0 && (r.right > innerWidth + 1 || r.left < -1)
        && getComputedStyle(e).visibility === 'visible' && !e.closest('svg') && !e.closest('.js-plotly-plot');
}).map(e => e.tagName + ' ' + e.className + ': ' + e.textContent.slice(0, 40))"""


@pytest.mark.thorough
def test_on_a_phone_headline_view_and_tabs_are_all_there(chromium: Any, app: App) -> None:
    with open_page(chromium, url_of(app.server), 390, 844) as phone:
        headline = phone.locator(f"{BAR} .headline-stage strong").first
        headline.wait_for()
        bar, view = phone.locator(BAR).bounding_box(), phone.locator("canvas").first.bounding_box()
        sheet = phone.locator("[data-inspector-sheet]").bounding_box()
        assert (bar["x"], bar["y"], bar["width"], sheet["width"]) == (0, 0, 390, 390)
        assert bar["height"] < 844 / 4
        phone.wait_for_function(
            "() => Math.abs(document.querySelector('canvas').getBoundingClientRect().bottom"
            " - document.querySelector('[data-inspector-sheet]').getBoundingClientRect().top) <= 1"
        )
        view = phone.locator("canvas").first.bounding_box()
        assert abs(view["y"] - bar["height"]) <= 1
        assert view["height"] > 844 / 4  # between the headline and the tabs
        for tab in ("Scans", "Compare", "Fit", "What is missing", "Where it fails"):
            open_tab(phone, tab)
            phone.wait_for_timeout(200)
            assert phone.evaluate(CUT_OFF) == [], tab
        phone.locator(f"{BAR} .headline-stage").first.click()
        until(phone, lambda: app.state.now.version.name == NOMINAL)  # type: ignore[union-attr]
