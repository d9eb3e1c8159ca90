"""Learned curves on the page: offered beside the ranking, added with a click, drawn, undone, and in the report."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import pytest

from calib.screening.curves.smooth_joint_error import LEARNED
from inspector.app.app import App
from inspector.figures.curve_plots import CURVE
from inspector.panels.learn.missing_effects import REDO, REMOVE, UNDO
from inspector.report.report import report_html
from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.session import Session
from tests.support.app import idle, shows
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
    idle(app)
    learned = session(app).curves
    page.wait(offered)
    assert page.props("Effect")["options"][0] == LEARNED
    assert not curves_drawn(page)
    page.set("Effect", LEARNED)
    shows(page, "No named effect", "log evidence")
    page.click(ADD_CURVES)
    shows(page, f"+ {LEARNED}: the error of the held-out test poses falls", f"Curves of {LEARNED}", "sin(23 q1)")
    page.wait(curves_drawn)
    assert session(app).effects[0].members is learned.members
    assert f"{LEARNED}.J1" not in page.text()  # no row for each mode
    idle(app)
    page.press("Model", UNDO)
    page.wait(lambda p: not curves_drawn(p) and offered(p))
    assert session(app).curves is learned
    page.press("Model", REDO)
    page.wait(curves_drawn)
    idle(app)
    page.set("Effect", LEARNED)
    page.press("Model", REMOVE)
    shows(page, f"\u2212 {LEARNED}: the error of the held-out test poses rises", "It was needed")
    page.wait(lambda p: not curves_drawn(p))
    idle(app)
    page.wait(offered)
    assert page.value("Effect") == LEARNED  # it stays chosen while the ranking is made
    assert not page.notifications


@pytest.mark.thorough
def test_the_report_has_them_in_a_section_and_no_row_for_each_mode(folder: Path) -> None:
    ranked = sessions.with_screening(sessions.with_calibration(measuring.open_session(folder)))
    added = sessions.with_screening(sessions.with_effect(ranked, LEARNED))
    without, with_curves = (report_html(s, now=datetime.now()) for s in (ranked, added))
    assert "Learned curves of the joints" not in without
    assert "Learned curves of the joints" in with_curves
    assert "sin(23 q1)" in with_curves
    assert CURVE in with_curves
    assert f"{LEARNED}.J1" not in with_curves
