"""Scans from a scanner on the flange: from each pose it sees the jig's three faces, and the fit reaches its bound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.jig import jig_geometry
from calib.kinematics.joint_range import joint_range
from calib.simulation.scanner import ScanModel
from calib.simulation.simulate import Simulation, simulate_dataset
from calib.workcell.scan_field import JANG_FIELD

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
