"""Two calibrations beside each other on the page, without a browser."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.folder import write_dataset
from inspector.app.app import App
from inspector.panels.model.side_by_side import NONE
from tests.support.app import idle, plain
from tests.support.checked_cell import measured_twice
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("beside")
    for dataset in measured_twice(5, {"theta3": np.radians(0.04)}):
        write_dataset(dataset, folder / dataset.name)
    panda = measured_twice(6, robot="panda")[0]
    write_dataset(replace(panda, name="panda"), folder / "other arm")
    return folder


def beside(app: App, choice: str) -> str:
    """What the page says once this is chosen."""
    app.panels.side_by_side.other.value = choice
    app.beside()
    idle(app)
    with WireClient(app.server.get_port()) as page:
        return plain(page)


def test_the_change_between_two_datasets_is_named(app: App) -> None:
    assert app.state.name == "after"
    assert "Choose what to see" in beside(app, NONE)
    said = beside(app, "before")
    assert "zero of joint 3 (theta3) by +0.0" in said
    assert "θ3" in said.split("difference ± sigma")[1]
    figure = app.panels.side_by_side._plot.figure
    assert [trace.name for trace in figure.data] == ["after", "before"]
    assert figure.data[0].ids is not None
    assert figure.data[1].ids is None  # the poses of another dataset cannot be selected


def test_another_kind_of_arm_is_refused_where_it_is_looked_for(app: App) -> None:
    assert "not of the same kinds" in beside(app, "other arm")
    assert not app.panels.side_by_side._plot.visible
