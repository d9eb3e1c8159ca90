"""The dataset folder: round trip, and a one-line error for each mistake."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calib.dataset.dataset import About, Dataset, Orientations, Points, Scanner
from calib.dataset.files.folder import find_datasets, load_dataset, write_dataset
from calib.errors import DatasetError
from calib.jig import Jig
from tests.support.arms import dataset_of, jang_arm


def full_dataset(seed: int = 0) -> Dataset:
    """A dataset with every optional part."""
    rng = np.random.default_rng(seed)
    robot = jang_arm()
    base = dataset_of(robot, robot, rng, poses=8, test=2)
    n = len(base.poses)
    poses = replace(
        base.poses,
        setup=np.array(["left", "right"] * (n // 2)),
        payload_kg=rng.uniform(0, 5, n),
        temperature_c=rng.uniform(15, 30, n),
        time_s=np.sort(rng.uniform(0, 1e4, n)),
        approach=rng.choice([-1.0, 1.0], (n, 6)),
        scan_names=tuple(f"scan {i}.ply" for i in range(n)),
        extra=pd.DataFrame({"operator": ["a", "b"] * (n // 2), "humidity": rng.uniform(0, 1, n)}),
    )
    measured = np.repeat(np.arange(n), 2)
    xyz = rng.normal(size=(2 * n, 3)) * 300
    spread = rng.normal(size=(2 * n, 3, 3))
    covariance = spread @ np.swapaxes(spread, 1, 2) + np.eye(3)
    return replace(
        base,
        poses=poses,
        points=Points(measured, xyz, np.full(2 * n, "jig"), covariance),
        description='with "quotes" and ü',
        scanner=Scanner(0.05, 0.02, {"serial": 7}),
        jig=Jig(
            edge_mm=(30.0, 50.0, 70.5) if n % 2 else 50.0,
            convex=False,
            face_angles_deg=(90.01, 89.99, 90.0),
            certified=True,
        ),
        extra={"site": "hall 3", "jig": {"material": "steel"}},
        about=About("SN 0042", "Ä. Müller", "hall 3", "2026-03-14", {"order": 17}),
    )


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_round_trip_loses_nothing(seed: int) -> None:
    import tempfile

    dataset = full_dataset(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "cell 1"
        write_dataset(dataset, folder)
        again = load_dataset(folder)
    np.testing.assert_allclose(again.poses.q, dataset.poses.q, rtol=1e-14)
    np.testing.assert_array_equal(again.points.xyz_mm, dataset.points.xyz_mm)
    np.testing.assert_array_equal(again.points.covariance_mm2, dataset.points.covariance_mm2)
    for name in ("ids", "scan_names"):
        assert getattr(again.poses, name) == getattr(dataset.poses, name)
    for name in ("role", "setup", "payload_kg", "temperature_c", "time_s", "approach"):
        np.testing.assert_array_equal(getattr(again.poses, name), getattr(dataset.poses, name))
    pd.testing.assert_frame_equal(again.poses.extra.frame, dataset.poses.extra.frame, check_dtype=False)
    for name in ("name", "description", "scanner", "jig", "robot", "extra", "about"):
        assert getattr(again, name) == getattr(dataset, name)


def test_writing_twice_gives_the_same_bytes(tmp_path: Path) -> None:
    write_dataset(full_dataset(), tmp_path / "a")
    write_dataset(load_dataset(tmp_path / "a"), tmp_path / "b")
    for path in sorted((tmp_path / "a").iterdir()):
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    robot = jang_arm()
    write_dataset(dataset_of(robot, robot, np.random.default_rng(1), poses=6, test=1), tmp_path / "cell")
    return tmp_path / "cell"


def edit(name: str, old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1))

    return change


def cell(name: str, row: int | slice, column: str, value: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        frame = pd.read_csv(folder / name, dtype=str)
        frame.loc[row, column] = value
        frame.to_csv(folder / name, index=False)

    return change


def drop_row(name: str, row: int) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        pd.read_csv(folder / name, dtype=str).drop(index=row).to_csv(folder / name, index=False)

    return change


def drop_column(name: str, column: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        pd.read_csv(folder / name, dtype=str).drop(columns=column).to_csv(folder / name, index=False)

    return change


@pytest.mark.parametrize(
    ("break_it", "says"),
    [
        (lambda f: (f / "dataset.toml").unlink(), ["dataset.toml", "no such file"]),
        (lambda f: (f / "robot.toml").unlink(), ["robot.toml", "no such file"]),
        (lambda f: (f / "poses.csv").unlink(), ["poses.csv", "no such file"]),
        (lambda f: (f / "points.csv").unlink(), ["points.csv", "no such file"]),
        (lambda f: (f / "poses.csv").write_text(""), ["poses.csv", "empty"]),
        (lambda f: (f / "poses.csv").write_bytes(b"\xff\xfe\x00bad"), ["poses.csv"]),
        (edit("dataset.toml", "format = 1", "format = 2"), ["dataset.toml", "format", "reads format = 1"]),
        (edit("dataset.toml", 'points = "points.csv"\n', ""), ["neither points nor scans"]),
        (edit("dataset.toml", '"poses.csv"', '"../poses.csv"'), ["poses", "not below"]),
        (edit("dataset.toml", "edge_mm = 60.0", "edge_mm = 0.06"), ["edge_mm", "looks like metres"]),
        (edit("dataset.toml", "edge_mm = 60.0", "edge_mm = -60.0"), ["edge_mm", "above 0"]),
        (edit("dataset.toml", "edge_mm = 60.0", "edge_mm = [70, 110]"), ["edge_mm", "three"]),
        (edit("dataset.toml", "edge_mm = 60.0", "edge_mm = [70, 0, 160]"), ["edge_mm", "above 0"]),
        (edit("dataset.toml", "edge_mm = 60.0", "edge_mm = [70, 0.1, 160]"), ["edge_mm", "metres"]),
        (edit("dataset.toml", "edge_mm = 60.0", "edge_mm = [7, 110, 160]"), ["edge_mm", "10 times"]),
        (edit("dataset.toml", "point_sigma_mm = 0.05", "point_sigma_mm = 0"), ["point_sigma_mm", "above 0"]),
        (drop_column("poses.csv", "q3_deg"), ["poses.csv", "missing column q3_deg"]),
        (drop_column("points.csv", "z_mm"), ["points.csv", "missing column z_mm"]),
        (drop_row("poses.csv", 3), ["points.csv", "line 5", "'p0003' is not in poses.csv"]),
        (cell("poses.csv", 2, "pose", "p0001"), ["line 4, column pose", "stands in line 3 too"]),
        (cell("poses.csv", 0, "role", "train"), ["found 0 reference poses (none)"]),
        (cell("poses.csv", 2, "role", "reference"), ["found 2 reference poses (line 2, line 4)"]),
        (cell("poses.csv", 2, "role", "training"), ["line 4, column role", "found 'training'"]),
        (cell("poses.csv", 3, "q2_deg", "nan"), ["line 5, column q2_deg", "finite"]),
        (cell("poses.csv", 3, "q2_deg", "ten"), ["line 5, column q2_deg", "found 'ten'"]),
        (cell("poses.csv", 3, "q2_deg", ""), ["line 5, column q2_deg", "empty"]),
        (cell("points.csv", 1, "y_mm", "inf"), ["line 3, column y_mm", "finite"]),
        (cell("points.csv", 1, "target", "smr9"), ["line 3, column target", "robot.toml knows jig"]),
    ],
)
def test_each_mistake_is_one_line_that_names_its_place(
    folder: Path, break_it: Callable[[Path], None], says: list[str]
) -> None:
    if "target" in str(says):
        frame = pd.read_csv(folder / "points.csv", dtype=str)
        frame["target"] = "jig"
        frame.to_csv(folder / "points.csv", index=False)
    break_it(folder)
    with pytest.raises(DatasetError) as caught:
        load_dataset(folder)
    message = str(caught.value)
    for part in says:
        assert part in message
    assert "\n" not in message
    assert str(folder) in message


@pytest.mark.parametrize(
    ("break_it", "says"),
    [
        (
            edit("dataset.toml", 'robot = "robot.toml"', 'robot = "a\\u0000b"'),
            "robot: found 'a\\x00b'; a text of one line without",
        ),
        (
            edit("dataset.toml", 'name = "test"', 'name = "two\\nlines"'),
            r"name: found 'two\nlines'; a text of one line",
        ),
        (
            edit("dataset.toml", "format = 1\n", ""),
            "format: the key is missing; this program reads format = 1",
        ),
        (
            edit("dataset.toml", "edge_mm = 60.0", "edge_mm = 1e300"),
            "found 1e+300 mm; an edge has 10000 mm at most",
        ),
        (
            cell("poses.csv", 2, "pose", "two\nlines"),
            r"line 5, column pose: found 'two\nlines'; a name is one line",
        ),
        (
            cell("points.csv", 2, "pose", "x" * 500),
            f"line 4, column pose: '{'x' * 60}' ... is not in poses.csv",
        ),
        (
            cell("poses.csv", 2, "q3_deg", "-1e6"),
            "line 4, column q3_deg: found -1e+06, beyond -100000 to 100000",
        ),
    ],
)
def test_what_would_be_no_single_line_or_no_place_is_refused(
    folder: Path, break_it: Callable[[Path], None], says: str
) -> None:
    break_it(folder)
    with pytest.raises(DatasetError) as caught:
        load_dataset(folder)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("column", "value"), [("time_s", "1.7e12"), ("temperature_c", "-300"), ("payload_kg", "1e9")])
def test_a_condition_of_another_unit_is_refused(folder: Path, column: str, value: str) -> None:
    """Milliseconds since 1970, temperatures below absolute zero and impossible payloads raise errors."""
    frame = pd.read_csv(folder / "poses.csv", dtype=str)
    frame[column] = "20"
    frame.loc[3, column] = value
    frame.to_csv(folder / "poses.csv", index=False)
    with pytest.raises(DatasetError, match=rf"line 5, column {column}: found .*, beyond .*; correct it; the unit"):
        load_dataset(folder)


def test_a_link_in_a_circle_is_told(folder: Path) -> None:
    (folder / "poses.csv").unlink()
    (folder / "poses.csv").symlink_to("poses.csv")
    with pytest.raises(DatasetError, match=r"poses: found 'poses\.csv', which is not below"):
        load_dataset(folder)


def test_a_folder_of_scans_that_is_missing_is_warned_of_where_there_are_points(folder: Path) -> None:
    edit("dataset.toml", 'points = "points.csv"', 'points = "points.csv"\nscans = "nowhere"')(folder)
    (warning,) = load_dataset(folder).warnings
    assert "dataset.toml: scans: found 'nowhere', no such folder" in warning


def test_a_covariance_that_is_none_is_refused(tmp_path: Path) -> None:
    write_dataset(full_dataset(), tmp_path)
    cell("points.csv", 4, "szz_mm2", "-1.0")(tmp_path)
    with pytest.raises(DatasetError, match=r"line 6.*not positive definite"):
        load_dataset(tmp_path)


def test_an_approach_is_minus_one_or_one(tmp_path: Path) -> None:
    write_dataset(full_dataset(), tmp_path)
    cell("poses.csv", 4, "approach2", "0")(tmp_path)
    with pytest.raises(DatasetError, match=r"line 6, column approach2: found 0; expected -1 or 1"):
        load_dataset(tmp_path)


def test_a_payload_is_not_negative(tmp_path: Path) -> None:
    write_dataset(full_dataset(), tmp_path)
    cell("poses.csv", 4, "payload_kg", "-0.5")(tmp_path)
    with pytest.raises(DatasetError, match=r"line 6, column payload_kg: found -0\.5, beyond 0 to 100000; correct"):
        load_dataset(tmp_path)


def test_a_file_in_the_place_of_the_folder_is_told(folder: Path) -> None:
    with pytest.raises(DatasetError, match=r"poses\.csv: is a file; name the folder"):
        load_dataset(folder / "poses.csv")


def test_radians_and_metres_are_warned_of(folder: Path) -> None:
    frame = pd.read_csv(folder / "poses.csv")
    for k in range(6):
        frame[f"q{k + 1}_deg"] = np.radians(frame[f"q{k + 1}_deg"])
    frame.to_csv(folder / "poses.csv", index=False)
    points = pd.read_csv(folder / "points.csv")
    points[["x_mm", "y_mm", "z_mm"]] /= 1000
    points.to_csv(folder / "points.csv", index=False)
    warnings = " ".join(load_dataset(folder).warnings)
    assert "look like radians" in warnings
    # Angles of 3 degrees leave the arm where it is, so metres show only with poses that differ.
    frame[[f"q{k + 1}_deg" for k in range(6)]] *= 57.3
    frame.to_csv(folder / "poses.csv", index=False)
    assert "look like metres" in " ".join(load_dataset(folder).warnings)


def test_a_missing_scan_and_one_outside_the_folder(folder: Path) -> None:
    edit("dataset.toml", 'points = "points.csv"', 'scans = "scans"')(folder)
    with pytest.raises(DatasetError, match=r"dataset\.toml: scans: found 'scans', no such folder"):
        load_dataset(folder)
    (folder / "scans").mkdir()
    with pytest.raises(DatasetError, match=r"line 2, column pose: no such scan as .*p0000\.ply"):
        load_dataset(folder)
    (folder / "scans" / "p0000.ply").mkdir()
    with pytest.raises(DatasetError, match=r"line 2, column pose: .*p0000\.ply is a folder"):
        load_dataset(folder)
    frame = pd.read_csv(folder / "poses.csv", dtype=str)
    frame["scan"] = "../../secret.ply"
    frame.to_csv(folder / "poses.csv", index=False)
    with pytest.raises(DatasetError, match=r"line 2, column scan.*leaves the dataset's folder"):
        load_dataset(folder)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        (
            "point_sigma_mm",
            "1e-12",
            "found 1e-12 mm; a sigma lies between 1e-06 and 1000 mm; leave the line out",
        ),
        ("point_sigma_mm", "1001.0", "found 1001 mm; a sigma lies between"),
        ("scan_sigma_mm", "9e-7", "found 9e-07 mm; a sigma lies between"),
        ("scan_sigma_mm", "1e300", "found 1e+300 mm; a sigma lies between"),
        ("orientation_sigma_deg", "1e-9", "found 1e-09 deg; a sigma lies between 1e-06 and 90 deg"),
        ("orientation_sigma_deg", "91", "found 91 deg; a sigma lies between"),
    ],
)
def test_a_sigma_that_no_instrument_has_is_refused(folder: Path, key: str, value: str, says: str) -> None:
    edit("dataset.toml", "point_sigma_mm = 0.05", f"{key} = {value}")(folder)
    with pytest.raises(DatasetError) as caught:
        load_dataset(folder)
    assert f"dataset.toml: [scanner].{key}: {says}" in str(caught.value)


@pytest.mark.parametrize("sigma", ["1e-06", "1000.0"])
def test_the_least_and_the_most_sigma_are_read(folder: Path, sigma: str) -> None:
    edit("dataset.toml", "point_sigma_mm = 0.05", f"point_sigma_mm = {sigma}")(folder)
    assert load_dataset(folder).scanner.point_sigma_mm == float(sigma)


def test_datasets_are_found_here_or_one_folder_below(tmp_path: Path, folder: Path) -> None:
    assert find_datasets(folder) == [folder]
    assert find_datasets(tmp_path) == [folder]
    with pytest.raises(DatasetError, match="no such folder"):
        find_datasets(tmp_path / "none")
    (tmp_path / "empty").mkdir()
    with pytest.raises(DatasetError, match=r"found no dataset\.toml"):
        find_datasets(tmp_path / "empty")


# ---- full poses -----------------------------------------------------------------------------------------------------


def with_orientations(dataset: Dataset, seed: int) -> Dataset:
    """The dataset with full poses and joint covariances of all six errors; the third point has no orientation."""
    rng = np.random.default_rng(seed)
    count = len(dataset.points)
    root = rng.normal(size=(count, 6, 6)) * np.array([0.05, 0.05, 0.05, 1e-4, 1e-4, 1e-4])[:, None]
    whole = root @ np.swapaxes(root, 1, 2)
    turned = Rotation.random(count, random_state=seed).as_matrix()
    turned[2] = np.nan
    orientations = Orientations(turned, whole[:, 3:, 3:], whole[:, :3, 3:])
    points = replace(dataset.points, covariance_mm2=whole[:, :3, :3], orientations=orientations)
    scanner = replace(dataset.scanner, orientation_sigma_rad=2e-4)
    return replace(dataset, points=points, scanner=scanner)


def test_full_poses_come_back_from_the_file(tmp_path: Path) -> None:
    dataset = with_orientations(full_dataset(3), 4)
    write_dataset(dataset, tmp_path)
    back = load_dataset(tmp_path)
    given, found = dataset.points.orientations, back.points.orientations
    assert found.known.tolist() == [row != 2 for row in range(len(dataset.points))]
    np.testing.assert_allclose(found.scanner_R_jig, given.scanner_R_jig, atol=1e-14)
    known = found.known
    for name in ("covariance_rad2", "cross_mm_rad"):
        np.testing.assert_array_equal(getattr(found, name)[known], getattr(given, name)[known])
    assert back.scanner.orientation_sigma_rad == pytest.approx(2e-4)
    part = found.select(known)
    assert len(part.scanner_R_jig) == known.sum()
    assert part.known.all()


@pytest.mark.parametrize(
    ("column", "value", "says"),
    [
        ("qw", "2.0", "a quaternion of length"),
        ("qw", "", "column qw: the cell is empty"),
        ("rxx_rad2", "-1e-8", "column rxx_rad2 ... rzz_rad2: the covariance is not positive definite"),
        ("x_rx_mm_rad", "1.0", "column sxx_mm2 ... z_rz_mm_rad: the covariance is not positive definite"),
        ("qy", "north", "column qy: found 'north'; a number is needed"),
    ],
)
def test_a_bad_orientation_is_one_line_with_its_place(tmp_path: Path, column: str, value: str, says: str) -> None:
    write_dataset(with_orientations(full_dataset(5), 6), tmp_path)
    table = pd.read_csv(tmp_path / "points.csv", dtype=str)
    table.loc[4, column] = value
    table.to_csv(tmp_path / "points.csv", index=False)
    with pytest.raises(DatasetError) as raised:
        load_dataset(tmp_path)
    assert "line 6" in str(raised.value)
    assert says in str(raised.value)
    assert "\n" not in str(raised.value)


def test_part_of_the_columns_is_told(tmp_path: Path) -> None:
    write_dataset(with_orientations(full_dataset(5), 6), tmp_path)
    table = pd.read_csv(tmp_path / "points.csv", dtype=str)
    for missing in ("qz", "rzz_rad2", "z_rz_mm_rad"):
        table.drop(columns=missing).to_csv(tmp_path / "points.csv", index=False)
        with pytest.raises(DatasetError, match=f"missing column {missing}"):
            load_dataset(tmp_path)


def test_what_is_told_about_a_measurement_is_read(folder: Path) -> None:
    assert load_dataset(folder).about == About()
    with (folder / "dataset.toml").open("a") as file:
        file.write('\n[about]\nserial = "SN 0042"\nsite = "hall 3"\ndate = 2026-03-14\norder = 17\n')
    about = load_dataset(folder).about
    assert about == About(serial="SN 0042", site="hall 3", date="2026-03-14", extra={"order": 17})


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ("[about]\nserial = 42\n", r"\[about\]\.serial: found 42; a text in quotes is needed"),
        ("[about]\ndate = 14.03\n", r"\[about\]\.date: found 14\.03; a text in quotes is needed"),
        ("[about]\nsite = 2026-03-14\n", r"\[about\]\.site: found .*; a text in quotes is needed"),
        (
            '[about]\noperator = "two\\nlines"\n',
            r"\[about\]\.operator: found 'two\\nlines'; a text of one line",
        ),
        ('[[about]]\nserial = "a"\n', r"about: found .*; a table headed \[about\] is needed"),
    ],
)
def test_what_is_told_about_a_measurement_is_text(folder: Path, lines: str, says: str) -> None:
    with (folder / "dataset.toml").open("a") as file:
        file.write(f"\n{lines}")
    with pytest.raises(DatasetError, match=rf"dataset\.toml: {says}"):
        load_dataset(folder)
