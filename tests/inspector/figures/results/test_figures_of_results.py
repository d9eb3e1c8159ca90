"""Figures of results: each shows the numbers of a real fit, with title, units and its own background."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import calib
from calib import learning_curve, redundancy
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.diagnosis.result import Diagnosis
from calib.errors import CalibError
from calib.options import FitOptions
from calib.planning.plan import plan_poses
from calib.planning.start import start_of_dataset
from calib.screening.curves.fitted_curves import fitted_curves
from inspector import figures
from inspector.figures.curve_plots import CURVE
from tests.support import ROOT
from tests.support.figures import named, stands_alone
from tests.support.hidden_dataset import write_unnamed


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return calib.load_dataset(ROOT / "sample_data" / "hidden_effect_a")


@pytest.fixture(scope="module")
def found(dataset: Dataset) -> Diagnosis:
    return calib.diagnose(dataset)


@pytest.fixture(scope="module")
def fit(found: Diagnosis) -> Calibration:
    return found.steps[0].calibration


@pytest.mark.slow
def test_bars_are_the_errors_of_the_poses(fit: Calibration) -> None:
    figure = figures.error_bars(fit)
    frame = fit.after.to_frame(fit.dataset).set_index("pose")
    shown = {x: y for trace in figure.data if trace.type == "bar" for x, y in zip(trace.x, trace.y, strict=True)}
    assert shown == pytest.approx(frame["error_mm"].to_dict())
    stands_alone(figure, "mm")


@pytest.mark.parametrize(
    ("over", "show", "x_unit", "y_unit"),
    [("q2", "length", "°", "mm"), ("torque3", 3, "Nm", "millidegrees"), ("order", "z", "order", "mm")],
)
def test_residuals_over_an_input_are_those_of_the_fit(
    fit: Calibration, over: str, show: str | int, x_unit: str, y_unit: str
) -> None:
    figure = figures.residuals_over(fit, over, show=show)
    frame = fit.after.to_frame(fit.dataset).set_index("pose")
    test = named(figure, "test")
    of_test = frame[frame["role"] == "test"]
    assert list(test.ids) == list(of_test.index)
    if show == "length":
        np.testing.assert_allclose(test.y, of_test["error_mm"])
        at = [fit.dataset.poses.ids.index(i) for i in test.ids]
        np.testing.assert_allclose(test.x, np.degrees(fit.dataset.poses.q[at, 1]))
    elif show == "z":
        np.testing.assert_allclose(test.y, of_test["error_z_mm"])
    stands_alone(figure, x_unit, y_unit)


def test_a_wrong_name_lists_the_right_ones(fit: Calibration, found: Diagnosis) -> None:
    for wrong, says in (
        (lambda: figures.residuals_over(fit, "speed"), r"no input named 'speed'; there are q1, .*torque2"),
        (lambda: figures.residuals_over(fit, "q1", show="w"), "there are length, x, y, z"),
        (lambda: figures.residuals_over(fit, "q1", show=7), "no joint 7; .* has joints 1 to 6"),
        (lambda: figures.learned_curves(found), "no curves were learned; the model is calibrated links"),
    ):
        with pytest.raises(CalibError, match=says):
            wrong()


def test_convergence_begins_at_the_nominal_robot_and_ends_at_the_fit(fit: Calibration) -> None:
    test = named(figures.convergence(fit), "test")
    assert (test.y[0], test.y[-1]) == pytest.approx((fit.before.test.rmse_mm, fit.after.test.rmse_mm))
    stands_alone(figures.convergence(fit), "mm", "iteration")


def test_the_heatmap_is_the_same_from_dataset_fit_and_analysis(dataset: Dataset, fit: Calibration) -> None:
    analysis = redundancy(dataset)
    for of in (dataset, fit, analysis):
        cells = figures.redundancy_heatmap(of).data[-1]
        np.testing.assert_array_equal(np.asarray(cells.z, float), analysis.pearson)
    stands_alone(figures.redundancy_heatmap(dataset), "parameter")


def test_the_history_tells_the_errors_of_the_steps(found: Diagnosis, fit: Calibration) -> None:
    figure = figures.error_history(found)
    steps = found.to_frame()
    np.testing.assert_allclose(named(figure, "test").y, [fit.before.test.rmse_mm, *steps["test_rmse_mm"]])
    np.testing.assert_allclose(named(figure, "training").y[1:], steps["train_rmse_mm"])
    bottom, top = named(figure, "noise alone").y[0], named(figure, "noise alone, 95 %").y[0]
    assert 0.5 * (bottom + top) == pytest.approx(np.sqrt(3.0) * dataset_sigma(fit.dataset))
    single = named(figure, "each test pose")
    last = np.linalg.norm(found.calibration.after.error_mm, axis=1)[
        fit.dataset.poses.is_test[found.calibration.after.pose]
    ]
    np.testing.assert_allclose(
        sorted(y for x, y in zip(single.x, single.y, strict=True) if x and x > len(steps) - 0.5), sorted(last)
    )
    stands_alone(figure, "mm")


def dataset_sigma(dataset: Dataset) -> float:
    assert dataset.scanner.point_sigma_mm is not None
    return dataset.scanner.point_sigma_mm


@pytest.mark.thorough
def test_learned_curves_are_those_of_the_fit(tmp_path: Path) -> None:
    found = calib.diagnose(calib.load_dataset(write_unnamed(tmp_path)))
    curves = fitted_curves(found.calibration)
    figure = figures.learned_curves(found)
    assert figures.learned_curves(found.calibration) == figure
    assert [note.text for note in figure.layout.annotations] == [f"<b>Joint {c.joint + 1}</b>" for c in curves]
    drawn = [trace for trace in figure.data if trace.name == CURVE]
    largest = [np.nanmax(np.abs(np.array(trace.y, dtype=float))) for trace in drawn]
    for curve, size in zip(curves, largest, strict=True):
        assert size <= np.max(np.abs(curve.scale * curve.value)) + 1e-12
    stands_alone(figure, "mrad", "°")


@pytest.mark.slow
def test_what_more_poses_and_a_plan_promise(dataset: Dataset) -> None:
    curve = learning_curve(dataset, counts=[20, 40], repeats=2)
    figure = figures.learning_curve(curve)
    held_out = named(figure, "held-out poses")
    table = curve.to_frame()
    assert list(held_out.x) == table["poses"].tolist()
    np.testing.assert_allclose(held_out.y, table["held_out_rmse_mm"])
    np.testing.assert_allclose(held_out.error_y.array, table["spread_mm"])
    stands_alone(figure, "mm", "poses")
    plan = plan_poses(start_of_dataset(dataset, FitOptions()), 3, candidates=60)
    drawn = figures.plan_curve(plan)
    at = named(drawn, "this plan")
    assert (at.x[0], at.y[0]) == (3, plan.curve_mm[3])
    stands_alone(drawn, "mm", "poses")


def test_names_are_escaped(fit: Calibration) -> None:
    hostile = replace(fit, dataset=replace(fit.dataset, name="<b>&"))
    assert "<b>" not in figures.error_bars(hostile).layout.title.text
    assert "<b>" not in figures.to_svg(figures.error_bars(hostile))


def test_a_still_picture_is_one_file_with_the_same_values(fit: Calibration) -> None:
    text = figures.to_svg(figures.error_bars(fit), 700)
    picture = ElementTree.fromstring(text)
    assert picture.get("viewBox") == "0 0 700 420"
    space = "{http://www.w3.org/2000/svg}"
    assert f"Error at each pose after the fit: {fit.dataset.name}" in [t.text for t in picture.iter(f"{space}text")]
    assert "background:#fff" in text
    clipped = [e for e in picture.iter(f"{space}rect") if e.find(f"{space}title") is not None]
    told = [float(re.search(r"([\d.]+) mm", e.findtext(f"{space}title") or "")[1]) for e in clipped]  # type: ignore[index]
    errors = fit.after.to_frame(fit.dataset)["error_mm"]
    np.testing.assert_allclose(sorted(told), sorted(errors), atol=6e-5)


def test_the_face_is_what_type_checkers_see_and_loads_when_asked() -> None:
    stub = (ROOT / "inspector" / "figures" / "__init__.pyi").read_text("utf-8")
    assert sorted(re.findall(r"import (\w+) as \1", stub)) == figures.__all__ == sorted(figures._HOME)
    for home, name in re.findall(r"from (\S+) import (\w+) as", stub):
        assert figures._HOME[name] == home
    for name in figures.__all__:
        assert getattr(figures, name).__doc__, name
    with pytest.raises(AttributeError, match="no attribute 'error_bar'"):
        figures.error_bar  # noqa: B018


@pytest.mark.slow
def test_without_plotly_one_line_says_what_to_install() -> None:
    program = """
import sys
sys.modules["plotly"] = None
from inspector import figures
assert "viser" not in sys.modules and "error_bars" in dir(figures)
try:
    figures.error_bars
except Exception as error:
    print(type(error).__name__, error)
"""
    said = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert said.stdout.splitlines() == [
        "CalibError inspector.figures.error_bars needs plotly, which is not installed: "
        "pip install 'robot-calibration-inspector[page]'"
    ]
