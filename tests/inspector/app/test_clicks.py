"""A real browser clicks what is no widget: a point of a plot, a row of a table."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from inspector.app.app import App
from inspector.server.viser_server import url_of
from tests.support.app import idle_app
from tests.support.browser import browser, open_page, open_tab
from tests.support.hidden_dataset import write_hidden

# The id of a point that Plotly has drawn: of the trace's list, by the point's index.
ID = "node => node.closest('.trace').__data__[0].trace.ids[(node.__data__ ?? node.parentNode.__data__).i]"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    with idle_app(write_hidden(tmp_path_factory.mktemp("clicks") / "hidden")) as running:
        yield running


@pytest.fixture(scope="module")
def page(app: App) -> Iterator[Any]:
    with browser() as chromium, open_page(chromium, url_of(app.server)) as opened:
        yield opened


def selected(page: Any, app: App, pose_id: str) -> None:
    """Wait until this pose is selected, in the program and on the page."""
    for _ in range(200):
        if app.state.now.pose_id == pose_id:
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"{app.state.now.pose_id} is selected, not {pose_id}")


def test_a_row_of_the_table_selects_its_pose(page: Any, app: App) -> None:
    open_tab(page, "Scans")
    pose_id = app.state.session.dataset.poses.ids[5]
    page.locator(f'tr[data-value="{pose_id}"]').first.click()
    selected(page, app, pose_id)


def test_a_point_of_the_plot_selects_its_pose(page: Any, app: App) -> None:
    open_tab(page, "Where it fails")
    point = page.locator(".js-plotly-plot .scatterlayer .trace .points path:visible").nth(3)
    pose_id = point.evaluate(ID)
    point.click(force=True)
    selected(page, app, pose_id)


def test_a_bar_selects_its_pose(page: Any, app: App) -> None:
    open_tab(page, "Fit")
    bar = page.locator(".js-plotly-plot .barlayer .trace .points path:visible").nth(2)
    bar.scroll_into_view_if_needed()
    pose_id = bar.evaluate(ID)
    bar.click(force=True)
    selected(page, app, pose_id)
