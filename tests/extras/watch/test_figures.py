"""Figures of a watched cell."""

from __future__ import annotations

from dataclasses import replace

import pytest

from calib import diagnose
from calib.dataset.files.folder import load_dataset
from calib.errors import CalibError
from calib.extras.watch.watch import watch
from inspector import figures
from tests.support.copies import ROOT
from tests.support.figures import stands_alone


@pytest.mark.thorough
def test_the_control_chart_of_a_cell() -> None:
    dataset = load_dataset(ROOT / "sample_data" / "hidden_effect_a")
    found = diagnose(dataset)
    later = [watch(found.calibration, replace(dataset, name=name)) for name in ("may", "june")]
    figure = figures.control_chart(later)
    points = [(x, y) for trace in figure.data if trace.mode == "markers" for x, y in zip(trace.x, trace.y, strict=True)]
    assert sorted(points) == [(0, later[0].rmse_mm), (1, later[1].rmse_mm)]
    assert len(figures.control_chart(later[0]).data) == len(figure.data)
    stands_alone(figure, "mm")
    with pytest.raises(CalibError, match="no measurement to draw"):
        figures.control_chart([])
