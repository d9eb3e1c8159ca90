"""The public names as a notebook uses them: examples, paths and names as arguments, results with their own methods."""

from __future__ import annotations

import doctest
import inspect
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib.effects.catalogue import family_of
from calib.effects.catalogue.joints import TransmissionError
from calib.errors import CalibError, DatasetError, FitError
from calib.options import FitOptions
from tests.support import ROOT

CELL = str(ROOT / "sample_data" / "hidden_effect_a")
HIDDEN = "transmission_error"
FUNCTIONS = [name for name in calib.__all__ if inspect.isfunction(inspect.unwrap(getattr(calib, name)))]


@pytest.fixture(scope="module")
def dataset() -> calib.Dataset:
    return calib.load_dataset(CELL)


@pytest.fixture(scope="module")
def fit() -> calib.Calibration:
    return calib.calibrate(CELL, effects=[HIDDEN])


@pytest.fixture(scope="module")
def found() -> calib.Diagnosis:
    return calib.diagnose(CELL)


# ---- examples -------------------------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("name", [name for name in calib.__all__ if name != "__version__"])
def test_examples_in_docstrings_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    value = getattr(calib, name)
    assert inspect.getdoc(value), "says what it is"
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    monkeypatch.chdir(tmp_path)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    said: list[str] = []
    tests = doctest.DocTestFinder(recurse=False).find(inspect.unwrap(value), name, globs={})
    for test in tests:
        runner.run(test, out=said.append)
    assert not runner.failures, "".join(said)
    assert name not in FUNCTIONS or runner.tries, "a public function has an example"


# ---- what is taken --------------------------------------------------------------------------------------------------


def test_datasets_are_taken_as_paths(dataset: calib.Dataset) -> None:
    plain = calib.calibrate(dataset)
    for given in (CELL, Path(CELL)):
        np.testing.assert_array_equal(calib.calibrate(given).fit.x, plain.fit.x)
    with pytest.raises(DatasetError, match=r"no_such.*dataset\.toml"):
        calib.calibrate("no_such")
    with pytest.raises(DatasetError, match="found a int, expected a Dataset or the path"):
        calib.redundancy(3)  # type: ignore[arg-type]


def test_effects_are_taken_by_name_class_family_or_member(dataset: calib.Dataset, fit: calib.Calibration) -> None:
    family = family_of(dataset, HIDDEN)
    for effects in (HIDDEN, [TransmissionError], [family], family.members, [HIDDEN, family]):
        np.testing.assert_array_equal(calib.calibrate(dataset, effects=effects).fit.x, fit.fit.x)
    with pytest.raises(CalibError, match="no effect named 'slack'; there are joint_compliance"):
        calib.calibrate(dataset, effects="slack")
    with pytest.raises(CalibError, match="found a int as an effect"):
        calib.calibrate(dataset, effects=[3])  # type: ignore[list-item]
    assert calib.diagnose(dataset, effects=[TransmissionError], max_steps=0).calibration.model.family_names == (HIDDEN,)


def test_robots_are_taken_by_name_file_or_folder(tmp_path: Path) -> None:
    panda = calib.load_robot("panda")
    assert calib.load_robot(panda) is panda
    assert calib.load_robot("Panda") == panda
    assert calib.load_robot(CELL) == calib.load_dataset(CELL).robot
    for suffix in (".urdf", ".toml", ".yaml"):
        calib.save_robot("panda", tmp_path / f"robot{suffix}")
        assert calib.load_robot(tmp_path / f"robot{suffix}").n_joints == 7
    with pytest.raises(CalibError, match=r"pandaa: no such file or folder; .* rb5 or panda"):
        calib.load_robot("pandaa")
    with pytest.raises(CalibError, match=r"ends in \.toml or \.urdf"):
        calib.save_robot(panda, tmp_path / "robot.step")
    assert calib.simulate_dataset("panda", rng=0, poses=5).dataset.robot.n_joints == 7


@pytest.mark.parametrize(
    ("keywords", "says"),
    [
        ({"residual": "positon"}, "option residual: found 'positon'; expected .* most like 'position'"),
        ({"prior": 1}, "option prior: found 1; expected True or False"),
        ({"fixed": "d5"}, "option fixed: found 'd5'; expected a list"),
        ({"fixed": [5]}, "option fixed: found"),
        ({"tolerances": {"a2": -0.1}}, "tolerance of a2: found -0.1; a size above 0"),
        ({"tolerances": ["a2"]}, "option tolerances: found"),
        ({"robust": "yes"}, "option robust: found 'yes'"),
        ({"noise": 0.1}, "option noise: found 0.1; expected a NoiseShape"),
    ],
)
def test_an_impossible_option_is_refused_at_once(keywords: Any, says: str) -> None:
    with pytest.raises(FitError, match=says):
        FitOptions(**keywords)
    with pytest.raises(FitError, match=says):
        calib.diagnose("not even read", **keywords)


def test_options_are_keywords_too(dataset: calib.Dataset) -> None:
    fit = calib.calibrate(dataset, FitOptions("pairs", fixed=("d5",)), fixed=["d4"], prior=False)
    assert fit.options == FitOptions("pairs", fixed=("d4",), prior=False)
    with pytest.raises(FitError, match="no option named 'loss'; the options of a fit are residual, prior"):
        calib.calibrate(dataset, loss="huber")  # type: ignore[call-arg]


def test_three_planes_meet_in_a_point() -> None:
    met = calib.intersect_planes([[2, 0, 0], [0, 1, 0], [0, 0, 1]], [1, -2, 300], np.diag([1e-4, 4e-4, 9e-4]))
    np.testing.assert_allclose(met.xyz_mm, [1.0, -2.0, 300.0])
    np.testing.assert_allclose(met.covariance_mm2, np.diag([1e-4, 4e-4, 9e-4]), atol=1e-12)
    assert calib.intersect_planes(np.eye(3), [1, 2, 3]).covariance_mm2 is None
    with pytest.raises(CalibError, match="no single point"):
        calib.intersect_planes([[1, 0, 0], [1, 0, 0], [0, 0, 1]], [1, 2, 3])
    with pytest.raises(CalibError, match="normal of length 0"):
        calib.intersect_planes(np.zeros((3, 3)), [1, 2, 3])


# ---- what results do with themselves --------------------------------------------------------------------------------


@pytest.mark.parametrize("which", ["fit", "found"])
def test_a_result_does_everything_with_itself(which: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    result: calib.Calibration | calib.Diagnosis = request.getfixturevalue(which)
    count = len(result.calibration.fit.parameters)
    assert list(result.parameters["name"]) == [p.name for p in result.calibration.fit.parameters]
    assert result.covariance.shape == (count, count)
    assert result.summary()
    assert result.to_dict()
    assert len(result.to_frame())
    result.save(tmp_path / "model.json")
    loaded = calib.load_model(tmp_path / "model.json")
    q = result.calibration.dataset.poses.q[:5]
    np.testing.assert_allclose(result.predict(q), loaded.predict(q), atol=1e-12)
    corrected = result.correct(q)
    np.testing.assert_array_equal(corrected.q, loaded.correct(q).q)
    for source in (result, loaded):
        assert np.array_equal(calib.corrected_joints(CELL, source, q).q, corrected.q)
    np.testing.assert_allclose(loaded.covariance, result.covariance, rtol=1e-6, atol=1e-15)
    assert loaded.parameters["change"].to_numpy() == pytest.approx(result.parameters["change"].to_numpy())
    assert result.robot == loaded.robot
    for suffix in (".toml", ".urdf"):
        result.save_robot(tmp_path / f"robot{suffix}")
        assert calib.load_robot(tmp_path / f"robot{suffix}").n_joints == 6
    calib.save_model(loaded, tmp_path / "again.json")
    again, first = (json.loads((tmp_path / name).read_text()) for name in ("again.json", "model.json"))
    assert again["parameters"] == first["parameters"]
    assert isinstance(calib.compare(result, CELL), calib.Comparison)
    with pytest.raises(FitError, match="leave out x and known"):
        calib.corrected_joints(CELL, result, q, x=[0.0])


# ---- representations ------------------------------------------------------------------------------------------------


def test_a_representation_says_what_the_value_is(fit: calib.Calibration, found: calib.Diagnosis) -> None:
    assert (
        repr(fit) == "Calibration(hidden_effect_a: 64 poses, test RMSE 2.32 -> 0.0999 mm, effects: transmission_error)"
    )
    assert repr(found.residual_tests).startswith("ResidualTests(lack_of_fit_p=")
    assert sys.getsizeof(repr(found)) < 400
