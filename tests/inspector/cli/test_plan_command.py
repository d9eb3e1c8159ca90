"""`plan`: the promised JSON, a poses.csv that loads, and one line where it cannot be done."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calib.dataset.files.folder import load_dataset, write_dataset
from calib.simulation.simulate import simulate_dataset
from inspector.cli.parser import main
from tests.support.commands import answered, printed, refused


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cell") / "cell"
    made = simulate_dataset("rb5", rng=4, poses=45, effects=("joint_compliance",))
    write_dataset(made.dataset, folder)
    return folder


@pytest.mark.slow
def test_the_next_poses_of_a_dataset(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "next.csv"
    arguments = ["plan", str(folder), "--add", "3", "--out", str(out), "--effect", "joint_compliance"]
    document = answered(*arguments)
    assert [pose["pose"] for pose in document["poses"]] == ["p46", "p47", "p48"]
    assert {"pose", "q", "why"} <= set(document["poses"][0])
    assert document["settles"] is None
    errors = document["predicted_test_rmse_mm"]
    assert errors["then"] < errors["now"]
    assert document["band_90_mm"]["then"][0] < errors["then"] < document["band_90_mm"]["then"][1]
    assert document["model"] == ["joint_compliance"]
    table, measured = pd.read_csv(out), pd.read_csv(folder / "poses.csv")
    assert list(table.columns) == list(measured.columns)
    assert set(table["role"]) == {"train"}
    np.testing.assert_array_equal(table[document["columns"]], [pose["q"] for pose in document["poses"]])
    pd.concat([measured, table]).to_csv(folder / "poses.csv", index=False)
    assert len(load_dataset(folder).poses) == 48  # points of the new poses may come later
    measured.to_csv(folder / "poses.csv", index=False)
    assert main(arguments) == 0
    text = capsys.readouterr().out
    assert "rank" in text
    assert "9 test poses (I-optimal)" in text


@pytest.mark.slow
def test_what_is_missing_is_diagnosed_first(folder: Path) -> None:
    document = answered("plan", folder, "--add", "2")
    assert document["model"] == ["joint_compliance"]
    assert "model is that of the diagnosis" in document["notes"][0]


@pytest.mark.slow
def test_a_first_set_for_a_robot(tmp_path: Path) -> None:
    out = tmp_path / "poses.csv"
    place = ["--scanner", "1200,0,520,400,0,400", "--noise-mm", "0.02"]
    text = printed("plan", "RB5", "--poses", "16", "--out", out, *place)
    assert "16 poses for RB5-850" in text
    assert "20 µm per coordinate" in text
    table = pd.read_csv(out)
    assert table["pose"].tolist() == [f"p{k:02d}" for k in range(1, 17)]
    assert table["role"].tolist() == ["reference", *["train"] * 15]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["rb5", "--add", "3"], "--poses"),
        (["rb5", "--for", "jelly"], "no effect named 'jelly'"),
        (["rb5", "--for", ","], "effects with commas between"),
        (["rb5", "--effect", "backlash"], "name those that you suspect with --for"),
        (["nothing.urdf"], "nothing.urdf: no such file or folder; give a dataset's folder"),
    ],
)
def test_what_cannot_be_planned_is_one_line(arguments: list[str], said: str) -> None:
    captured = refused("plan", *arguments)
    assert said in captured


@pytest.mark.parametrize("place", ["1,2", "here", "1,2,nan"])
def test_a_place_is_three_or_six_numbers(place: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["plan", "rb5", "--scanner", place])
    assert "give X,Y,Z in mm" in capsys.readouterr().err


@pytest.mark.slow
def test_candidates_of_the_users_own_keep_their_names_and_joints(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    measured, offered, out = pd.read_csv(folder / "poses.csv"), tmp_path / "offered.csv", tmp_path / "chosen.csv"
    assert main(["plan", "rb5", "--candidates", str(folder / "poses.csv"), "--poses", "12", "--out", str(out)]) == 0
    chosen = pd.read_csv(out).set_index("pose")
    joints = [column for column in chosen if column.startswith("q")]
    np.testing.assert_allclose(chosen[joints], measured.set_index("pose").loc[chosen.index, joints], atol=1e-9)
    capsys.readouterr()
    asked = ["plan", str(folder), "--effect", "joint_compliance", "--candidates", str(offered)]
    for table, says in (
        (measured, "all 45 poses were measured already"),
        (measured.assign(q1_deg=measured["q1_deg"] + 1.0), "'p01' was measured at other joints"),
        (measured.assign(pose="x"), "'x' stands there twice"),
    ):
        table.to_csv(offered, index=False)
        assert main(asked) == 2
        assert says in capsys.readouterr().err
