"""A real browser clicks what is no widget: points of plots, rows of tables, names in sentences, the arm in 3D."""

from __future__ import annotations

from typing import Any

import pytest

from calib.calibration.model_versions import LINKS, NOMINAL
from inspector.app.app import App
from tests.support.browser import open_tab
from tests.support.clicks import joint_selected, selected

# The id of a point that Plotly has drawn: of the trace's list, by the point's index.
ID = "node => node.closest('.trace').__data__[0].trace.ids[(node.__data__ ?? node.parentNode.__data__).i]"

pytestmark = [pytest.mark.browser, pytest.mark.slow]


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


def test_the_keyboard_selects_and_lets_go(page: Any, app: App) -> None:
    open_tab(page, "Fit")
    row = page.locator('tr[data-ask="joint"][data-value="2"]:visible').first
    row.focus()
    page.keyboard.press("Shift+Tab")
    page.keyboard.press("Tab")
    assert row.evaluate("row => getComputedStyle(row).outlineStyle") == "solid"
    page.keyboard.press("Enter")
    joint_selected(page, app, 2)
    page.keyboard.press("Space")  # the same again lets it go
    joint_selected(page, app, None)


def test_a_step_of_the_history_shows_that_model(page: Any, app: App) -> None:
    open_tab(page, "What is missing")
    history = page.locator(".js-plotly-plot").filter(has_text="each test pose")
    point = history.locator('.points path[style*="rgb(55, 133, 157)"]').first  # the training poses' RMSE
    point.scroll_into_view_if_needed()
    point.click(force=True)
    for _ in range(200):
        if app.state.now.version is not None and app.state.now.version.name == NOMINAL:
            break
        page.wait_for_timeout(50)
    assert app.state.now.version.name == NOMINAL
    app.show_step(1)
    assert app.worker.wait_idle(10)
    assert app.state.now.version.name == LINKS


def test_a_step_of_the_work_opens_its_tab(page: Any) -> None:
    page.locator("#inspector-headline .headline-step", has_text="Take away").click()
    page.get_by_role("tab", name="Take away", selected=True).wait_for()
    page.locator("#inspector-headline .headline-step", has_text="Fit").click()
    page.get_by_role("tab", name="Fit", selected=True).wait_for()
