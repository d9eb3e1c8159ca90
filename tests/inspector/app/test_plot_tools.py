"""What a real browser does with figures: zoom and back, wild points, another figure's numbers, files."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from inspector.app.app import App
from inspector.server.viser_server import url_of
from tests.support.browser import open_page, open_tab
from tests.support.clicks import selected
from tests.support.hidden_dataset import write_hidden

pytestmark = [pytest.mark.browser, pytest.mark.thorough]
WILD, OFF_MM = 9, 12.0  # a row of points.csv, and how far its point is off


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_hidden(tmp_path_factory.mktemp("plots") / "hidden")
    with (folder / "points.csv").open() as file:
        rows = list(csv.reader(file))
    rows[WILD][rows[0].index("x_mm")] = str(float(rows[WILD][rows[0].index("x_mm")]) + OFF_MM)
    with (folder / "points.csv").open("w") as file:
        csv.writer(file).writerows(rows)
    return folder


@pytest.fixture(scope="module")
def browser_page(running: App, chromium: Any) -> Iterator[Any]:
    with open_page(chromium, url_of(running.server), 1600, 900) as opened:
        yield opened


def residual_plot(page: Any) -> Any:
    """The figure of the tab Where it fails, fully in view."""
    open_tab(page, "Where it fails")
    plot = page.locator(".js-plotly-plot:visible").first
    plot.scroll_into_view_if_needed()
    return plot


def y_range(plot: Any) -> list[float]:
    found: list[float] = plot.evaluate("plot => [...plot._fullLayout.yaxis.range]")
    return found


def until(page: Any, holds: Any) -> None:
    """Wait until this holds."""
    for _ in range(200):
        if holds():
            return
        page.wait_for_timeout(50)
    raise AssertionError("still not so")


def middle(plot: Any) -> tuple[float, float]:
    box = plot.locator(".nsewdrag").first.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def back(page: Any, plot: Any) -> None:
    """Double-click where no point is, which would be selected; not as the third and fourth of one row of clicks."""
    page.wait_for_timeout(700)
    box = plot.locator(".nsewdrag").first.bounding_box()
    page.mouse.dblclick(box["x"] + 5, box["y"] + 5)


def back_until(page: Any, plot: Any, holds: Any) -> None:
    """Double-click until this holds: on a busy machine the figure may be drawn anew between two clicks."""
    for _ in range(5):
        back(page, plot)
        for _ in range(80):
            if holds():
                return
            page.wait_for_timeout(50)
    raise AssertionError("still not so")


def drag(page: Any, plot: Any) -> None:
    """Draw a box within the figure."""
    x, y = middle(plot)
    page.mouse.move(x - 60, y - 40)
    page.mouse.down()
    page.mouse.move(x, y, steps=4)
    page.mouse.move(x + 60, y + 40, steps=4)
    page.mouse.up()


def test_a_wild_point_does_not_flatten_the_rest_and_can_be_clicked(page: Any, app: App) -> None:
    plot = residual_plot(page)
    before = y_range(plot)
    assert max(map(abs, before)) < OFF_MM / 2
    assert "1 beyond, up to" in plot.text_content()
    edge = plot.locator(".scatterlayer .trace").filter(has=page.locator('path[d*="L"]')).locator("path.point").last
    wild = app.state.session.dataset.poses.ids[WILD - 1]
    edge.click(force=True)
    selected(page, app, wild)
    back_until(page, plot, lambda: max(map(abs, y_range(plot))) > OFF_MM / 2)
    until(page, lambda: not plot.get_by_text("1 beyond, up to").is_visible())
    back_until(page, plot, lambda: y_range(plot) == pytest.approx(before))


def test_a_zoom_stays_with_its_numbers_and_goes_back(page: Any, app: App) -> None:
    plot = residual_plot(page)
    before = y_range(plot)
    drag(page, plot)
    until(page, lambda: y_range(plot)[1] - y_range(plot)[0] < 0.8 * (before[1] - before[0]))
    zoomed = y_range(plot)
    app.select(3)
    assert app.worker.wait_idle(20)
    page.wait_for_timeout(300)
    assert y_range(plot) == pytest.approx(zoomed)  # another pose: the same numbers
    app.select_joint(2)
    assert app.worker.wait_idle(20)
    other = app.panels.residuals._plot.figure.layout.yaxis.uirevision
    until(page, lambda: plot.evaluate("plot => plot._fullLayout.yaxis.uirevision") == other)
    assert y_range(plot) != pytest.approx(zoomed)
    shown = y_range(plot)
    drag(page, plot)
    until(page, lambda: y_range(plot) != pytest.approx(shown))
    back(page, plot)
    until(page, lambda: y_range(plot) == pytest.approx(shown))
    app.select_joint(None)


def test_the_wheel_scrolls_the_panel_and_zooms_with_ctrl(page: Any) -> None:
    plot = residual_plot(page)
    before = y_range(plot)
    page.mouse.move(*middle(plot))
    page.mouse.wheel(0, 60)
    page.wait_for_timeout(300)
    assert y_range(plot) == before
    page.mouse.move(*middle(plot))
    page.keyboard.down("Control")
    page.mouse.wheel(0, -200)
    page.keyboard.up("Control")
    until(page, lambda: y_range(plot)[1] - y_range(plot)[0] < before[1] - before[0])
    back_until(page, plot, lambda: y_range(plot) == pytest.approx(before))
