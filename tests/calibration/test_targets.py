"""Further targets, such as mirrors without faces: their unknown places are part of a fit."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate, diagnose, redundancy
from calib.calibration.pose_errors import pose_errors_of
from calib.dataset.dataset import Dataset, Points
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.files.robot_toml import builtin_robot, load_robot_toml, robot_to_toml
from calib.effects.catalogue import effects_for
from calib.errors import DatasetError, FitError
from calib.fitting.observations import Observations
from calib.fitting.residual_kinds import make_residuals
from calib.identifiability.structural import free_frame_rank
from calib.kinematics.robot import Robot, Target, Tool
from calib.options import FitOptions
from tests.support.arms import dataset_of, elementary_points, perturbed, random_transform
from tests.support.changed import with_xyz
from tests.support.fit_cases import check_gradient

SIGMA_MM = 0.05
LAST_ROW = tuple(f"{kind}6" for kind in ("a", "alpha", "d", "theta", "beta"))
MIRRORS = (
    Target("smr1", (80.0, 0.0, 40.0)),
    Target("smr2", (-30.0, 70.0, 60.0)),
    Target("smr3", (-40.0, -60.0, 90.0)),
)


def with_tip(robot: Robot, xyz_mm: np.ndarray) -> Robot:
    """The robot with a tool row, Rz(theta) Trans(a, 0, d), that ends at a point of the last joint's frame."""
    x, y, z = xyz_mm.tolist()
    return replace(robot, tool=Tool(a_mm=math.hypot(x, y), theta_rad=math.atan2(y, x), d_mm=z))


def mirror_dataset(
    seed: int, *, jig: bool, poses: int = 60, offset_mm: float = 1.0
) -> tuple[Dataset, Robot, np.ndarray]:
    """Dataset with three mirrors (and the jig) measured, each mirror 1 mm off; the true robot; the offsets (3, 3).

    The last joint's row is true, as its errors equal a common motion of all targets.
    """
    rng = np.random.default_rng(seed)
    nominal = replace(builtin_robot("rb5"), targets=MIRRORS)
    true = perturbed(nominal, rng, mm=0.5, rad=0.002)
    table = true.table
    table[5] = nominal.table[5]
    true = true.with_table(table)
    offsets = rng.normal(size=(3, 3))
    offsets *= offset_mm / np.linalg.norm(offsets, axis=1)[:, None]
    base = dataset_of(nominal, true, rng, poses=poses, test=20, sigma_mm=SIGMA_MM)
    placed = random_transform(rng)
    pose, xyz, names = [], [], []
    for k, target in enumerate(MIRRORS):
        tip = with_tip(true, np.array(target.xyz_mm) + offsets[k])
        xyz.append(elementary_points(tip, base.poses.q))
        pose.append(np.arange(poses))
        names += [target.name] * poses
    if jig:
        xyz.append(elementary_points(true, base.poses.q))
        pose.append(np.arange(poses))
        names += ["jig"] * poses
    points = np.concatenate(xyz) @ placed[:3, :3].T + placed[:3, 3]
    points += SIGMA_MM * rng.normal(size=points.shape)
    measured = Points(np.concatenate(pose), points, np.array(names))
    return replace(base.with_points(measured), jig_is_declared=False), true, offsets


@pytest.mark.parametrize("jig", [True, False])
def test_places_of_targets_are_recovered(jig: bool) -> None:
    dataset, _, offsets = mirror_dataset(3, jig=jig)
    fitted = calibrate(dataset, FitOptions(fixed=LAST_ROW))
    values = dict(zip((p.name for p in fitted.fit.parameters), fitted.fit.x, strict=True))
    found = np.array([[values[f"{t.name}.{axis}"] for axis in "xyz"] for t in MIRRORS])
    np.testing.assert_allclose(found, offsets, atol=0.15)
    sigma = dict(zip((p.name for p in fitted.fit.parameters), fitted.fit.sigma, strict=True))
    named = [sigma[f"{t.name}.{axis}"] for t in MIRRORS for axis in "xyz"]
    assert np.max(np.abs(found - offsets).ravel() / named) < 4.0
    assert fitted.after.test.rmse_mm < 1.25 * math.sqrt(3.0) * SIGMA_MM
    assert fitted.sigma_mm == pytest.approx(SIGMA_MM, rel=0.1)
    moved = {target.name: target.xyz_mm for target in fitted.robot.targets}
    for target, row in zip(MIRRORS, found, strict=True):
        np.testing.assert_allclose(moved[target.name], np.array(target.xyz_mm) + row)


def test_shape_of_the_targets_is_recovered_with_the_whole_arm_free() -> None:
    dataset, _, offsets = mirror_dataset(4, jig=True)
    fitted = calibrate(dataset)
    places = np.array([t.xyz_mm for t in fitted.robot.targets])
    true = np.array([t.xyz_mm for t in MIRRORS]) + offsets
    for i, j in ((0, 1), (0, 2), (1, 2)):
        assert np.linalg.norm(places[i] - places[j]) == pytest.approx(np.linalg.norm(true[i] - true[j]), abs=0.06)


@pytest.mark.slow
def test_targets_that_are_off_make_no_effect() -> None:
    dataset, _, _ = mirror_dataset(5, jig=True)
    found = diagnose(dataset)
    assert found.verdict == "adequate"
    assert found.missing == ()
    (bias,) = [u for u in found.screenings[0].untestable if u.name == "incidence_bias"]
    assert "no faces" in bias.why


def test_incidence_bias_is_offered_for_a_jig_alone(tmp_path: Path) -> None:
    def why_not(dataset: Dataset) -> str:
        return next(family.why_not for family in effects_for(dataset) if family.name == "incidence_bias")

    robot = builtin_robot("rb5")
    jig = dataset_of(robot, robot, np.random.default_rng(0))
    write_dataset(jig, tmp_path / "jig")
    assert why_not(load_dataset(tmp_path / "jig")) == ""
    write_dataset(replace(jig, jig_is_declared=False), tmp_path / "tracker")
    assert "[jig]" not in (tmp_path / "tracker" / "dataset.toml").read_text()
    assert "no faces" in why_not(load_dataset(tmp_path / "tracker"))
    assert why_not(replace(load_dataset(tmp_path / "tracker"), scan_folder="scans")) == ""


def elbow_dataset(seed: int, poses: int = 50) -> Dataset:
    """Dataset with the tool point and a mirror on the link of joint 4, which is where robot.toml has it."""
    rng = np.random.default_rng(seed)
    nominal = replace(builtin_robot("rb5"), targets=(Target("elbow", (60.0, -30.0, 80.0), joint=4),))
    true = perturbed(nominal, rng, mm=0.5, rad=0.002)
    base = dataset_of(nominal, true, rng, poses=poses, test=15, sigma_mm=SIGMA_MM)
    placed = random_transform(rng)
    four = with_tip(replace(true, joints=true.joints[:4], targets=()), np.array([60.0, -30.0, 80.0]))
    xyz = [elementary_points(true, base.poses.q), elementary_points(four, base.poses.q[:, :4])]
    points = np.concatenate(xyz) @ placed[:3, :3].T + placed[:3, 3]
    points += SIGMA_MM * rng.normal(size=points.shape)
    names = np.repeat(["jig", "elbow"], poses)
    return base.with_points(Points(np.tile(np.arange(poses), 2), points, names))


@pytest.mark.slow
def test_a_target_on_an_earlier_link_is_fitted_there(tmp_path: Path) -> None:
    """A target on an earlier link makes more parameters known than the tool point alone."""
    dataset = elbow_dataset(8)
    write_dataset(dataset, tmp_path)
    dataset = load_dataset(tmp_path)
    fitted = calibrate(dataset)
    assert fitted.after.test.rmse_mm < 1.25 * math.sqrt(3.0) * SIGMA_MM
    assert fitted.sigma_mm == pytest.approx(SIGMA_MM, rel=0.15)
    alone = dataset.with_points(dataset.points.select(dataset.points.target == "jig"))
    assert redundancy(dataset).rank > redundancy(alone).rank
    at_last = replace(dataset.robot, targets=(replace(dataset.robot.targets[0], joint=None),))
    wrong = calibrate(replace(dataset, robot=at_last)).after.test
    assert wrong.rmse_mm > 10.0
    check_gradient(make_residuals("position", fitted.model, Observations.of(dataset)), np.random.default_rng(1))
    assert fitted.robot.targets[0].joint == 4


def test_columns_of_a_target_on_an_earlier_link_have_the_rank_of_the_fit() -> None:
    dataset = elbow_dataset(9)
    fitted = calibrate(dataset, FitOptions(prior=False))
    rank = free_frame_rank(dataset)
    assert fitted.fit.rank == rank.here
    assert rank.best["position"] >= rank.here


@pytest.mark.parametrize("joint", ["0", "7", "2.5"])
def test_a_target_sits_on_a_joint_that_there_is(tmp_path: Path, joint: str) -> None:
    path = tmp_path / "robot.toml"
    robot = replace(builtin_robot("rb5"), targets=(Target("elbow", (60.0, -30.0, 80.0), joint=4),))
    path.write_text(robot_to_toml(robot))
    assert load_robot_toml(path).targets == robot.targets
    path.write_text(robot_to_toml(robot).replace("joint = 4", f"joint = {joint}"))
    with pytest.raises(DatasetError, match=rf"joint: found {joint}; .* 1 to 6"):
        load_robot_toml(path)


@pytest.mark.parametrize("kind", ["position", "pairs"])
def test_gradient_with_targets(kind: str) -> None:
    dataset, _, _ = mirror_dataset(6, jig=True, poses=30)
    fitted = calibrate(dataset)
    check_gradient(make_residuals(kind, fitted.model, Observations.of(dataset)), np.random.default_rng(1))


def test_distances_are_of_the_tool_point_alone() -> None:
    dataset, _, _ = mirror_dataset(7, jig=True)
    names = {p.name for p in calibrate(dataset, FitOptions(residual="distance")).fit.parameters}
    assert not any(name.startswith("smr") for name in names)
    assert not any(name.startswith("smr") for name in redundancy(dataset, residual="distance").parameters)


def test_a_target_without_points_is_no_parameter() -> None:
    dataset, _, _ = mirror_dataset(8, jig=True)
    some = dataset.with_points(dataset.points.select(dataset.points.target != "smr3"))
    names = {p.name for p in calibrate(some).fit.parameters}
    assert "smr2.z" in names
    assert "smr3.z" not in names
    assert calibrate(some).robot.targets[2] == MIRRORS[2]


@pytest.mark.slow
def test_redundancy_of_mirrors_alone() -> None:
    """Without a measured tool point its parameters have no influence, and the last row moves all mirrors together."""
    dataset, _, _ = mirror_dataset(9, jig=False)
    found = redundancy(dataset)
    assert set(found.parameters) == {
        *dataset.robot.parameter_names,
        *(f"{t.name}.{a}" for t in MIRRORS for a in "xyz"),
    }
    assert {"aTCP", "dTCP", "alphaTCP"} <= set(found.no_influence)
    residuals = make_residuals("position", calibrate(dataset).model, Observations.of(dataset))
    scales = np.array([p.scale for p in residuals.parameters])
    jacobian = residuals.linearise(np.zeros(len(scales))).jacobian * scales
    s = np.linalg.svd(jacobian, compute_uv=False)
    assert free_frame_rank(dataset).here == int(np.sum(s > 1e-9 * s[0]))
    assert free_frame_rank(dataset).best["position"] == free_frame_rank(dataset).here
    assert found.rank == free_frame_rank(dataset).here + 2  # d1 and theta1 show where the frame is known


def test_tolerance_of_a_target(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    robot = replace(builtin_robot("rb5"), targets=(replace(MIRRORS[0], tolerance_mm=2.0), MIRRORS[1]))
    path.write_text(robot_to_toml(robot))
    assert path.read_text().count("tolerance_mm") == 1
    assert load_robot_toml(path).targets == robot.targets
    path.write_text(path.read_text().replace("tolerance_mm = 2.0", "tolerance_mm = -2.0"))
    with pytest.raises(DatasetError, match="tolerance_mm"):
        load_robot_toml(path)


def test_a_wide_tolerance_lets_a_target_be_far_off() -> None:
    dataset, _, _ = mirror_dataset(10, jig=True, offset_mm=20.0)
    wide = replace(dataset, robot=replace(dataset.robot, targets=tuple(replace(t, tolerance_mm=20.0) for t in MIRRORS)))
    for fitted in (
        calibrate(wide),
        calibrate(dataset, FitOptions(tolerances={f"{t.name}.{a}": 20.0 for t in MIRRORS for a in "xyz"})),
    ):
        assert fitted.after.test.rmse_mm < 1.25 * math.sqrt(3.0) * SIGMA_MM
    with pytest.raises(FitError, match=r"smr4\.x"):
        calibrate(dataset, FitOptions(tolerances={"smr4.x": 1.0}))


def test_apparent_motion_of_a_joint_is_that_of_the_measured_targets() -> None:
    """Apparent joint motion is that of the measured mirrors, 300 mm beyond the tool's end."""
    dataset, true, _ = mirror_dataset(12, jig=False)
    far = tuple(replace(t, xyz_mm=(t.xyz_mm[0] + 300.0, t.xyz_mm[1], t.xyz_mm[2])) for t in MIRRORS)
    off_rad, k = 2e-3, 55  # a test pose, so that the fit does not bend to it
    q = dataset.poses.q.copy()
    q[k, 4] += off_rad
    xyz = np.concatenate([elementary_points(with_tip(true, np.array(t.xyz_mm)), q) for t in far])
    moved = replace(with_xyz(dataset, xyz), robot=replace(dataset.robot, targets=far))
    found = pose_errors_of(calibrate(moved, FitOptions(fixed=LAST_ROW)))
    assert found.apparent_joint_error[k, 4] == pytest.approx(off_rad, rel=0.02)
