"""Tables in rad, in m and with quaternions in another order: declared, by column names, mixed, and doubtful."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from calib import calibrate
from calib.dataset.dataset import Dataset, Orientations
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.errors import DatasetError
from calib.kinematics import chain as kinematics
from tests.support.arms import dataset_of, jang_arm, perturbed, random_arm

JOINTS = [f"q{k + 1}_deg" for k in range(6)]
UPPER = {"sxx": (0, 0), "sxy": (0, 1), "sxz": (0, 2), "syy": (1, 1), "syz": (1, 2), "szz": (2, 2)}


def measured(poses: int = 30) -> Dataset:
    """Dataset of a six-joint arm with full poses and covariances of the points."""
    rng = np.random.default_rng(5)
    nominal = jang_arm()
    dataset = dataset_of(nominal, perturbed(nominal, rng), rng, poses=poses, test=8)
    frames = kinematics.forward(nominal.table, dataset.poses.q, nominal.is_revolute).base_T_frame
    left, right = Rotation.random(2, random_state=6).as_matrix()
    noise = Rotation.from_rotvec(rng.normal(size=(len(dataset.poses), 3)) * 0.003).as_matrix()
    turned = left @ frames[:, -1, :3, :3] @ right @ noise
    root = rng.normal(size=(len(dataset.points), 3, 3)) * 0.05
    points = replace(
        dataset.points,
        orientations=Orientations(turned),
        covariance_mm2=root @ np.swapaxes(root, 1, 2) + 1e-4 * np.eye(3),
    )
    return replace(dataset, points=points, scanner=replace(dataset.scanner, orientation_sigma_rad=0.003))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_dataset(measured(), tmp_path)
    return tmp_path


def declare(folder: Path, **units: str) -> None:
    """Append a table [units] to dataset.toml."""
    text = "".join(f'{key} = "{value}"\n' for key, value in units.items())
    path = folder / "dataset.toml"
    path.write_text(path.read_text() + f"\n[units]\n{text}")


def in_rad_and_m(folder: Path, *, angle: bool = True, length: bool = True) -> None:
    poses, points = (pd.read_csv(folder / name) for name in ("poses.csv", "points.csv"))
    if angle:
        poses[JOINTS] = np.radians(poses[JOINTS])
        poses = poses.rename(columns={name: name.replace("_deg", "_rad") for name in JOINTS})
    if length:
        points[["x_mm", "y_mm", "z_mm"]] /= 1000.0
        points[[f"{s}_mm2" for s in UPPER]] /= 1e6
        points = points.rename(columns={c: c.replace("_mm", "_m") for c in points.columns})
    poses.to_csv(folder / "poses.csv", index=False)
    points.to_csv(folder / "points.csv", index=False)


def same(one: Dataset, other: Dataset) -> None:
    np.testing.assert_allclose(one.poses.q, other.poses.q, atol=1e-12)
    np.testing.assert_allclose(one.points.xyz_mm, other.points.xyz_mm, atol=1e-9)
    assert one.points.covariance_mm2 is not None
    assert other.points.covariance_mm2 is not None
    np.testing.assert_allclose(one.points.covariance_mm2, other.points.covariance_mm2, rtol=1e-9)
    assert list(one.poses.extra.columns) == list(other.poses.extra.columns)


@pytest.mark.parametrize("declared", [True, False])
def test_rad_and_m_are_read_as_declared_or_named_and_written_back_in_deg_and_mm(
    folder: Path, tmp_path: Path, declared: bool
) -> None:
    given = load_dataset(folder)
    in_rad_and_m(folder)
    if declared:
        declare(folder, angle="rad", length="m")
    found = load_dataset(folder)
    assert found.warnings == ()
    same(found, given)
    write_dataset(found, tmp_path / "again")
    assert "q1_deg" in (tmp_path / "again" / "poses.csv").read_text()
    assert "units" not in (tmp_path / "again" / "dataset.toml").read_text()
    same(load_dataset(tmp_path / "again"), given)
    rmse_mm = [calibrate(dataset).after.test for dataset in (given, found)]
    assert rmse_mm[1].rmse_mm == pytest.approx(rmse_mm[0].rmse_mm, rel=1e-6)


def test_a_slide_may_be_in_m(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    robot = random_arm(rng, 6, prismatic=2)
    write_dataset(dataset_of(robot, robot, rng, poses=12, test=2), tmp_path)
    given = load_dataset(tmp_path)
    poses = pd.read_csv(tmp_path / "poses.csv")
    poses["q3_mm"] /= 1000.0
    poses.rename(columns={"q3_mm": "q3_m"}).to_csv(tmp_path / "poses.csv", index=False)
    np.testing.assert_allclose(load_dataset(tmp_path).poses.q, given.poses.q, rtol=1e-12)


@pytest.mark.parametrize(
    ("units", "old", "new", "says"),
    [
        ({"angle": "rad"}, "", "", "poses.csv: line 1: found q1_deg, and [units] of dataset.toml says rad"),
        ({"length": "m"}, "", "", "points.csv: line 1: found x_mm, and [units] of dataset.toml says m"),
        ({}, "q2_deg", "q2_rad", "poses.csv: line 1: found q1_deg and q2_rad; give all of them in one unit"),
        ({}, "x_mm", "x_m", "points.csv: line 1: found y_mm and x_m; give all of them in one unit"),
        ({"angle": "grad"}, "", "", "[units].angle: found 'grad'; expected 'deg' or 'rad'"),
        ({"mass": "g"}, "", "", "[units].mass: found 'g'; there are angle, length and quaternion"),
    ],
)
def test_mixed_and_contradicted_units_are_refused(
    folder: Path, units: dict[str, str], old: str, new: str, says: str
) -> None:
    if old:
        for name in ("poses.csv", "points.csv"):
            path = folder / name
            path.write_text(path.read_text().replace(old, new, 1))
    if units:
        declare(folder, **units)
    with pytest.raises(DatasetError) as caught:
        load_dataset(folder)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_covariance_of_another_unit_than_the_points_is_refused(folder: Path) -> None:
    path = folder / "points.csv"
    header, _, rest = path.read_text().partition("\n")
    for name in UPPER:
        header = header.replace(f"{name}_mm2", f"{name}_m2")
    path.write_text(f"{header}\n{rest}")
    with pytest.raises(DatasetError, match="found x_mm and sxx_m2; give all of them in one unit, mm or m"):
        load_dataset(folder)


def test_a_declared_unit_that_the_numbers_do_not_have_is_doubted(folder: Path) -> None:
    for name, old, new in (("poses.csv", "_deg", "_rad"), ("points.csv", "_mm", "_m")):
        header, _, rest = (folder / name).read_text().partition("\n")
        (folder / name).write_text(f"{header.replace(old, new)}\n{rest}")
    points = pd.read_csv(folder / "points.csv").drop(columns=[f"{name}_m2" for name in UPPER])
    points.to_csv(folder / "points.csv", index=False)
    declare(folder, angle="rad", length="m")
    assert "rad; these look like degrees, not radians" in " ".join(load_dataset(folder).warnings)


# ---- quaternions ----------------------------------------------------------------------------------------------------


def reorder(folder: Path, header: str, held: str) -> None:
    """Reorder the quaternion columns of points.csv: `header` their names from left to right, `held` their content."""
    points = pd.read_csv(folder / "points.csv")
    parts = {part: points.pop(f"q{part}") for part in "wxyz"}
    for name, part in zip(header, held, strict=True):
        points[f"q{name}"] = parts[part]
    points.to_csv(folder / "points.csv", index=False)


@pytest.mark.parametrize(
    ("header", "held", "declared"),
    [
        ("xyzw", "xyzw", ""),
        ("xyzw", "xyzw", "xyzw"),
        ("wxyz", "xyzw", "xyzw"),
        ("xyzw", "wxyz", "wxyz"),
        ("wxyz", "wxyz", "wxyz"),
    ],
)
def test_a_quaternion_is_read_by_its_columns_names_or_in_the_declared_order(
    folder: Path, header: str, held: str, declared: str
) -> None:
    given = load_dataset(folder).points
    reorder(folder, header, held)
    if declared:
        declare(folder, quaternion=declared)
    dataset = load_dataset(folder)
    assert dataset.warnings == ()
    np.testing.assert_allclose(dataset.points.orientations.scanner_R_jig, given.orientations.scanner_R_jig, atol=1e-12)


@pytest.mark.parametrize(("header", "held"), [("wxyz", "xyzw"), ("xyzw", "wxyz")])
def test_an_order_that_fits_the_nominal_arm_far_better_is_told_with_its_number(
    folder: Path, header: str, held: str
) -> None:
    reorder(folder, header, held)
    (warning,) = load_dataset(folder).warnings
    assert f'write quaternion = "{held}" under [units] in dataset.toml' in warning
    read, fits = (float(part.split()[-1]) for part in warning.split(" deg")[:2])
    assert read > 45.0
    assert fits < 1.0  # 0.3 deg of noise about an arm within 0.2 deg of its table
    declare(folder, quaternion=held)
    assert load_dataset(folder).warnings == ()


def test_the_other_order_is_told_where_attitudes_hardly_vary_or_points_miss_the_nominal_arm(
    folder: Path,
) -> None:
    """For a prism that always faces the tracker both orders fit, with different poses of the scanner."""
    dataset = load_dataset(folder)
    arm = dataset.robot
    rng = np.random.default_rng(2)
    q = dataset.poses.q.copy()
    q[:, :3] = rng.uniform(-1.0, 1.0, (len(q), 3))
    held = kinematics.forward(arm.table, q, arm.is_revolute)
    facing = replace(
        dataset.points,
        xyz_mm=held.target_mm,
        orientations=Orientations(held.base_T_frame[:, -1, :3, :3]),
    )
    write_dataset(replace(dataset, poses=replace(dataset.poses, q=q), points=facing), folder)
    reorder(folder, "wxyz", "xyzw")
    assert any('quaternion = "xyzw"' in warning for warning in load_dataset(folder).warnings)
    points = pd.read_csv(folder / "points.csv")
    points["x_mm"] += 500.0 * rng.normal(size=len(points))
    points.to_csv(folder / "points.csv", index=False)
    assert any('quaternion = "xyzw"' in warning for warning in load_dataset(folder).warnings)


def test_orientations_that_fit_in_no_order_or_are_few_are_not_doubted(folder: Path) -> None:
    reorder(folder, "wxyz", "xyzw")
    points = pd.read_csv(folder / "points.csv")
    points.loc[6:, ["qw", "qx", "qy", "qz"]] = np.nan
    points.to_csv(folder / "points.csv", index=False)
    assert load_dataset(folder).warnings == ()
    random = Rotation.random(len(points), random_state=1).as_quat()
    points[["qw", "qx", "qy", "qz"]] = random
    points.to_csv(folder / "points.csv", index=False)
    assert load_dataset(folder).warnings == ()
