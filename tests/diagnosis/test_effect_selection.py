"""Effects added one by one: the diagnosis' own step, by name, and again from names and sizes alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib import diagnose
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.effect_selection import calibrate_with, candidate_of, recalled
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import add_in_turn
from calib.errors import CalibError
from tests.support.hidden_dataset import HIDDEN, write_hidden


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return load_dataset(write_hidden(Path(tmp_path_factory.mktemp("hidden"))))


@pytest.fixture(scope="module")
def found(dataset: Dataset) -> Diagnosis:
    return diagnose(dataset)


@pytest.mark.slow
def test_names_and_sizes_alone_bring_the_same_fit_back(dataset: Dataset) -> None:
    added = add_in_turn(dataset, [HIDDEN])[-1].selected
    again = recalled(dataset, HIDDEN, dict(added[0].prior_sigmas))
    assert again == added[0]
    few = {name: size for name, size in added[0].prior_sigmas.items() if ".J2." in name}
    assert [(m.joint, m.order) for m in recalled(dataset, HIDDEN, few).members] == [(1, 1), (1, 2), (1, 3)]  # type: ignore[attr-defined]
    first, second = calibrate_with(dataset, added), calibrate_with(dataset, [again])
    assert np.array_equal(first.fit.x, second.fit.x)


@pytest.mark.parametrize(
    ("name", "says"), [("rust", "no effect named 'rust'"), ("scanner_scale", "cannot be fitted here")]
)
def test_what_cannot_be_added_is_refused_before_the_work(dataset: Dataset, name: str, says: str) -> None:
    with pytest.raises(CalibError, match=says):
        add_in_turn(dataset, [HIDDEN, name])
    with pytest.raises(CalibError, match=says):
        recalled(dataset, name, {f"{name}.x": 1.0})


def test_only_candidates_are_candidate_of(found: Diagnosis) -> None:
    ranked = found.screenings[0]
    assert candidate_of(ranked, HIDDEN) is ranked.candidates[0]
    with pytest.raises(CalibError, match="not among the candidates: transmission_error"):
        candidate_of(ranked, "rust")
    with pytest.raises(CalibError, match="none is ranked yet"):
        candidate_of(None, HIDDEN)


@pytest.mark.parametrize(
    ("sizes", "says"),
    [
        ({}, "no size for any of its parameters"),
        ({"transmission_error.J9.sin1_rad": 1e-4}, "no parameter 'transmission_error.J9.sin1_rad'"),
        ({"transmission_error.J2.sin1_rad": 1e-4}, "no size for transmission_error.J2.cos1_rad"),
        ({"transmission_error.J2.sin1_rad": 0.0, "transmission_error.J2.cos1_rad": 1e-4}, "above 0"),
        ({"transmission_error.J2.sin1_rad": float("nan"), "transmission_error.J2.cos1_rad": 1e-4}, "above 0"),
    ],
)
def test_sizes_that_cannot_be_are_refused(dataset: Dataset, sizes: dict[str, float], says: str) -> None:
    with pytest.raises(CalibError, match=says):
        recalled(dataset, HIDDEN, sizes)
