"""The tab Plan in a real browser: from an open diagnosis by one click to poses, drawn in 3D, and a file of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from calib.dataset.files.folder import write_dataset
from calib.simulation.simulate import simulate_dataset
from inspector.app.app import App
from inspector.panels.learn.missing_effects import SETTLE
from tests.support.app import idle
from tests.support.browser import node_drawn, open_tab, says

pytestmark = [pytest.mark.slow, pytest.mark.browser]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bending of links that these poses do not tell from compliance of joints."""
    folder = tmp_path_factory.mktemp("plan") / "cell"
    made = simulate_dataset("rb5", rng=10, effects=[("link_bending", 1.0)], poses=40)
    write_dataset(made.dataset, folder)
    return folder


@pytest.mark.thorough
def test_an_open_set_is_planned_for_in_one_click(app: App, page: Any) -> None:
    app.find(True)
    idle(app)
    assert app.state.session.diagnosis.verdict == "ambiguous"
    open_tab(page, "What is missing")
    page.get_by_text(SETTLE).first.click()
    says(page, "the probability that they do is")
    node_drawn(page, "/scene/plan/rays")
    node_drawn(page, "/scene/plan/field")
    rows = page.locator('tr[data-ask="planned"]')
    rows.nth(4).wait_for()
    assert rows.count() == 5
    rows.nth(1).click()
    node_drawn(page, "/scene/plan/arm/cylinders")
    with page.expect_download() as download:
        page.get_by_role("button", name="poses.csv").click()
    table = pd.read_csv(download.value.path())
    assert list(table["pose"]) == ["p41", "p42", "p43", "p44", "p45"]
    app.calibrate("distance")  # another model: the plan is no longer of it
    says(page, "plan again")
    rows.first.wait_for(state="detached")
