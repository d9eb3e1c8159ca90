"""Import of a robot and a user's tables: names and units recognised, faults listed, no partial dataset written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.dataset_import.columns import parsed_mapping, recognise
from calib.errors import DatasetError
from calib.simulation.simulate import simulate_dataset
from tests.support.commands import answered, printed
from tests.support.imported import Imported, import_dataset

ROBOT = builtin_robot("rb5")
Q = [f"q{k}" for k in range(1, 7)]


@pytest.fixture(scope="module")
def truth() -> Dataset:
    return simulate_dataset(ROBOT, rng=0, poses=32, noise_mm=0.02).dataset


def write(
    path: Path, header: list[str], rows: np.ndarray, separator: str = ",", first: list[str] | None = None
) -> Path:
    lines = [separator.join(header)] if header else []
    for i, row in enumerate(rows):
        cells = [repr(float(v)) for v in row]
        if separator == ";":
            cells = [cell.replace(".", ",") for cell in cells]
        lines.append(separator.join([*([first[i]] if first else []), *cells]))
    path.write_text("\n".join(lines) + "\n")
    return path


def both(dataset: Dataset, angle: float, length: float) -> np.ndarray:
    return np.hstack([dataset.poses.q * angle, dataset.points.xyz_mm * length])


RAD = 1.0


def test_a_fit_runs_at_once(truth: Dataset, tmp_path: Path) -> None:
    header = [*Q, "x", "y", "z"]
    made = import_dataset(tmp_path / "cell", ROBOT, write(tmp_path / "log.csv", header, both(truth, RAD, 1e-3)))
    roles = made.dataset.poses.role.tolist()
    assert roles.count("reference") == 1
    assert roles.count("test") == 8
    fitted = calibrate(made.dataset)
    assert fitted.after.test.rmse_mm < 0.2
    assert made.dataset.scanner.point_sigma_mm is None
    assert "times the declared" not in fitted.summary()  # there is none to compare with
    assert "times the declared" in calibrate(truth).summary()


def test_lengths_of_wires_and_signals_are_taken(truth: Dataset, tmp_path: Path) -> None:
    n, anchor_mm = len(truth.poses), np.array([1800.0, -400.0, 250.0])
    lengths_m = 1e-3 * np.linalg.norm(truth.points.xyz_mm - anchor_mm, axis=1)
    joints = np.column_stack([np.degrees(truth.poses.q), np.degrees(truth.poses.q[:, 1]) + 0.01, np.arange(n)])
    names = [f"P{i}" for i in range(n)]
    write(tmp_path / "joints.csv", ["pose", *Q, "link_q2_deg", "load_left_q1_deg"], joints, first=names)
    lines = [f"{name},east,{length!r}" for name, length in zip(names, lengths_m.tolist(), strict=True)]
    (tmp_path / "wires.csv").write_text("\n".join(["pose,anchor,length_m", *lines]) + "\n")
    asked = ["--joints", str(tmp_path / "joints.csv"), "--points", str(tmp_path / "wires.csv"), "--sigma", "0.05"]
    printed("import", tmp_path / "cell", "--robot", "rb5", *asked)
    dataset = load_dataset(tmp_path / "cell")
    np.testing.assert_allclose(dataset.points.lengths.length_mm, 1e3 * lengths_m)
    assert set(dataset.points.lengths.anchor) == {"east"}
    assert [encoder.joint for encoder in dataset.robot.link_encoders] == [1]
    assert "load_left_q1_deg" in dataset.poses.extra.names


def test_words_of_another_language_name_poses_and_conditions() -> None:
    names = [
        "Messpunkt",
        *(f"Achse {k} [°]" for k in range(1, 7)),
        "Temperatur [°C]",
        "Zeit [s]",
        "Last [kg]",
    ]
    found = recognise(names, ROBOT, {})
    assert not found.faults
    assert found.columns["pose"].name == "Messpunkt"
    assert [found.columns[f"q{k}"].name for k in range(1, 7)] == names[1:7]
    assert (found.columns["temperature_c"].name, found.columns["time_s"].name) == tuple(names[7:9])
    assert found.rest == ("Last [kg]",)


def test_other_columns_are_kept_and_roles_are_read(truth: Dataset, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = both(truth, RAD, 1.0)
    lines = [",".join([*Q, "x", "y", "z", "split", "hall humidity"])]
    lines += [
        ",".join([*map(str, row), "validation" if i > 25 else "Training", str(40 + i)]) for i, row in enumerate(rows)
    ]
    path.write_text("\n".join(lines))
    made = import_dataset(tmp_path / "cell", ROBOT, path)
    assert made.dataset.poses.role.tolist() == ["reference", *["train"] * 25, *["test"] * 6]
    assert made.dataset.poses.extra["hall humidity"].tolist() == list(range(40, 72))


def test_points_that_were_not_measured_are_left_out(truth: Dataset, tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", [*Q, "x", "y", "z"], both(truth, RAD, 1.0))
    lines = path.read_text().splitlines()
    lines[1] = ",".join([*lines[1].split(",")[:6], "", "", ""])
    path.write_text("\n".join(lines))
    made = import_dataset(tmp_path / "cell", ROBOT, path)
    assert made.dataset.points is not None
    assert len(made.dataset.points) == 31
    assert made.dataset.poses.role[1] == "reference"


def refusal(tmp_path: Path, run: Callable[[], Imported]) -> str:
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(DatasetError) as caught:
        run()
    assert sorted(tmp_path.rglob("*")) == before
    return str(caught.value)


def test_all_faults_are_told_at_once_and_nothing_is_written(truth: Dataset, tmp_path: Path) -> None:
    ids = [f"p{i}" for i in range(32)]
    ids[4] = "p3"
    joints = write(tmp_path / "joints.csv", ["pose", *Q], truth.poses.q, first=ids)
    joints.write_text(joints.read_text().replace(repr(float(truth.poses.q[9, 2])), "n/a"))
    points = write(
        tmp_path / "points.csv",
        ["pose", "x", "y", "z"],
        truth.points.xyz_mm,
        first=[*ids[:20], "p99", *ids[21:]],
    )
    said = refusal(tmp_path, lambda: import_dataset(tmp_path / "cell", ROBOT, joints, points))
    assert said.startswith("nothing was written, 2 faults:")
    assert "joints.csv: line 11, column q3: found 'n/a'; a number is needed" in said
    assert "joints.csv: line 6: pose 'p3' stands in line 5 too" in said


def test_names_are_found_by_their_values_and_nests_belong_to_no_pose(truth: Dataset, tmp_path: Path) -> None:
    ids, number = [f"PT{i:03d}" for i in range(32)], np.arange(32.0)[:, None]
    joints = write(tmp_path / "joints.csv", ["Waypoint", *Q], truth.poses.q, first=ids)
    xyz = np.vstack([truth.points.xyz_mm[:20], [[3889.9, -160.1, 74.6]], truth.points.xyz_mm[20:]])
    named = [*ids[:20], "NEST1", *ids[20:]]
    points = write(tmp_path / "points.csv", ["Point Name", "X (mm)", "Y (mm)", "Z (mm)"], xyz, first=named)
    document = answered("import", tmp_path / "cell", "--joints", joints, "--points", points, "--robot", "rb5")
    why = "its name is no pose of joints.csv"
    assert document["left_out"] == [{"file": "points.csv", "row": 22, "name": "NEST1", "why": why}]
    assert any(note.endswith("1 point belongs to no pose and is left out: NEST1") for note in document["recognised"])
    dataset = load_dataset(tmp_path / "cell")
    assert dataset.poses.ids == tuple(ids)
    assert np.allclose(dataset.points.xyz_mm, truth.points.xyz_mm, atol=1e-6)
    strange = write(tmp_path / "strange.csv", ["Point Name", "x", "y", "z"], xyz, first=[f"N{i}" for i in range(33)])
    said = refusal(tmp_path, lambda: import_dataset(tmp_path / "b", ROBOT, joints, strange))
    assert "column Point Name: 33 of 33 names ('N0'," in said
    rows = write(tmp_path / "rows.csv", ["Row", *Q], np.hstack([number, truth.poses.q]))
    places = write(tmp_path / "places.csv", ["Row", "x", "y", "z"], np.hstack([number, truth.points.xyz_mm]))
    assert not any("visits" in note for note in import_dataset(tmp_path / "c", ROBOT, rows, places).notes)


@pytest.mark.slow
def test_what_is_not_clear_is_asked_for(truth: Dataset, tmp_path: Path) -> None:
    rows = both(truth, RAD, 1.0)
    few = write(tmp_path / "few.csv", ["q1", "q2", "x", "y", "z"], rows[:, :5])
    assert "6 columns of joints are needed, q1 to q6" in refusal(
        tmp_path, lambda: import_dataset(tmp_path / "b", ROBOT, few)
    )
    poses = write(tmp_path / "poses.csv", ["X [mm]", "Y [mm]", "Z [mm]", "A [deg]", "B [deg]", "C [deg]"], rows[:, :6])
    assert "the joints' values are needed" in refusal(tmp_path, lambda: import_dataset(tmp_path / "b", ROBOT, poses))
    odd = write(tmp_path / "odd.csv", [*Q, "x", "y", "z"], rows * [1, 1, 1, 1, 1, 1, 5, 5, 5])
    assert "--map 'x=x_mm'" in refusal(tmp_path, lambda: import_dataset(tmp_path / "b", ROBOT, odd))
    wrong = write(tmp_path / "wrong.csv", ["q1_mm", *Q[1:], "x", "y", "z"], rows)
    assert "mm is no unit of joint 1" in refusal(tmp_path, lambda: import_dataset(tmp_path / "b", ROBOT, wrong))
    short = write(tmp_path / "short.csv", ["x", "y", "z"], rows[:5, 6:])
    long = write(tmp_path / "long.csv", Q, rows[:, :6])
    assert "has 5 rows" in refusal(tmp_path, lambda: import_dataset(tmp_path / "b", ROBOT, long, short))
    assert "give --points" in refusal(tmp_path, lambda: import_dataset(tmp_path / "b", ROBOT, long))
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "a").write_text("")
    assert "not empty" in refusal(tmp_path, lambda: import_dataset(tmp_path / "full", ROBOT, long))


@pytest.mark.parametrize("pair", ["q1", "=q1", "a=", "a=q0", "a=weight", "a=q1_kg_m"])
def test_a_mapping_is_column_and_meaning(pair: str) -> None:
    with pytest.raises(DatasetError, match="expected column=meaning"):
        parsed_mapping([pair])


@pytest.mark.slow
def test_what_our_own_tables_hold_comes_through_as_it_was(tmp_path: Path) -> None:
    """Orientations, payload, setups and further conditions are imported by the format's own column names."""
    given = simulate_dataset(
        ROBOT,
        rng=5,
        poses=24,
        payloads_kg=(0.0, 3.0),
        setups=2,
        orientation_sigma_rad=1e-4,
        effects=["backlash"],
    ).dataset
    write_dataset(given, tmp_path / "given")
    tables = (tmp_path / "given" / "poses.csv", tmp_path / "given" / "points.csv")
    made = import_dataset(tmp_path / "cell", ROBOT, *tables)
    for name in ("payload_kg", "approach"):
        mine, theirs = getattr(made.dataset.poses, name), getattr(given.poses, name)
        assert (mine is None) == (theirs is None)
        if theirs is not None:
            assert mine.tolist() == theirs.tolist()
    assert made.dataset.poses.setup.tolist() == given.poses.setup.tolist()
    assert made.dataset.poses.role.tolist() == given.poses.role.tolist()
    turned, as_given = made.dataset.points.orientations.scanner_R_jig, given.points.orientations.scanner_R_jig
    assert turned == pytest.approx(as_given, abs=1e-12)
    assert made.dataset.points.target.tolist() == given.points.target.tolist()


def test_scans_of_any_suffix_find_their_poses(tmp_path: Path) -> None:
    sample = Path(__file__).parents[2] / "sample_data" / "rb5_jang"
    lines = (sample / "poses.csv").read_text().splitlines()
    (tmp_path / "scans").mkdir()
    for line in lines[1:5]:
        name = line.split(",")[0]
        (tmp_path / "scans" / f"{name}.xyz").write_text("1 2 3\n4 5 6\n")
    (tmp_path / "joints.csv").write_text("\n".join(lines[:5]))
    made = import_dataset(tmp_path / "cell", ROBOT, tmp_path / "joints.csv", scans=tmp_path / "scans")
    assert made.dataset.poses.scan_names == tuple(f"{line.split(',')[0]}.xyz" for line in lines[1:5])
    assert (tmp_path / "cell" / "scans" / made.dataset.poses.scan_names[0]).is_file()
    (tmp_path / "joints.csv").write_text("\n".join(lines[:7]))
    fewer = import_dataset(tmp_path / "b", ROBOT, tmp_path / "joints.csv", scans=tmp_path / "scans")
    assert fewer.dataset.poses.scan_names == made.dataset.poses.scan_names
    assert any("2 poses without a scan" in note for note in fewer.notes)
    for k, path in enumerate(sorted((tmp_path / "scans").iterdir())):
        path.rename(path.with_name(f"view{'abcdefg'[k]}.xyz"))
    with pytest.raises(DatasetError, match="no scan is named as its poses are"):
        import_dataset(tmp_path / "c", ROBOT, tmp_path / "joints.csv", scans=tmp_path / "scans")
    assert not (tmp_path / "c").exists()
