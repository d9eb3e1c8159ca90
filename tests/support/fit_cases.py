"""Datasets that tests of fits share: all conditions, full poses, covariances; and a check of a residual's gradient."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import frames
from calib.dataset.dataset import Dataset, Orientations, Points, Poses
from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.effect import Effect, Family, full_name
from calib.effects.state import Seen
from calib.fitting.model import Model
from calib.fitting.residual import Residuals
from calib.simulation.simulate import simulate_dataset
from tests.support.arms import dataset_of, perturbed

SIGMA_RAD = 1e-4  # of a measured orientation, about each axis


def rich_dataset(poses: int = 40) -> Dataset:
    """Every condition there is, so that every family has something to look at."""
    rng = np.random.default_rng(0)
    robot = builtin_robot("rb5")
    base_T_scanner = np.eye(4)
    base_T_scanner[:3, 3] = [1500.0, -200.0, 300.0]
    dataset = dataset_of(robot, perturbed(robot, rng), rng, poses=poses, noise_mm=0.05, base_T_scanner=base_T_scanner)
    n = len(dataset.poses)
    conditions = replace(
        dataset.poses,
        payload_kg=rng.choice([0.0, 2.0, 5.0], n),
        temperature_c=rng.uniform(18, 32, n),
        time_s=np.sort(rng.uniform(0, 3600, n)),
        approach=rng.choice([-1.0, 1.0], (n, robot.n_joints)),
    )
    return replace(dataset, poses=conditions)


def full_poses(seed: int, *, poses: int = 40, robot: str = "rb5", **options: object) -> Dataset:
    """A simulated arm's poses with 0.05 mm and 0.1 mrad of noise, the jig turned on the tool by a random rotation."""
    made = simulate_dataset(
        robot,
        rng=seed,
        poses=poses,
        orientation_sigma_rad=SIGMA_RAD,
        **options,  # type: ignore[arg-type]
    )
    return seated(made.dataset, Rotation.random(random_state=seed).as_matrix())


def seated(dataset: Dataset, seat: np.ndarray) -> Dataset:
    """The same measurement with the jig turned on the tool by the rotation `seat` (3, 3)."""
    given = dataset.points.orientations
    turned = replace(given, scanner_R_jig=given.scanner_R_jig @ seat)
    return dataset.with_points(replace(dataset.points, orientations=turned))


def with_pose_covariances(dataset: Dataset, rng: np.random.Generator) -> Dataset:
    """The dataset with one covariance of all six errors for each pose; every fifth pose has no orientation."""
    given = dataset.points.orientations
    root = rng.normal(size=(len(dataset.points), 6, 6)) * np.repeat([0.05, SIGMA_RAD], 3)[:, None]
    whole = root @ np.swapaxes(root, 1, 2)
    measured = given.scanner_R_jig.copy()
    measured[::5] = np.nan
    orientations = Orientations(measured, whole[:, 3:, 3:], whole[:, :3, 3:])
    points = replace(dataset.points, covariance_mm2=whole[:, :3, :3], orientations=orientations)
    return dataset.with_points(points)


def with_point_covariances(dataset: Dataset, rng: np.random.Generator) -> Dataset:
    """The dataset with a covariance of its own for each point."""
    spread = rng.normal(size=(len(dataset.points), 3, 3)) * 0.03
    covariance = spread @ np.swapaxes(spread, 1, 2) + 0.01**2 * np.eye(3)
    return dataset.with_points(Points(dataset.points.pose, dataset.points.xyz_mm, dataset.points.target, covariance))


def some_of(family: Family) -> tuple[Effect, ...]:
    """All members; of a sparse family five, evenly."""
    at = np.linspace(0, len(family.members) - 1, 5).astype(int) if family.sparse else range(len(family.members))
    return tuple(family.members[k] for k in dict.fromkeys(at))


def label(effect: Effect) -> str:
    """Names an effect in the list of tests: its first parameter."""
    return full_name(effect, effect.parameters[0])


def check_last_columns(model: Model, count: int, poses: Poses, seen: Seen | None, x: np.ndarray) -> None:
    """Check the derivatives by the model's last so many parameters by differences of place and attitude at x."""
    place, attitude, by = model.linearise_pose(x, poses, seen)
    np.testing.assert_allclose(place, model.predict(x, poses, seen=seen), atol=1e-9)
    np.testing.assert_allclose(attitude, model.state(x, poses, seen).attitude)
    for k in range(len(x) - count, len(x)):
        size = min(model.scales[k], 1.0)  # in mm and rad for an effect of its usual size, or of 1
        step = 1e-3 * size * (np.arange(len(x)) == k)
        high, low = (model.predict(x + s, poses, seen=seen) for s in (step, -step))
        np.testing.assert_allclose(by[:, :3, k] * size, (high - low) / 2e-3, atol=2e-6)
        high, low = (model.state(x + s, poses, seen).attitude for s in (step, -step))
        turn = frames.rotvec_from_rotation(high @ np.swapaxes(low, 1, 2)) / 2e-3
        np.testing.assert_allclose(by[:, 3:, k] * size, turn, atol=1e-8)


def check_gradient(residuals: Residuals, rng: np.random.Generator) -> None:
    """Check that the cost's gradient is 2 J^T r, and that the residual is the one that comes with J, away from zero."""
    scales = np.array([p.scale for p in residuals.parameters])
    x = rng.normal(size=len(scales)) * scales * 0.3
    at = residuals.linearise(x)
    gradient = 2.0 * at.jacobian.T @ at.residual
    np.testing.assert_allclose(at.residual, residuals.residual(x), atol=1e-9)
    for k in range(len(x)):
        step = np.zeros(len(x))
        step[k] = 1e-4 * scales[k]
        high, low = residuals.residual(x + step), residuals.residual(x - step)
        numeric = (high @ high - low @ low) / (2 * step[k])
        assert gradient[k] == pytest.approx(numeric, rel=1e-5, abs=1e-5 * np.abs(gradient * scales).max() / scales[k])
