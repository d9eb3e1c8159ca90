"""A real browser holds another dataset against the calibration on show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.dataset.files.folder import write_dataset
from inspector.app.app import App
from inspector.extras.watch.watch_panel import MOVED
from tests.support.browser import open_tab, says
from tests.support.checked_cell import measured_twice

pytestmark = [pytest.mark.browser, pytest.mark.thorough]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("watched")
    for dataset in measured_twice(5, {"theta3": np.radians(0.04)}):
        write_dataset(dataset, folder / dataset.name)
    return folder


def test_another_dataset_is_held_against_the_calibration(page: Any, app: App) -> None:
    open_tab(page, "Watch")
    page.get_by_text(MOVED).locator("visible=true").first.click()
    page.get_by_label("Measured later").locator("visible=true").first.click()
    page.get_by_role("option", name="before").click()
    says(page, "before: changed. the zero of joint 3")
    assert "changed" in page.locator(".js-plotly-plot:visible .legendtext").all_text_contents()
