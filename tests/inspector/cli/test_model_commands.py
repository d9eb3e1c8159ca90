"""`calibrate --model-out`, and the commands that use the file: the same answers without a fit, or one line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import calib
from calib.dataset.files.folder import load_dataset, write_dataset
from tests.support.changed import with_xyz
from tests.support.checked_cell import measured_twice
from tests.support.commands import answered, printed, refused
from tests.support.hidden_dataset import HIDDEN, write_hidden


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_hidden(tmp_path_factory.mktemp("data"), "cell")


@pytest.fixture(scope="module")
def model(folder: Path) -> Path:
    path = folder.parent / "new" / "model.json"
    printed("calibrate", folder, "--add", HIDDEN, "--model-out", path)
    return path


@pytest.mark.slow
def test_validate_tells_the_errors_of_the_model_as_it_is(
    folder: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fitted = answered("calibrate", folder, "--add", HIDDEN)
    found = answered("validate", folder, "--model", model)
    for key in ("before", "train", "test"):
        assert found[key] == fitted[key]
    assert found["model"]["test"] == fitted["test"]
    assert found["model"]["same_measurements"] is True
    assert found["model"]["effects"] == [HIDDEN]
    dataset = load_dataset(folder)
    assert len(found["poses"]) == len(dataset.poses)
    # On other measurements the model stays: a point that moves by 3 mm is 3 mm off, and no fit follows it.
    moved = dataset.points.xyz_mm.copy()
    row = int((dataset.points.pose == int(dataset.poses.is_test.argmax())).argmax())
    moved[row] += [3.0, 0.0, 0.0]
    write_dataset(with_xyz(dataset, moved), tmp_path / "later")
    later = answered("validate", tmp_path / "later", "--model", model)
    assert later["model"]["same_measurements"] is False
    assert later["train"] == pytest.approx(found["train"], rel=1e-9)
    assert later["test"]["max_mm"] == pytest.approx(3.0, abs=0.3)
    capsys.readouterr()
    assert "not the files" in printed("validate", tmp_path / "later", "--model", model)


@pytest.mark.slow
def test_targets_lack_what_the_model_depends_on(folder: Path, tmp_path: Path) -> None:
    model, targets = tmp_path / "m.json", tmp_path / "targets.csv"
    printed("calibrate", folder, "--effect", "thermal_growth", "--model-out", model)
    pd.read_csv(folder / "poses.csv").drop(columns="temperature_c").to_csv(targets, index=False)
    line = refused("correct", folder, "--model", model, "--joints", targets, "--out", tmp_path / "c.csv")
    assert "missing column temperature_c" in line
    assert not (tmp_path / "c.csv").exists()


@pytest.mark.slow
def test_a_model_is_not_fitted_again_nor_overwritten(folder: Path, model: Path) -> None:
    for extra in (["--robust"], ["--effect", HIDDEN], ["--hold", "a2"], ["--no-prior"], ["--folds", "3"]):
        line = refused("validate", folder, "--model", model, *extra)
        assert f"leave out {extra[0]}" in line
    before = model.read_bytes()
    targets = folder / "poses.csv"
    line = refused("correct", folder, "--model", model, "--joints", targets, "--out", model)
    assert "this command reads" in line
    assert model.read_bytes() == before


def test_a_damaged_model_is_one_line(folder: Path, model: Path, tmp_path: Path) -> None:
    damaged, out = tmp_path / "m.json", tmp_path / "c.csv"
    document = json.loads(model.read_text())
    for content, says in (
        (model.read_text()[:-40], "not valid JSON"),
        (json.dumps({**document, "table": 3}), "table: found 3"),
        (
            json.dumps({**document, "effects": [{"family": "x", "fields": {}}]}),
            "effects[0].family: found 'x'",
        ),
    ):
        damaged.write_text(content)
        assert says in refused("validate", folder, "--model", damaged)
        line = refused("correct", folder, "--model", damaged, "--joints", folder / "poses.csv", "--out", out)
        assert line.startswith(f"inspector: {damaged}: ")
    assert "no such model file" in refused("validate", folder, "--model", tmp_path / "none.json")
    assert not out.exists()


@pytest.mark.slow
def test_no_model_is_written_for_a_fit_that_is_no_improvement(folder: Path, tmp_path: Path) -> None:
    spoiled, out = tmp_path / "cell", tmp_path / "m.json"
    dataset = load_dataset(folder)
    points = dataset.points
    is_test = dataset.poses.is_test[points.pose]
    off_mm = calib.calibrate(dataset).before.error_mm  # with it the nominal robot is right at the test poses
    xyz_mm = points.xyz_mm + np.where(is_test[:, None], off_mm, 0.0)
    write_dataset(dataset.with_points(replace(points, xyz_mm=xyz_mm)), spoiled)
    assert "got worse" in refused("calibrate", spoiled, "--model-out", out)
    assert not out.exists()
    printed("calibrate", spoiled, "--model-out", out, "--force")
    assert calib.load_model(out).after.test == calib.calibrate(load_dataset(spoiled)).after.test


@pytest.mark.slow
def test_compare_names_the_one_change_between_two_measurements(tmp_path: Path) -> None:
    for dataset in measured_twice(5, {"theta3": np.radians(0.03)}):
        write_dataset(dataset, tmp_path / dataset.name)
    folders = [str(tmp_path / name) for name in ("before", "after")]
    assert "zero of joint 3 (theta3)" in printed("compare", *folders)
    document = answered("compare", *folders)
    assert document["differs"]
    assert [change["parameter"] for change in document["changes"]] == ["theta3"]
    assert document["changes"][0]["size"] == pytest.approx(np.radians(0.03), abs=np.radians(0.006))
    assert document["errors"][1]["after"]["test"]["rmse_mm"] < document["errors"][1]["before"]["test"]["rmse_mm"]
    assert "nowhere" in refused("compare", folders[0], tmp_path / "nowhere")
