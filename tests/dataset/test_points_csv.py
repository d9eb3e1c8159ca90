"""points.csv: warnings on other units and copied rows, errors on covariances that no instrument has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from calib.dataset.dataset import Dataset, Points
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.errors import DatasetError
from tests.support.arms import dataset_of, jang_arm, park_arm, perturbed
from tests.support.changed import with_poses, with_xyz


def measured(arm: str = "jang", seed: int = 0) -> Dataset:
    """Dataset of an arm whose links are off by some tenths of a millimetre."""
    rng = np.random.default_rng(seed)
    robot = jang_arm() if arm == "jang" else park_arm(arm)
    return dataset_of(robot, perturbed(robot, rng), rng, poses=12, test=3, noise_mm=0.03)


def with_points(dataset: Dataset, xyz_mm: np.ndarray) -> Dataset:
    return with_xyz(dataset, xyz_mm)


def warnings_of(folder: Path, dataset: Dataset) -> Sequence[str]:
    write_dataset(dataset, folder)
    return load_dataset(folder).warnings


@pytest.mark.parametrize("arm", ["jang", "panda"])
@pytest.mark.parametrize(
    ("in_mm", "says"),
    [
        (1000.0, "look like metres, multiply them by 1000"),
        (25.4, "look like inches, multiply them by 25.4"),
        (10.0, "look like centimetres, multiply them by 10"),
        (0.001, "look like micrometres, multiply them by 0.001"),
    ],
)
def test_another_unit_is_told_and_nothing_is_scaled(tmp_path: Path, arm: str, in_mm: float, says: str) -> None:
    dataset = measured(arm)
    turn = Rotation.from_rotvec([0.3, -2.0, 1.0]).as_matrix()
    xyz = (dataset.points.xyz_mm @ turn.T + [1500.0, -200.0, 3000.0]) / in_mm
    (warning,) = warnings_of(tmp_path, with_points(dataset, xyz))
    assert says in warning
    assert str(tmp_path / "points.csv") in warning
    loaded = load_dataset(tmp_path).points
    np.testing.assert_array_equal(loaded.xyz_mm, xyz)


def test_two_setups_far_apart_are_millimetres_all_the_same(tmp_path: Path) -> None:
    """The distance between two setups is no part of the points' spread."""
    dataset = measured()
    poses = replace(dataset.poses, setup=np.array(["left", "right"] * (len(dataset.poses) // 2)))
    far = np.where(poses.setup[dataset.points.pose] == "right", 1e6, 0.0)[:, None]
    dataset = with_points(replace(dataset, poses=poses), dataset.points.xyz_mm + far)
    assert warnings_of(tmp_path, dataset) == ()


def test_a_copied_row_is_told_with_both_lines(tmp_path: Path) -> None:
    write_dataset(measured(), tmp_path)
    table = pd.read_csv(tmp_path / "points.csv", dtype=str)
    repeat = table.iloc[[3]].copy()
    repeat["x_mm"] = repr(float(repeat["x_mm"].iloc[0]) + 1e-9)  # a repeat that differs is a measurement
    pd.concat([table, repeat]).to_csv(tmp_path / "points.csv", index=False)
    assert load_dataset(tmp_path).warnings == ()
    text = (tmp_path / "points.csv").read_text()
    lines = text.splitlines()
    (tmp_path / "points.csv").write_text(text + "\n" + lines[4] + "\n")  # an empty line before it counts too
    (warning,) = load_dataset(tmp_path).warnings
    assert f"line {len(lines) + 2} has the coordinates of line 5 to the last digit; a second" in warning
    (tmp_path / "points.csv").write_text(text + lines[4] + "\n" + lines[4] + "\n" + lines[6] + "\n")
    (warning,) = load_dataset(tmp_path).warnings
    assert "to the last digit and 2 more rows do alike" in warning


def test_the_same_coordinates_at_another_pose_are_a_copy_too_but_not_of_another_target(
    tmp_path: Path,
) -> None:
    dataset = measured()
    xyz = dataset.points.xyz_mm.copy()
    xyz[5] = xyz[2]
    (warning,) = warnings_of(tmp_path, with_points(dataset, xyz))
    assert "line 7 has the coordinates of line 4" in warning
    setup = np.full(len(dataset.poses), "left")
    setup[5] = "right"
    poses = replace(dataset.poses, setup=setup)
    assert warnings_of(tmp_path, with_points(replace(dataset, poses=poses), xyz)) == ()


def test_places_that_many_poses_share_are_sockets_and_no_copies(tmp_path: Path) -> None:
    dataset = measured()
    xyz_mm = dataset.points.xyz_mm.copy()
    half = len(xyz_mm) // 2
    xyz_mm[:half], xyz_mm[half:] = (0.0, 0.0, 0.0), (500.0, 0.0, 0.0)
    assert not [w for w in warnings_of(tmp_path, with_points(dataset, xyz_mm)) if "last digit" in w]
    still = with_poses(dataset, q=np.repeat(dataset.poses.q[:1], len(xyz_mm), axis=0))
    assert "last digit" in " ".join(warnings_of(tmp_path, with_points(still, xyz_mm)))


def with_sigmas(dataset: Dataset, sigma_mm: Sequence[float], row: int) -> Dataset:
    """The dataset with covariances of 0.03 mm, except `row`, which has the given sigmas along its own axes."""
    points = dataset.points
    covariance = np.tile(0.03**2 * np.eye(3), (len(points), 1, 1))
    turn = Rotation.from_rotvec([0.4, 0.7, -0.2]).as_matrix()
    covariance[row] = turn @ np.diag(np.square(sigma_mm)) @ turn.T
    return dataset.with_points(Points(points.pose, points.xyz_mm, points.target, covariance))


@pytest.mark.parametrize(
    ("sigma_mm", "says"),
    [
        (
            (1e-12, 1e-12, 1e-12),
            "found a sigma of 1e-12 mm in one direction; a sigma lies between 1e-08 and 1000 mm",
        ),
        ((5e3, 6e3, 7e3), "found a sigma of 5e+03 mm in one direction"),
        ((0.1, 0.1, 1e-9), "the covariance is not positive definite"),  # flat but for rounding
    ],
)
def test_a_covariance_that_no_instrument_has(tmp_path: Path, sigma_mm: Sequence[float], says: str) -> None:
    write_dataset(with_sigmas(measured(), sigma_mm, 4), tmp_path)
    with pytest.raises(DatasetError) as caught:
        load_dataset(tmp_path)
    assert f"points.csv: line 6, column sxx_mm2 ... szz_mm2: {says}" in str(caught.value)


@pytest.mark.parametrize("sigma_mm", [(2e-8, 2e-8, 2e-8), (900.0, 900.0, 900.0), (1e-4, 10.0, 3.0)])
def test_a_covariance_that_one_may_have_is_read(tmp_path: Path, sigma_mm: Sequence[float]) -> None:
    write_dataset(with_sigmas(measured(), sigma_mm, 4), tmp_path)
    loaded = load_dataset(tmp_path).points
    found = np.sqrt(np.linalg.eigvalsh(loaded.covariance_mm2[4]))
    np.testing.assert_allclose(found, np.sort(sigma_mm), rtol=1e-5)


def test_a_place_beyond_any_is_refused(tmp_path: Path) -> None:
    dataset = measured()
    xyz = dataset.points.xyz_mm.copy()
    xyz[3, 1] = -1e200
    write_dataset(with_points(dataset, xyz), tmp_path)
    with pytest.raises(DatasetError, match=r"line 5, column y_mm: found -1e\+200 mm, beyond 1000 km; correct"):
        load_dataset(tmp_path)
