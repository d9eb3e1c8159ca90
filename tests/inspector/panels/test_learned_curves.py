"""Learned curves on the page: offered beside the ranking, added with a click, drawn, undone, and in the report."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from calib.screening.curves.smooth_joint_error import LEARNED
from inspector.app.app import App
from inspector.figures.curve_plots import CURVE
from inspector.panels.learn.missing_effects import REDO, REMOVE, UNDO
from inspector.report.content import report_of
from inspector.report.report import report_html
from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.session import Session
from tests.support.app import IDLE_S, shows
from tests.support.hidden_dataset import write_unnamed
from tests.support.wire_client import WireClient

ADD_CURVES = f"Add {LEARNED} (joint 1)"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_unnamed(tmp_path_factory.mktemp("cell"))


def session(app: App) -> Session:
    return app.state.now.session


def curves_drawn(page: WireClient) -> bool:
    return any(
        CURVE in (m["props"].get("_plotly_json_str") or "") and m["props"].get("visible") for m in page.gui.values()
    )


def offered(page: WireClient) -> bool:
    return page.has(ADD_CURVES) and bool(page.props(ADD_CURVES)["visible"])


@pytest.mark.thorough
def test_they_are_offered_added_with_a_click_and_taken_back(app: App, page: WireClient) -> None:
    assert app.worker.wait_idle(IDLE_S)
    learned = session(app).curves
    assert learned is not None
    page.wait(offered)
    assert page.props("Effect")["options"][0] == LEARNED
    assert not curves_drawn(page)
    page.set("Effect", LEARNED)
    shows(page, "No named effect", "log evidence")
    page.click(ADD_CURVES)
    shows(page, f"+ {LEARNED}: the test error fell", f"Curves of {LEARNED}", "sin(23 q1)")
    page.wait(curves_drawn)
    assert session(app).effects[0].members is learned.members
    assert f"{LEARNED}.J1" not in page.text()  # no row for each mode
    assert app.worker.wait_idle(IDLE_S)
    page.press("Model", UNDO)
    page.wait(lambda p: not curves_drawn(p) and offered(p))
    assert session(app).curves is learned
    page.press("Model", REDO)
    page.wait(curves_drawn)
    assert app.worker.wait_idle(IDLE_S)
    page.set("Effect", LEARNED)
    page.press("Model", REMOVE)
    shows(page, f"\u2212 {LEARNED}: the test error rose", "It was needed")
    page.wait(lambda p: not curves_drawn(p))
    assert app.worker.wait_idle(IDLE_S)
    page.wait(offered)
    assert page.value("Effect") == LEARNED  # it stays chosen while the ranking is made
    assert not page.notifications


@pytest.mark.thorough
def test_the_report_has_them_in_a_section_and_no_row_for_each_mode(folder: Path) -> None:
    ranked = sessions.with_screening(sessions.with_calibration(measuring.open_session(folder)))
    added = sessions.with_screening(sessions.with_effect(ranked, LEARNED))
    without, with_curves = (report_html(report_of(s), now=datetime.now()) for s in (ranked, added))
    assert "Learned curves of the joints" not in without
    assert "Learned curves of the joints" in with_curves
    assert "sin(23 q1)" in with_curves
    assert CURVE in with_curves
    assert f"{LEARNED}.J1" not in with_curves


@pytest.mark.browser
@pytest.mark.thorough
def test_find_shows_the_curve(chromium: Any, app: App) -> None:
    from inspector.panels.learn.missing_effects import FIND
    from inspector.server.viser_server import url_of
    from tests.support.browser import MS, open_page, says

    with open_page(chromium, url_of(app.server)) as opened:
        opened.get_by_role("button", name=FIND, exact=True).click(timeout=4 * MS)
        says(opened, f"Curves of {LEARNED}")
        opened.wait_for_function(
            """name => [...document.querySelectorAll('.js-plotly-plot')].some(plot =>
                plot.offsetWidth > 200 && (plot.data || []).some(t => t.name == name && t.x.length > 100))""",
            arg=CURVE, timeout=MS,
        )  # fmt: skip
        table = opened.locator("table:visible", has_text="known").last
        assert table.evaluate("t => t.scrollWidth <= t.parentElement.clientWidth")  # nothing is cut off
        text = opened.locator(".js-plotly-plot", has_text="joint 1 angle").first
        assert "error, mrad" in text.inner_text()
        assert "Joint 1" in text.inner_text()
