"""The real page in a real headless Chromium: it opens, shows every tab with its numbers, and draws."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import viser

from calib.rendering import numbers
from inspector.app.app import App
from inspector.app.serving import serving
from inspector.panels.review import NEXT, PREVIOUS
from inspector.scene.scene_view import ROOT
from inspector.server.viser_server import url_of
from tests.support.app import idle, without_reflections
from tests.support.browser import MS, colours_in, node_drawn, open_tab, says
from tests.support.tiny_dataset import BROKEN, HOSTILE, POSES, write_tiny

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def running(chromium: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    del chromium  # first: without a browser there is nothing to prepare
    with serving(write_tiny(tmp_path_factory.mktemp("datasets")), port=0) as app:  # opened while it works
        without_reflections(app)
        yield app


def test_the_page_opens_and_says_how_far_the_search_has_come(page: Any, app: App) -> None:
    open_tab(page, "Scans")
    names = [t.inner_text().strip() for t in page.get_by_role("tab").all()]
    assert {"Measure", "Model", "Learn", "Scans", "Planes", "Corner"} <= set(names)
    idle(app)
    says(page, f"{POSES - 1} of {POSES} corners found")


def test_scans_tab_and_the_scene_show_the_scan(page: Any, app: App) -> None:
    idle(app)
    open_tab(page, "Scans")
    says(page, "p01.ply")
    node_drawn(page, f"{ROOT}/faces/points")
    node_drawn(page, f"{ROOT}/overview/7")
    page.wait_for_timeout(1000)
    canvas = page.locator("canvas").first.bounding_box()
    middle = {"x": 420.0, "y": 200.0, "width": 380.0, "height": 320.0}  # between the two panels
    assert canvas["width"] >= middle["width"]
    assert colours_in(page.screenshot(clip=middle)) > 30


def test_next_and_previous_by_button_and_by_key(page: Any) -> None:
    open_tab(page, "Scans")
    page.get_by_role("button", name=NEXT).click()
    says(page, f"2 of {POSES}")
    says(page, "p02.ply")
    page.get_by_role("button", name=PREVIOUS).click()
    says(page, f"1 of {POSES}")
    page.mouse.click(600, 600)  # keys are not for the page while a widget has them
    page.keyboard.press("n")
    says(page, f"2 of {POSES}")
    page.keyboard.press("p")
    says(page, f"1 of {POSES}")


def test_corner_tab_shows_the_corner(page: Any, app: App) -> None:
    open_tab(page, "Corner")
    search = app.state.view.search
    for value in search.corner.xyz_mm:
        says(page, numbers.coordinate(value))
    page.get_by_role("button", name="Show the corner").click()
    node_drawn(page, f"{ROOT}/corner/ellipsoid")
    says(page, "sigma, 3D")


def test_a_failed_scan_is_explained(page: Any, app: App) -> None:
    pose_id = app.state.view.session.dataset.poses.ids[BROKEN]
    page.get_by_label("Pose", exact=True).first.click()
    page.get_by_role("option", name=f"{pose_id} ·").click()
    says(page, f"No corner: {app.state.view.session.searches[pose_id].failure[:60]}")
    page.mouse.click(600, 650)


def test_redundancy_tab_has_the_heatmap_and_the_groups(page: Any) -> None:
    open_tab(page, "Redundancy")
    says(page, "a6 and aTCP are indistinguishable: only a6 + aTCP can be known; keep a6.")
    image = page.locator(".js-plotly-plot .heatmaplayer image").last
    image.wait_for(timeout=MS)
    image.scroll_into_view_if_needed()  # below what to keep
    box = image.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.locator(".hoverlayer .hovertext").filter(has_text="r =").first.wait_for(state="attached", timeout=MS)
    labels = page.locator(".js-plotly-plot .ytick text").all_text_contents()
    assert "aTCP" in labels
    assert "d1" in labels


def test_fit_tab_has_curves_table_and_bars(page: Any, app: App) -> None:
    open_tab(page, "Fit")
    result = app.state.view.session.calibration
    says(page, numbers.column_mm(result.before.train.rmse_mm))
    says(page, numbers.reduction(result.before.train.rmse_mm, result.after.train.rmse_mm))
    page.locator(".js-plotly-plot .scatterlayer .trace").first.wait_for(state="attached", timeout=MS)
    page.locator(".js-plotly-plot .barlayer .point").first.wait_for(state="attached", timeout=MS)
    assert page.locator(".js-plotly-plot .barlayer .point").count() == POSES - 1  # one scan has no corner


def test_nothing_is_cut_off_sideways(page: Any) -> None:
    for name in ("Scans", "Planes", "Corner", "Compare", "Redundancy", "Fit"):
        open_tab(page, name)
        page.wait_for_timeout(200)
        wide = page.evaluate(
            """() => [...document.querySelectorAll('table')].filter(t => t.offsetParent)
                     .filter(t => t.scrollWidth > t.parentElement.clientWidth + 1).map(t => t.innerText.slice(0, 60))"""
        )
        assert wide == [], name


def test_names_from_files_run_nothing(page: Any, app: App) -> None:
    app.open("points")
    idle(app)
    app.select(1)
    open_tab(page, "Compare")
    says(page, f"Pose {HOSTILE}")
    assert page.evaluate("() => window.pwned === undefined")
    assert page.locator("b", has_text="p2").count() == 0


def test_another_web_page_cannot_drive_it_and_its_own_can(page: Any, chromium: Any, app: App) -> None:
    connect = """([address, version]) => new Promise(done => {
        const socket = new WebSocket(address, [version]);
        socket.onopen = () => { socket.close(); done("open"); };
        socket.onerror = () => done("refused"); })"""
    address = url_of(app.server).replace("http", "ws")
    stranger = chromium.new_page()
    stranger.goto("about:blank")
    assert stranger.evaluate(connect, [address, f"viser-v{viser.__version__}"]) == "refused"
    stranger.close()
    assert page.evaluate(connect, [address, f"viser-v{viser.__version__}"]) == "open"
