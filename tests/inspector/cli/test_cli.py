"""The command: its JSON's keys, its exit codes, and that bad input is one line and nothing half-written."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.files.robot_toml import load_robot_toml
from calib.models.model_file import load_model
from calib.plugins import load
from inspector.cli.commands import commands
from inspector.cli.parser import main
from tests.support.arms import dataset_of, jang_arm, perturbed
from tests.support.commands import answered, printed, refused


@pytest.fixture(scope="module")
def points_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(0)
    robot = jang_arm()
    folder = tmp_path_factory.mktemp("points") / "cell"
    write_dataset(dataset_of(robot, perturbed(robot, rng), rng, test=13, noise_mm=0.03), folder)
    return folder


@pytest.fixture(scope="module")
def scans_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scans") / "cell"
    printed("simulate", folder, "--robot", "rb5", "--poses", "4", "--scans", "--seed", "5")
    return folder


@pytest.fixture
def own_points(points_folder: Path, tmp_path: Path) -> Path:
    """A copy of the dataset of points that a test may spoil."""
    return Path(shutil.copytree(points_folder, tmp_path / "cell"))


@pytest.fixture
def own_scans(scans_folder: Path, tmp_path: Path) -> Path:
    """A copy of the dataset of scans that a test may spoil."""
    return Path(shutil.copytree(scans_folder, tmp_path / "cell"))


def change(path: Path, **columns: object) -> None:
    """Write other values into columns of a table; they may be functions of it."""
    pd.read_csv(path).assign(**columns).to_csv(path, index=False)


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert re.fullmatch(r"inspector \d+\.\d+\.\d+, Python 3\.\d+\.\d+\n", capsys.readouterr().out)


def test_calibrate_has_the_promised_keys(points_folder: Path) -> None:
    for residual in ("position", "distance"):
        document = answered("calibrate", points_folder, "--residual", residual)
        assert document["residual"] == residual
        assert document["effects"] == []
        assert document["converged"] is True
        assert document["rank"] == 19
        figures = {"rmse_mm", "max_mm", "mean_mm", "distance_max_mm", "distance_mean_mm"}
        for part in (document, document["before"]):
            assert figures <= set(part["train"])
            assert figures <= set(part["test"])
        assert document["test"]["rmse_mm"] < 0.1 < document["before"]["test"]["rmse_mm"]
        assert document["iterations"][0]["rmse_mm"] == pytest.approx(document["before"]["train"]["rmse_mm"])
        assert document["iterations"][-1]["rmse_mm"] == pytest.approx(document["train"]["rmse_mm"])
        assert document["sigma_mm"] == pytest.approx(0.03, rel=0.3)
        names = [p["name"] for p in document["parameters"]]
        assert names[:5] == ["a1", "alpha1", "d1", "theta1", "beta1"]
        assert names[-1] == "betaTCP"
        assert {"name", "value", "sigma", "unit", "nominal"} <= set(document["parameters"][0])
        assert {p["unit"] for p in document["parameters"]} == {"mm", "rad"}


def test_calibrate_writes_the_robot_that_it_found(points_folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "robot.toml"
    document = answered("calibrate", points_folder, "--out", out)
    table = load_robot_toml(out).table.ravel()
    np.testing.assert_allclose(table, [p["value"] for p in document["parameters"]], rtol=1e-12, atol=1e-15)


def test_without_a_prior_unknowable_sigmas_are_null(points_folder: Path) -> None:
    document = answered("calibrate", points_folder, "--no-prior")
    sigma = {p["name"]: p["sigma"] for p in document["parameters"]}
    assert sigma["d1"] is None
    assert sigma["a2"] is not None


def without_pose(folder: Path, pose: str) -> None:
    table = pd.read_csv(folder / "points.csv")
    table[table["pose"] != pose].to_csv(folder / "points.csv", index=False)


@pytest.mark.slow
def test_a_pose_that_is_left_out_counts_for_nothing_and_is_told(
    points_folder: Path, own_points: Path, tmp_path: Path
) -> None:
    pose = pd.read_csv(own_points / "points.csv")["pose"][20]
    without_pose(own_points, pose)
    model = tmp_path / "model.json"
    asked = ("--leave-out", pose)
    ours = answered("calibrate", points_folder, *asked, "--model-out", model)
    same = answered("calibrate", own_points)
    assert ours["parameters"] == same["parameters"]
    assert ours["test"] == same["test"]
    assert any(f"asked: {pose}" in warning for warning in ours["warnings"])
    source = json.loads(model.read_text())["dataset"]
    assert source["left_out"] == [pose]
    assert pose not in source["training_poses"]
    assert f"without {pose}" in load_model(model).summary()
    with_all, without = (answered("redundancy", points_folder, *more)["pearson"] for more in ((), asked))
    assert with_all != without
    checked = answered("check", points_folder, *asked)["calibration"]
    for document in (ours, checked, answered("redundancy", points_folder, *asked)):
        assert document["left_out"] == [pose]
    assert same["left_out"] == []
    for command in ("calibrate", "diagnose", "redundancy", "check", "validate"):
        message = refused(command, points_folder, "--leave-out", f"{pose}0")
        assert f"no pose named '{pose}0'" in message
        assert repr(pose) in message
    assert "no pose named 'nix'" in refused("calibrate", points_folder, "--leave-out", "nix")


@pytest.mark.thorough
def test_diagnose_writes_its_model_and_the_report_fits_as_asked(points_folder: Path, tmp_path: Path) -> None:
    model, page = tmp_path / "model.json", tmp_path / "report.html"
    pose = pd.read_csv(points_folder / "points.csv")["pose"][7]
    asked = ("--leave-out", pose, "--hold", "d5", "--tolerance", "a2=0.1")
    found = answered("diagnose", points_folder, *asked, "--model-out", model)
    saved = load_model(model)
    assert saved.after.test.rmse_mm == pytest.approx(found["steps"][-1]["test_rmse_mm"])
    assert saved.options.fixed == ("d5",)
    reported = answered("report", points_folder, *asked, "--out", page)
    assert reported["steps"] == found["steps"]
    assert found["left_out"] == reported["left_out"] == [pose]
    assert f"asked: {pose}" in page.read_text()
    assert f"left out: {pose}" in printed("diagnose", points_folder, *asked)
    assert answered("validate", points_folder, *asked)["left_out"] == [pose]


@pytest.mark.thorough
def test_one_point_for_all_poses_is_no_calibration_and_is_not_written(own_points: Path, tmp_path: Path) -> None:
    """A tracker that lost its target: links of no length fit it without any residual."""
    change(own_points / "points.csv", x_mm=100.0, y_mm=200.0, z_mm=300.0)
    out = tmp_path / "robot.toml"
    assert "does not describe" in refused("calibrate", own_points, "--out", out)
    assert not out.exists()
    printed("calibrate", own_points, "--out", out, "--force")
    assert out.exists()
    assert not answered("check", own_points, code=1)["passed"]


@pytest.mark.slow
def test_what_is_no_file_is_not_replaced_by_one(
    capsys: pytest.CaptureFixture[str], points_folder: Path, tmp_path: Path
) -> None:
    """An output may be a link, or a pipe as in --out >(less); a folder in its place is told."""
    kept, link, pipe = tmp_path / "kept.toml", tmp_path / "link.toml", tmp_path / "pipe"
    link.symlink_to(kept)
    assert main(["calibrate", str(points_folder), "--out", str(link)]) == 0
    assert link.is_symlink()
    assert load_robot_toml(kept).n_joints == 6
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE) as reader:
        assert main(["calibrate", str(points_folder), "--out", str(pipe)]) == 0
        assert reader.communicate()[0] == kept.read_bytes()
    assert pipe.is_fifo()
    capsys.readouterr()
    assert "is a folder" in refused("calibrate", points_folder, "--out", tmp_path)
    assert "rb5, panda" in refused("simulate", tmp_path / "new", "--robot", "rb6")


@pytest.mark.slow
def test_corners_has_the_promised_keys_and_finds_the_truth(scans_folder: Path, own_scans: Path, tmp_path: Path) -> None:
    out = tmp_path / "points.csv"
    document = answered("corners", scans_folder, "--out", out)
    truth = json.loads((scans_folder / "truth.json").read_text())["apex_mm"]
    assert document["failed"] == []
    assert [c["pose"] for c in document["corners"]] == list(truth)
    for corner in document["corners"]:
        assert np.linalg.norm(np.array(corner["xyz_mm"]) - truth[corner["pose"]]) < 0.1
        assert np.all(np.linalg.eigvalsh(corner["covariance_mm2"]) > 0)
        assert len(corner["planes"]) == 3
        for plane in corner["planes"]:
            assert np.linalg.norm(plane["normal"]) == pytest.approx(1.0)
            assert plane["rms_mm"] < 0.1
            # The corner lies on its planes (eq 2).
            assert np.dot(plane["normal"], corner["xyz_mm"]) == pytest.approx(plane["offset_mm"], abs=1e-6)
        assert corner["seconds"] > 0
    # What was written is a points.csv that a dataset reads.
    shutil.copy(out, own_scans / "points.csv")
    text = (own_scans / "dataset.toml").read_text()
    (own_scans / "dataset.toml").write_text(text.replace('scans = "scans"', 'scans = "scans"\npoints = "points.csv"'))
    points = load_dataset(own_scans).points
    np.testing.assert_allclose(points.xyz_mm, [c["xyz_mm"] for c in document["corners"]])
    assert points.covariance_mm2 is not None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "says"),
    [(b"", "empty"), (b"\x00\xff junk that is no scan at all", "PLY"), (None, "promises")],
)
def test_a_scan_file_that_cannot_be_read_is_a_failed_search_beside_others_and_bad_input_alone(
    own_scans: Path, tmp_path: Path, content: bytes | None, says: str
) -> None:
    scans = sorted((own_scans / "scans").iterdir())
    spoiled = scans[2].read_bytes()[:5000] if content is None else content
    scans[2].write_bytes(spoiled)
    out = tmp_path / "points.csv"
    document = answered("corners", own_scans, "--out", out)
    assert [corner["pose"] for corner in document["corners"]] == [s.stem for s in scans if s != scans[2]]
    (failed,) = document["failed"]
    assert failed["pose"] == scans[2].stem
    assert scans[2].name in failed["reason"]
    assert says.lower() in failed["reason"].lower()
    out.unlink()
    for scan in scans:
        scan.write_bytes(spoiled)
    line = refused("corners", own_scans, "--out", out)
    assert scans[0].name in line
    assert says.lower() in line.lower()
    assert line.endswith("; 3 further scans cannot be read")
    assert not out.exists()


@pytest.mark.slow
def test_simulate_is_reproducible_and_says_where_the_truth_is(tmp_path: Path) -> None:
    for name in ("a", "b"):
        arguments = ["--robot", "panda", "--poses", "30", "--seed", "9", "--effect", "joint_compliance"]
        document = answered("simulate", tmp_path / name / "cell", *arguments)
        assert Path(document["truth"]).is_file()
    for file in ("poses.csv", "points.csv", "robot.toml", "truth.json"):
        assert (tmp_path / "a/cell" / file).read_bytes() == (tmp_path / "b/cell" / file).read_bytes()
    assert len(load_dataset(tmp_path / "a/cell").poses) == 30
    assert "is not empty" in refused("simulate", tmp_path / "a/cell", "--robot", "rb5")
    line = refused("simulate", tmp_path / "c", "--robot", "rb5", "--effect", "magic")
    assert "magic" in line
    assert "joint_compliance" in line
    assert not (tmp_path / "c").exists()
    assert "robot.toml" in refused("simulate", tmp_path / "c", "--robot", tmp_path / "robot.toml")


@pytest.mark.slow
def test_simulated_scans_tell_how_noisy_they_are(tmp_path: Path) -> None:
    folder = tmp_path / "cell"
    printed("simulate", folder, "--robot", "rb5", "--poses", "2", "--scans")
    scanner = load_dataset(folder).scanner
    told = scanner.scan_sigma_mm, scanner.correlated_sigma_mm, scanner.correlation_length_mm
    assert told == (0.03, 0.06, 25.0)
    hidden = json.loads((folder / "truth.json").read_text())["scanner_errors"]
    assert (hidden["scan_sigma_mm"], hidden["correlated_sigma_mm"]) == told[:2]


@pytest.mark.slow
def test_check_passes_or_says_why_not(points_folder: Path) -> None:
    good = answered("check", points_folder)
    assert good["passed"] is True
    assert good["reasons"] == []
    bad = answered("check", points_folder, "--max-test-rmse-mm", "0.0001", code=1)
    assert bad["passed"] is False
    assert "was asked for" in bad["reasons"][0]
    for document in (good, bad):  # the verdict is told; it does not decide the exit code
        assert document["diagnosis"]["verdict"] == "adequate"
        assert [f["passed"] for f in document["findings"] if f["name"] == "diagnosis"] == [None]
    assert answered("check", points_folder.parent)["passed"] is True


@pytest.mark.parametrize("command", ["corners", "redundancy", "calibrate", "check", "serve"])
def test_a_folder_that_is_none_is_one_line(tmp_path: Path, command: str) -> None:
    missing = tmp_path / "nowhere"
    captured = refused(command, missing)
    assert str(missing) in captured


@pytest.mark.slow
def test_too_few_poses_and_an_unwritable_place(points_folder: Path, own_points: Path, tmp_path: Path) -> None:
    for name in ("poses.csv", "points.csv"):
        pd.read_csv(own_points / name, dtype=str).head(6).to_csv(own_points / name, index=False)
    assert "measure at least" in refused("calibrate", own_points)
    (tmp_path / "file").write_text("x")
    line = refused("calibrate", points_folder, "--out", tmp_path / "file" / "robot.toml")
    assert str(tmp_path / "file") in line


def test_warnings_go_to_stderr_and_leave_json_alone(capsys: pytest.CaptureFixture[str], own_points: Path) -> None:
    for name in (f"q{k + 1}_deg" for k in range(6)):
        change(own_points / "poses.csv", **{name: lambda frame, name=name: np.radians(frame[name])})
    main(["redundancy", str(own_points), "--json"])
    captured = capsys.readouterr()
    json.loads(captured.out)
    assert "look like radians" in captured.err


@pytest.mark.slow
def test_a_reversed_joint_does_not_crash(capsys: pytest.CaptureFixture[str], own_points: Path, tmp_path: Path) -> None:
    """A wrong sign in the table is a common mistake: the answer is a bad error or a refusal, never a traceback."""
    change(own_points / "poses.csv", q2_deg=lambda frame: -frame["q2_deg"])
    out = tmp_path / "robot.toml"
    assert main(["check", str(own_points), "--max-test-rmse-mm", "1.0"]) == 1
    capsys.readouterr()
    code = main(["calibrate", str(own_points), "--out", str(out)])
    assert code in (0, 2)
    assert out.exists() == (code == 0)


@pytest.mark.slow
def test_a_terminal_that_lacks_a_character_gets_the_rest(points_folder: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "inspector", "calibrate", str(points_folder)],
        env=os.environ | {"PYTHONIOENCODING": "ascii"}, capture_output=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert b"as delivered ?" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["fly"], "fly"),
        ([], "COMMAND"),
        (["calibrate"], "PATH"),
        (["calibrate", "x", "--residual", "angles"], "angles"),
        (["serve", "x", "--port", "99999"], "99999 is not a port"),
        (["serve", "x", "--port", "eighty"], "eighty is not a port; 0 to 65535"),
        (["corners", "x", "--processes", "0"], "0 is not a number of processes"),
        (["check", "x", "--max-test-rmse-mm", "nan"], "nan is not an error to ask for"),
        (["check", "x", "--max-test-rmse-mm", "-1"], "-1 is not an error to ask for"),
        (["simulate", "x", "--robot", "rb5", "--poses", "many"], "many"),
    ],
)
def test_wrong_usage_is_one_line_too(capsys: pytest.CaptureFixture[str], arguments: list[str], says: str) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    assert stopped.value.code == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert says in captured.err


@pytest.fixture(scope="module")
def hidden_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hidden") / "cell"
    arguments = ["--robot", "rb5", "--poses", "64", "--seed", "21", "--effect", "transmission_error"]
    printed("simulate", folder, *arguments)
    return folder


@pytest.mark.slow
def test_diagnose_has_the_promised_keys_and_names_the_cause(hidden_folder: Path) -> None:
    document = answered("diagnose", hidden_folder)
    assert document["verdict"] == "named"
    assert document["missing"] == ["transmission_error"]
    assert document["ambiguous_set"] == []
    first, second = document["steps"]
    assert first["effect"] is None
    assert second["effect"] == "transmission_error"
    assert second["test_rmse_mm"] < 0.7 * first["test_rmse_mm"]
    assert second["p_value"] < 1e-6
    assert second["log_evidence_margin"] > 3
    best = document["candidates"][0]
    assert best["effect"] == "transmission_error"
    keys = {"p_value", "p_holm", "log_evidence", "explained_share", "cv_rmse_mm", "overlaps", "parameters"}
    assert keys <= set(best)
    assert {"name", "value", "sigma", "unit"} <= set(best["parameters"][0])
    assert "scanner_scale" in {u["effect"] for u in document["untestable"]}
    assert all(u["why"] and u["would_help"] for u in document["untestable"])
    leftover = document["leftover"]
    assert leftover["noise_from"] == "dataset"
    assert leftover["noise_mm"] == pytest.approx(0.05)
    assert {"input", "p_value"} <= set(leftover["inputs"][0])
    assert leftover["outlier_poses"] == []
    assert "transmission_error" in document["explanation"]
    brief = printed("diagnose", hidden_folder)
    assert "Verdict: What is missing is the transmission error" in brief
    assert len([line for told in brief.splitlines() for line in textwrap.wrap(told, 120)]) <= 25


@pytest.mark.slow
def test_diagnose_and_check_take_the_options_of_a_fit(points_folder: Path, hidden_folder: Path) -> None:
    """Their first fit is the one that `calibrate` makes with the same options, to the last digit."""
    fits = [
        ["--hold", "d5", "--hold", "θ4", "--tolerance", "a2=1e-9", "--robust"],
        ["--residual", "pairs", "--no-prior"],
    ]
    for options in fits:
        fitted = answered("calibrate", points_folder, *options)
        first = answered("diagnose", points_folder, "--max-steps", "0", *options)["steps"][0]
        assert first["test_rmse_mm"] == fitted["test"]["rmse_mm"]
        checked = answered("check", points_folder, *options)["calibration"]
        assert checked == {key: fitted[key] for key in checked}
        assert {"parameters", "test"} <= set(checked)
    given = ["--effect", "transmission_error"]
    with_effect = answered("check", hidden_folder, *given)
    assert with_effect["calibration"]["effects"] == ["transmission_error"]
    assert with_effect["diagnosis"]["missing"] == []
    assert "no parameter named 'b7'" in refused("diagnose", hidden_folder, "--hold", "b7")
    assert "rust" in refused("check", hidden_folder, "--effect", "rust")


@pytest.mark.slow
def test_add_is_the_diagnosis_step_to_the_last_digit(hidden_folder: Path, tmp_path: Path) -> None:
    diagnosed = answered("diagnose", hidden_folder)["steps"]
    document = answered("calibrate", hidden_folder, "--add", "transmission_error")
    assert [step["effect"] for step in document["steps"]] == [None, "transmission_error"]
    for step, found in zip(document["steps"], diagnosed, strict=True):
        assert step["train"]["rmse_mm"] == pytest.approx(found["train_rmse_mm"], rel=1e-9)
        assert step["test"]["rmse_mm"] == pytest.approx(found["test_rmse_mm"], rel=1e-9)
        assert step["sigma_mm"] == pytest.approx(found["sigma_mm"], rel=1e-9)
    for name, says in (("rust", "rust"), ("scanner_scale", "cannot be fitted here")):
        robot = tmp_path / "robot.toml"
        assert says in refused("calibrate", hidden_folder, "--add", name, "--out", robot)
        assert not robot.exists()


def test_effects_lists_the_catalogue() -> None:
    effects = answered("effects")["effects"]
    assert {"joint_compliance", "axis_wobble", "scanner_scale"} <= {e["name"] for e in effects}
    for effect in effects:
        assert effect["equation"]
        assert effect["needs"]
        assert all(p["unit"] for p in effect["parameters"])
    assert "transmission_error: theta_j += A sin(n q_j)" in printed("effects")


def test_help_loads_nothing_that_it_does_not_show() -> None:
    program = (
        "import sys\nfrom inspector.cli.parser import main\ntry: main(['--help'])\nfinally: print(list(sys.modules))"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False).stdout
    loaded = said[said.rindex("[") :]
    assert "'argparse'" in loaded
    for slow in ("numpy", "scipy", "pandas", "viser", "inspector.cli.dataset_commands"):
        assert f"'{slow}'" not in loaded


def test_every_subcommand_has_the_function_that_it_names() -> None:
    assert len(commands()) > 10
    for command in commands().values():
        assert callable(load(command.run))
