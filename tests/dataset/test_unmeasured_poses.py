"""Poses without a measured point are counted and named, and left out otherwise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calib import calibrate, check, diagnose
from calib.dataset.dataset import Dataset, Scanner
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.errors import DatasetError
from calib.options import FitOptions
from calib.present.fit.calibration import calibration_warnings
from calib.present.over_time.checks import item_sentence
from tests.support.arms import dataset_of, jang_arm, perturbed


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Dataset folder of 40 poses of which 3 have no point: the reference, a training and a test pose."""
    rng = np.random.default_rng(3)
    nominal = jang_arm()
    dataset = dataset_of(nominal, perturbed(nominal, rng), rng, poses=40, test=8)
    write_dataset(dataset, tmp_path)
    return tmp_path


def hide(folder: Path, rows: list[int], *, empty: bool = False) -> Dataset:
    points = pd.read_csv(folder / "points.csv")
    if empty:
        points.loc[rows, ["x_mm", "y_mm", "z_mm"]] = np.nan
    else:
        points = points.drop(index=rows)
    points.to_csv(folder / "points.csv", index=False)
    return load_dataset(folder)


@pytest.mark.parametrize("empty", [True, False])
def test_they_are_a_note_with_their_number_and_names(folder: Path, empty: bool) -> None:
    """A missing row and a row without coordinates give the same note."""
    dataset = hide(folder, [0, 5, 39], empty=empty)
    assert dataset.warnings == ()
    (note,) = dataset.notes
    assert "no point for 3 of 40 poses, 2 to train on and 1 to test; they are left out: " in note
    assert note.endswith(", ".join(dataset.poses.ids[i] for i in (0, 5, 39)))
    assert len(dataset.points) == 37


@pytest.mark.parametrize("residual", ["position", "distance", "pairs"])
def test_every_fit_goes_on_without_them(folder: Path, residual: str) -> None:
    whole = calibrate(load_dataset(folder), FitOptions(residual)).after.test  # type: ignore[arg-type]
    result = calibrate(hide(folder, [0, 5, 39]), FitOptions(residual))  # type: ignore[arg-type]
    assert any("no point for 3 of 40" in words for words in calibration_warnings(result))
    assert result.after.test.points == whole.points - 1
    assert result.after.test.rmse_mm < 2.0 * whole.rmse_mm


@pytest.mark.slow
def test_check_and_diagnosis_take_them_as_a_note(folder: Path) -> None:
    dataset = replace(hide(folder, [5, 39]), scanner=Scanner())  # points without noise: no sigma is declared
    checked = check(dataset)
    (item,) = [item for item in checked.items if item.name == "dataset"]
    assert (item.passed, item.warning) == (None, False)
    assert "no point for 2 of 40 poses" in item_sentence(item)
    assert checked.passed
    assert diagnose(dataset).headline


def test_no_point_at_all_is_an_error(folder: Path) -> None:
    with pytest.raises(DatasetError, match="no row with a point; one row a measured point is needed"):
        hide(folder, list(range(40)), empty=True)


def test_a_coordinate_alone_is_not_left_out(folder: Path) -> None:
    points = pd.read_csv(folder / "points.csv")
    points.loc[4, "y_mm"] = np.nan
    points.to_csv(folder / "points.csv", index=False)
    with pytest.raises(DatasetError, match="line 6, column y_mm: the cell is empty"):
        load_dataset(folder)
