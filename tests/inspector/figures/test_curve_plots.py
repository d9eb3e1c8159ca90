"""The figure of learned curves: a panel each with units, the given band, grey beyond the measured range."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest

from calib.array_types import Array
from calib.dataset.files.robot_toml import builtin_robot
from calib.screening.curves.fitted_curves import FittedCurve
from inspector.figures.curve_plots import BAND, CURVE, MEASURED, height_px, joint_curves

ROBOT = builtin_robot("rb5")
U = np.linspace(-1.0, 1.0, 41)
OVER_ANGLE = FittedCurve(
    joint=1, is_revolute=True, input="q2", input_unit="deg", u=U, value=1e-3 * np.sin(5.0 * U),
    sigma=np.full(41, 1e-4), measured=np.array([-0.8, 0.1, 0.8]), rms=7e-4, known=2, parameters=2, formula=None,
)  # fmt: skip
OVER_TORQUE = replace(OVER_ANGLE, joint=2, input="torque3", input_unit="Nm")
OVER_SUM = replace(OVER_ANGLE, joint=2, input="q2+q3")
SLIDING = replace(OVER_ANGLE, is_revolute=False, input="temperature_c", input_unit="C", value=0.1 * U)
ALL = (OVER_ANGLE, OVER_TORQUE, OVER_SUM, SLIDING)


def traces(figure: go.Figure, name: str) -> list[go.Scatter]:
    return [trace for trace in figure.data if trace.name == name]


def numbers(values: list[float | None]) -> Array:
    return np.array([np.nan if v is None else v for v in values])


@pytest.mark.parametrize("columns", [1, 2])
def test_plotly_takes_every_value_and_panels_do_not_overlap(columns: int) -> None:
    figure = joint_curves(ALL, ROBOT, columns=columns)
    layout = go.Figure(figure.to_dict()).layout  # checks each value
    boxes = [(*layout[f"xaxis{n}"].domain, *layout[f"yaxis{n}"].domain) for n in ("", *map(str, range(2, 5)))]
    for i, (left, right, low, high) in enumerate(boxes):
        assert 0.0 <= left < right <= 1.0
        assert 0.0 <= low < high <= 1.0
        for other in boxes[:i]:
            assert right < other[0] or left > other[1] or high < other[2] or low > other[3]
    assert height_px(4, columns) == height_px(4 // columns)


def test_the_curve_its_band_and_the_measured_inputs_are_as_given() -> None:
    figure = joint_curves([OVER_ANGLE], ROBOT)
    (curve,), (band,), (upper,), (rug,) = (traces(figure, n) for n in (CURVE, BAND, "upper", MEASURED))
    np.testing.assert_allclose(numbers(curve.x), np.degrees(U), rtol=1e-4, atol=1e-9)
    y, inside = numbers(curve.y), OVER_ANGLE.inside
    np.testing.assert_allclose(y[inside], 1e3 * OVER_ANGLE.value[inside], rtol=1e-4, atol=1e-9)
    assert np.isnan(y[~inside]).all()  # the rest is drawn in grey
    np.testing.assert_allclose(numbers(upper.y) - numbers(band.y), 0.4, rtol=1e-3)
    assert list(rug.x) == pytest.approx(np.degrees([-0.8, 0.1, 0.8]), rel=1e-4)
    low, high = figure.layout.yaxis.range
    assert low < rug.y[0] < np.nanmin(numbers(band.y))
    assert high > np.nanmax(numbers(upper.y))


def test_what_is_far_outside_does_not_flatten_the_curve() -> None:
    wild = replace(OVER_ANGLE, value=np.where(OVER_ANGLE.inside, OVER_ANGLE.value, 1.0))
    low, high = joint_curves([wild], ROBOT).layout.yaxis.range
    assert high - low < 6.0  # mrad; the curve is 2 mrad high
