"""The exported table: best alone, and the error that it says is the one that the file has."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate
from calib.calibration.evaluation import evaluate
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import load_robot_toml, robot_to_toml
from calib.effects.catalogue import effects_named
from calib.errors import FitError
from calib.fitting.model import geometric_model
from calib.models.exported_table import exported_table
from calib.options import FitOptions
from calib.rendering.numbers import length
from calib.simulation.simulate import simulate_dataset

BENDING = "joint_compliance"  # of which link errors take up a good part


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return simulate_dataset("rb5", rng=8, effects=[(BENDING, 8.0)], poses=45).dataset


@pytest.fixture(scope="module")
def full(dataset: Dataset) -> Calibration:
    return calibrate(dataset, effects=effects_named(dataset, [BENDING]))


def held_out_mm(path: Path, dataset: Dataset) -> float:
    """Held-out RMSE, mm, of the table in a file."""
    model = geometric_model(load_robot_toml(path))
    found = evaluate(model, np.zeros(len(model.parameters)), dataset).test
    return found.rmse_mm


def test_the_file_holds_the_table_that_is_best_alone_and_says_its_error(
    dataset: Dataset, full: Calibration, tmp_path: Path
) -> None:
    table = exported_table(full)
    path, beside = tmp_path / "robot.toml", tmp_path / "beside.toml"
    path.write_text(table.to_toml())
    beside.write_text(robot_to_toml(full.robot))  # link errors as they were fitted beside the effect
    alone = held_out_mm(path, dataset)
    assert alone == pytest.approx(table.errors.test.rmse_mm, rel=1e-9)
    assert alone < held_out_mm(beside, dataset)
    assert full.after.test.rmse_mm < alone
    first = path.read_text().splitlines()[0]
    assert first.startswith("# the table alone, fitted without joint_compliance: ")
    assert f"test RMSE {length(alone)}" in first
    assert f"test RMSE {length(full.after.test.rmse_mm)}" in first
    assert table.robot == calibrate(dataset).robot


def test_without_effects_the_file_is_the_fitted_table_and_no_more(dataset: Dataset) -> None:
    plain = calibrate(dataset)
    assert exported_table(plain).to_toml() == robot_to_toml(plain.robot)
    assert exported_table(plain).comment == ""


@pytest.mark.slow
def test_the_table_is_fitted_as_was_asked(dataset: Dataset, full: Calibration) -> None:
    asked = FitOptions(fixed=("d5", "a2", f"{BENDING}.J2.c_rad_per_nm"), tolerances={"a3": 0.1}, robust=True)
    fit = calibrate(dataset, asked, effects=effects_named(dataset, [BENDING]))
    table = exported_table(fit, calibrate(dataset))  # a fit with other options does not count
    expected = calibrate(dataset, replace(asked, fixed=("d5", "a2"))).robot
    np.testing.assert_array_equal(table.robot.table, expected.table)
    known = calibrate(dataset)
    assert exported_table(full, known).links is known


def test_where_every_link_error_is_held_the_table_stays_nominal(dataset: Dataset) -> None:
    held = FitOptions(fixed=dataset.robot.parameter_names)
    table = exported_table(calibrate(dataset, held, effects=effects_named(dataset, [BENDING])))
    assert table.robot == dataset.robot
    assert table.errors is table.full.before


def test_a_name_of_the_users_cannot_break_out_of_the_comment(dataset: Dataset, full: Calibration) -> None:
    member = replace(full.model.added_effects[0])
    object.__setattr__(member, "name", "mine\n[tool]\na_mm = 1")
    effects = (full.model.effects[0], member)
    renamed = replace(full, model=replace(full.model, effects=effects))
    lines = exported_table(renamed).to_toml().splitlines()
    assert lines[0].startswith("# ")
    assert lines[1].startswith("name = ")


def test_a_table_that_is_worse_alone_is_refused(dataset: Dataset, full: Calibration) -> None:
    table = exported_table(full)
    worse = replace(table, links=replace(table.links, after=table.links.before))
    with pytest.raises(FitError, match="got worse"):
        worse.require_improvement()
    worse.require_improvement(force=True)
