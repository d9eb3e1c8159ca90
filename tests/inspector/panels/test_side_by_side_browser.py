"""A real browser puts another dataset beside the one on show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.dataset.files.folder import write_dataset
from inspector.app.app import App
from tests.support.browser import open_tab, says
from tests.support.checked_cell import measured_twice

pytestmark = [pytest.mark.browser, pytest.mark.thorough]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("beside")
    for dataset in measured_twice(5, {"theta3": np.radians(0.04)}):
        write_dataset(dataset, folder / dataset.name)
    return folder


def test_another_dataset_stands_beside(page: Any, app: App) -> None:
    open_tab(page, "Beside")
    page.get_by_role("textbox", name="Beside").or_(page.get_by_label("Beside")).locator("visible=true").first.click()
    page.get_by_role("option", name="before").click()
    says(page, "changed: the zero of joint 3")
    names = page.locator(".js-plotly-plot:visible .legendtext").all_text_contents()
    assert names == ["after", "before"]
