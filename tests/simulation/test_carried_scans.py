"""Scans from a scanner on the flange: from each pose it sees the jig's three faces, and the fit reaches its bound."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from calib import calibrate, find_corners
from calib.dataset.files.folder import load_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.jig import jig_geometry
from calib.kinematics.joint_range import joint_range
from calib.measurement.measured_points import with_corners
from calib.simulation.measured_dataset import Simulation, write_simulation
from calib.simulation.scanner import ScanModel
from calib.simulation.simulate import simulate_dataset
from calib.statistics import rms_length
from calib.workcell.scan_field import JANG_FIELD

ROOT = Path(__file__).parents[2]
COARSE = ScanModel(points=4000, window_mm=90.0)


def made(arm: str, seed: int, poses: int) -> Simulation:
    robot = replace(builtin_robot(arm), carries_scanner=True)
    return simulate_dataset(robot, rng=seed, poses=poses, scans=True, scan_model=COARSE)


@pytest.mark.slow
@pytest.mark.parametrize(("arm", "seed"), [("rb5", 1), ("panda", 0)])
def test_poses_look_at_the_jig_in_the_room(arm: str, seed: int) -> None:
    simulation = made(arm, seed, 12)
    q, apex_mm = simulation.dataset.poses.q, simulation.apex_mm
    low, high = joint_range(simulation.dataset.robot)
    assert np.all((q >= low) & (q <= high))
    assert np.degrees(np.std(q, axis=0)).min() > 10.0
    sight = apex_mm / np.linalg.norm(apex_mm, axis=1, keepdims=True)
    normals = np.einsum("nij,kj->nki", simulation.scanner_T_jig[:, :3, :3], jig_geometry(simulation.dataset.jig)[1])
    incidence_deg = np.degrees(np.arccos(-np.einsum("nki,ni->nk", normals, sight)))
    assert incidence_deg.max() < JANG_FIELD.max_incidence_deg + 1.0  # the true arm is a little off the nominal one
    across_mm = np.abs(apex_mm[:, :2]) * (JANG_FIELD.distance_mm / apex_mm[:, 2:])
    assert np.all(across_mm < JANG_FIELD.half_mm + 15.0)
    for pose in (0, 11):
        label = simulation.scan(pose).label
        assert min(int(np.sum(label == face)) for face in (1, 2, 3)) > 100
        assert np.any(label == 0)  # its post and plate


@pytest.mark.slow
def test_a_jig_that_no_pose_looks_at_is_refused() -> None:
    """A wrist whose joints hardly turn looks away from every table."""
    robot = builtin_robot("rb5")
    stiff = [replace(joint, min=-0.01, max=0.01) for joint in robot.joints]
    robot = replace(robot, joints=tuple(stiff), carries_scanner=True)
    with pytest.raises(CalibError, match="no pose looks at a jig on a table before it"):
        simulate_dataset(robot, rng=0, poses=3, scans=True)


def benchmark(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    spec = importlib.util.spec_from_file_location("flange_benchmark", ROOT / "benchmarks" / "flange.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)  # where its dataclasses look for their names
    spec.loader.exec_module(module)
    return module


@pytest.mark.thorough
def test_corners_are_found_and_the_fit_is_at_its_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against the Cramer-Rao bound by differences of the simulated truth, of points with the corners' covariances."""
    simulation = made("rb5", 2, 50)
    write_simulation(simulation, tmp_path)
    dataset = load_dataset(tmp_path)
    assert dataset.robot.carries_scanner
    searches = find_corners(dataset)
    assert [search.failure for search in searches.values() if search.corner is None] == []
    dataset = with_corners(dataset, searches)
    points, test = dataset.points, dataset.poses.is_test
    assert points.covariance_mm2 is not None
    error_mm = points.xyz_mm - simulation.apex_mm
    squared = np.einsum("ni,nij,nj->n", error_mm, np.linalg.inv(points.covariance_mm2), error_mm)
    assert np.mean(squared) == pytest.approx(3.0, abs=1.5)
    result = calibrate(dataset)
    missed_mm = (points.xyz_mm + result.after.error_mm - simulation.apex_mm)[test]

    script = benchmark(monkeypatch)
    tolerance = np.array([script.TOLERANCE_MM, script.TOLERANCE_RAD] * 2 + [script.TOLERANCE_RAD])
    rows = len(simulation.truth.robot.table)
    scale = np.concatenate([np.tile(tolerance, rows), np.tile([script.TOLERANCE_RAD, 1.0, 1.0], 3)])
    moved = script.jacobian(simulation.truth, dataset.poses.q) * scale  # (N, 3, P)
    whiten = np.linalg.inv(np.linalg.cholesky(points.covariance_mm2))
    seen = np.einsum("nij,njp->nip", whiten, moved)[~test].reshape(-1, len(scale))
    seen = np.concatenate([seen, np.eye(len(scale))[: 5 * rows]])
    covariance = np.linalg.pinv(seen.T @ seen, rcond=1e-14, hermitian=True)
    bound_mm = np.sqrt(np.mean(np.einsum("nip,pq,niq->n", moved[test], covariance, moved[test])))
    assert rms_length(missed_mm) < 1.7 * bound_mm  # seeds 2, 3, 4: 1.22, 0.88, 0.84
